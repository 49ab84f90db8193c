// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The parts of building a kd-tree that tree_build.py puts together.
#pragma once

#include <tuple>

#include "../kernels/array_view.hpp"
#include "tree.hpp"

namespace lidar {

// Points are moved to and fro between two buffers, their indices with them.
struct Buffers {
    View<double, 2> points, spare_points;
    View<std::int32_t> index, spare_index;
};

// The members of a Tree, in their order.
using OwnedTree =
    std::tuple<Owned<double, 2>, Owned<double, 2>, Owned<Index>, Owned<Index>, Owned<Index>>;

struct Cut {
    Index middle, patience;
};

std::tuple<Index, Index> halve_node(Buffers buffers, Index first, Index last, bool in_spare,
                                    Index patience);
OwnedTree grow_tree(Buffers buffers, Index first, Index last, bool in_spare, Index patience);
OwnedTree prune_tree(Tree tree, View<const Index> first, View<const Index> last,
                     View<const double, 2> xyz);

}  // namespace lidar
