// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The Gabriel graph, see hierarchical.py.
#pragma once

#include "../kernels/array_view.hpp"
#include "../neighbours/tree.hpp"

namespace lidar {

// Returns (E, 2) the edges from points `begin` to `end` to points behind them in tree order.
Owned<std::int32_t, 2> gabriel_edges(View<const double, 2> xyz, Tree tree, Index begin, Index end);
// Returns the lengths of edges, metres.
Owned<double> edge_lengths(View<const double, 2> xyz, View<const std::int32_t, 2> ends);

}  // namespace lidar
