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

}  // namespace lidar
