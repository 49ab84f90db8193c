// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this room: the k nearest neighbours of points of a kd-tree, exactly, ties
// included; points within a distance, lists that are kept, and points at one place. Twins:
// test/naive/neighbours.py.
#pragma once

#include <tuple>

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

using Lists = Rows<const std::int32_t>;  // (N, k) the neighbours of each point, nearest first

void squared_distances(View<const double, 2> xyz, Lists index, Index k, Index begin, Index end,
                       View<double> result);
void carry_over(Lists index, View<const bool> tied, View<const std::int32_t> new_index, Index begin,
                Index end, View<std::int32_t, 2> index_out, View<bool> tied_out,
                View<std::int32_t> row);
std::tuple<Owned<Index>, Owned<std::int32_t>> list_within(View<const double, 2> xyz, Tree tree,
                                                          View<const Index> which,
                                                          View<const double> limits);
Owned<Index, 2> find_copies(View<const Index> order, View<const double, 2> xyz, Tree tree,
                            View<const Index> these);

Owned<Index> numbers(View<const double, 2> xyz);

}  // namespace lidar
