// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this room, and of verdicts.
#pragma once

#include <cstdint>
#include <tuple>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {

// returns.cpp
Index mark_returns(View<const double, 2> xyz, double farthest, View<bool> result);

// scan_lines.cpp
Owned<Index> sort_by_line(View<const Index> line, View<const Index> t, Index low, View<Index> order,
                          View<Index> first);
void link_lines(View<const Index> t, View<const Index> first, double gap_factor,
                View<double> interval, View<Index> before, View<Index> after);

struct Turn {         // how far the scan angle has come, radians
    double before;    // the last angle; NaN before the first
    double furthest;  // in the sense of rotation
    double travel;    // the sum of the small steps so far, within half a turn
};
std::tuple<Index, double, double, double> count_turns(View<const double> angle,
                                                      View<const bool> valid, double noise,
                                                      Index line, Turn turn, View<Index> result);

// mask.cpp
void find_masked(View<const double, 2> xyz, View<const Index> line, View<const bool> valid,
                 View<const double, 2> near, View<const double, 2> far, double tolerance,
                 View<bool> result);
void find_columns(View<const double, 2> xyz, Index columns, View<Index> column,
                  View<double> distance);

// poses.cpp
void move_points(View<const double, 2> xyz, View<const Index> t, View<const bool> covered,
                 View<const Index> times, View<const double, 2> poses,
                 View<const double> mounted_at, View<const double, 2> mounted,
                 View<double, 2> result);

// verdict.cpp, beside verdict.py
void add_scores(std::uint16_t bit, View<const Index> where, View<const double> score,
                View<float> largest, View<std::uint16_t> detectors, View<std::uint16_t> undecided);

}  // namespace lidar
