// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The k nearest neighbours of points of a kd-tree, exactly, ties included.
#pragma once

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"
#include "tree.hpp"

namespace lidar {

// Writes the lists of the points in the leaves `these`, nearest first, equally far ones by `order`,
// (N,) the index of each point as given.
//
// `row`, (N,), says where in `index`, (M, k), and `tied`, (M,), the list of a point is; negative:
// it is not searched. tied: whether another point, not in the list, is exactly as far as the k-th.
FOR_EACH_LEVEL(void search_nearest(View<const double, 2> xyz, Tree tree, View<const Index> these,
                                   View<const Index> order, View<const std::int32_t> row,
                                   View<std::int32_t, 2> index, View<bool> tied);)

}  // namespace lidar
