// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this room.
#pragma once

#include <cstdint>

#include "../../kernels/array_view.hpp"
#include "../../kernels/levels.hpp"

namespace lidar {

struct Windows {
    Index before, after;  // points in front of the tested one, and behind it
    Index fewest;         // of a window that predicts
    Index order;          // 1 or 2
    bool either;          // whether each side of a point is a window of its own, too
};

// normal_equations.dispatch.cpp
FOR_EACH_LEVEL(void predict_in_tiles(View<const double, 2> columns, Index pad,
                                     const Windows& windows, View<double, 3> result);
               void predict_one_by_one(View<const double, 2> columns, Index pad,
                                       View<const Index> before, View<const Index> after,
                                       View<const Index> which, View<const Index> slots,
                                       const Windows& windows, View<double, 3> result);)

// passes.cpp
void estimate_precision(View<const double, 2> standard, View<const Index> first, double floor,
                        View<double, 2> result);
void score_windows(View<const double, 3> standard, View<const double, 2> precision,
                   View<const Index> which, double critical, bool either, View<double> score,
                   View<double> rank);
void find_worst(View<const Index> failing, View<const double> rank, View<const Index> before,
                View<const Index> after, Index reach, View<bool> result);
Owned<Index> unlink_points(View<const Index> worst, View<Index> before, View<Index> after,
                           Index reach, View<const bool> rejected);

namespace LEVEL {

// Returns whether a link leads to one of so many points; what does not, ends a segment.
inline bool leads(Index link, Index points) {
    return static_cast<std::uint64_t>(link) < static_cast<std::uint64_t>(points);
}

}  // namespace LEVEL
}  // namespace lidar
