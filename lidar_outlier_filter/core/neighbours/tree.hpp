// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The nodes of a kd-tree, and walks through them: see tree_build.py for what the arrays are.
//
// Distances are squared everywhere. The gap to a box is never more than the distance to a point in
// it, not even by rounding, because both are computed alike and every operation rounds
// monotonically: what is left out for a gap strictly greater than a bound could not have tied.
#pragma once

#include <algorithm>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {

struct Tree {
    View<const double, 2> low, high;  // (M, 3), metres
    View<const Index> first, last;    // (M,) the points of a node
    View<const Index> child;          // (M,) the left child; the right one is the next; -1: a leaf
    Index levels = 0;                 // 0: not counted, nor checked; see tree_caster.hpp
};

struct Box {  // may be a point
    double low[3], high[3];
};

// Refuses a tree that is none over so many points: walks take its numbers as addresses.
void check_tree(const Tree& tree, Index points);

// Returns how many levels a tree has, and checks it. A walk that puts both children of a node on
// its stack needs room for one more.
Index tree_height(const Tree& tree);

// Returns the nodes of the largest subtrees with at most so many points, in the order of these; and
// larger leaves, of coincident points. Of 0 points: all leaves.
Owned<Index> subtrees(const Tree& tree, Index most);

namespace LEVEL {

inline constexpr Index LEAF = 24;  // points

inline Box box_of(const double* point) {
    return {{point[0], point[1], point[2]}, {point[0], point[1], point[2]}};
}

// Returns the squared distance between a box and another one, or a point: then `low` is `high`.
inline double gap(const double* low, const double* high, const Box& box) {
    const double dx = std::max(std::max(low[0] - box.high[0], box.low[0] - high[0]), 0.0);
    const double dy = std::max(std::max(low[1] - box.high[1], box.low[1] - high[1]), 0.0);
    const double dz = std::max(std::max(low[2] - box.high[2], box.low[2] - high[2]), 0.0);
    return (dx * dx + dy * dy) + dz * dz;
}

inline double gap(const Tree& tree, Index node, const Box& box) {
    return gap(tree.low.row(node), tree.high.row(node), box);
}

// Returns the squared distance of two points, in the order of operations of the search.
inline double squared(const double* p, const double* q) {
    const double dx = p[0] - q[0], dy = p[1] - q[1], dz = p[2] - q[2];
    return (dx * dx + dy * dy) + dz * dz;
}

}  // namespace LEVEL
}  // namespace lidar
