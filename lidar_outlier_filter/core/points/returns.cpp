// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Which points are returns, see points.py.

#include <algorithm>
#include <cmath>

#include "points.hpp"

namespace lidar {
namespace {

bool is_finite(const double* p) {
    return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

double largest(const double* p) {
    return std::max(std::max(std::abs(p[0]), std::abs(p[1])), std::abs(p[2]));
}

}  // namespace

// Marks the points that are returns, and returns the index of the first beyond `farthest`, or -1.
//
// A return has three finite coordinates that are not all 0.
Index mark_returns(View<const double, 2> xyz, double farthest, View<bool> result) {
    check(xyz.shape[1] == 3 && result.size() == xyz.size(), "xyz must be (N, 3), result (N,)");
    bool absurd = false;
    for (Index i = 0; i < xyz.size(); ++i) {
        const double* const p = xyz.row(i);
        const bool finite = is_finite(p);
        result[i] = finite && largest(p) > 0;
        absurd |= finite && largest(p) > farthest;
    }
    if (!absurd) {
        return -1;
    }
    Index first = 0;
    while (!(is_finite(xyz.row(first)) && largest(xyz.row(first)) > farthest)) {
        ++first;
    }
    return first;
}

}  // namespace lidar
