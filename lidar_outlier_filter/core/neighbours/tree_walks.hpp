// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Points within a distance, lists that are kept, and points at one place. Twins:
// test/naive/neighbours.py.
#pragma once

#include <tuple>

#include "../kernels/array_view.hpp"
#include "tree.hpp"

namespace lidar {

using Lists = Rows<const std::int32_t>;  // (N, k) the neighbours of each point, nearest first

void tied_at(View<const double, 2> xyz, Lists index, Index k, Index begin, Index end,
             View<bool> tied);
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

}  // namespace lidar
