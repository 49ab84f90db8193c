// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The order of points, cores, and the scores of points at one place: see detector.py.

#include "quadric.hpp"

#include <cmath>
#include <vector>

namespace lidar {

namespace {

bool is_before(const double* one, const double* other) {
    for (int axis = 0; axis < 3; ++axis) {
        if (one[axis] != other[axis]) {
            return one[axis] < other[axis];
        }
    }
    return false;
}

}  // namespace

// Writes the positions of the points of some leaves: sorted by x, y and z, so that the order in
// which the points were given does not matter.
void sort_leaves(View<const double, 2> xyz, const Tree& tree, View<const Index> these,
                 View<Index> place) {
    check(xyz.shape[1] == 3 && place.size() == xyz.size(), "xyz must be (N, 3), and place (N,)");
    check_tree(tree, xyz.size());
    check_indices(these, tree.child.size());
    for (Index k = 0; k < these.size(); ++k) {
        const Index first = tree.first[these[k]], last = tree.last[these[k]];
        for (Index i = first; i < last; ++i) {
            Index j = i;
            while (j > first && is_before(xyz.row(i), xyz.row(place[j - 1]))) {
                place[j] = place[j - 1];
                --j;
            }
            place[j] = i;
        }
    }
}

// Gives coincident points, which are adjacent, their lowest score.
//
// Which of them is in the fit depends on their order.
void share_scores(View<const double, 2> xyz, View<double> score) {
    check(xyz.shape[1] == 3 && score.size() == xyz.size(), "xyz must be (N, 3), and score (N,)");
    Index begin = 0;
    for (Index i = 1; i <= score.size(); ++i) {
        const bool ends = i == score.size() || is_before(xyz.row(i - 1), xyz.row(i)) ||
                          is_before(xyz.row(i), xyz.row(i - 1));
        if (ends) {
            double least = score[begin];
            for (Index j = begin + 1; j < i; ++j) {
                least = std::fmin(least, score[j]);
            }
            for (; begin < i; ++begin) {
                score[begin] = least;
            }
        }
    }
}

// Returns the nodes of the largest subtrees with at most so many points, in tree order.
//
// Larger leaves, of coincident points, are cores, too.
Owned<Index> find_cores(const Tree& tree, Index most) {
    check_tree(tree, tree.last.size() > 0 ? tree.last[0] : 0);
    std::vector<Index> cores, stack{0};
    while (!stack.empty()) {
        const Index node = stack.back();
        stack.pop_back();
        if (tree.last[node] - tree.first[node] <= most || tree.child[node] < 0) {
            cores.push_back(node);
        } else {
            stack.push_back(tree.child[node] + 1);
            stack.push_back(tree.child[node]);
        }
    }
    return Owned<Index>(std::move(cores));
}

}  // namespace lidar
