// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this room. Lines are numbered by `first`, (L + 1,): where each begins.
#pragma once

#include <tuple>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"
#include "ordered_lines.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr double SAME_SHOT = 2e-5;  // rad: nearer, two returns of a ring are of one beam
inline constexpr float UNKNOWN = -1.0F;    // brightness
inline constexpr Index LAG = 8;            // returns of a ring, to measure how fast the head turns
inline constexpr double MIN_RANGE_M = 0.01;  // m: least range of a profile scanner

}  // namespace LEVEL

// What is written of a Pattern, see placed_pattern.py.
struct Cells {
    View<const Index> first, last;
    View<Index> order;
    View<float> x, y, z, range;
    View<double> phase;
};

using Fits = std::tuple<Owned<double, 2>, Owned<double>, Owned<double>, Owned<double, 3>>;

// placed_pattern.cpp
Owned<Index> sort_nearly(OrderedLines lines, Index begin, Index end, View<double> phase,
                         View<double> up);
void join_shots(OrderedLines lines, Index begin, Index end, View<double> phase, View<double> up);
Index find_line_copies(OrderedLines lines, View<const double> phase, View<const float> intensity,
                       View<Index> original);
void place_lines(OrderedLines lines, View<const double> phase, View<const Index> rank, Index begin,
                 Index end, Cells cells);
void write_ranges(View<const double, 2> xyz, View<const Index> order, View<const Index> first,
                  View<const double, 2> position, View<const double, 2> moved,
                  View<double> distance);

// brightness.cpp
Owned<float> usual_brightness(View<const Index> order, View<const float> reach,
                              View<const float> intensity, Index least);
void compare_brightness(View<const Index> order, View<const float> reach,
                        View<const float> intensity, View<const float> usual,
                        View<const double> limits, Index begin, Index end, View<float, 2> bright);

Owned<Index> find_peaks(View<const Index> count, Index least);  // recovered_rings.cpp

FOR_EACH_LEVEL(
    // scan_pattern.dispatch.cpp
    void write_directions(OrderedLines lines, Index begin, Index end, View<double> azimuth,
                          View<double> up);
    double turning_rate(View<const double> azimuth, View<const Index> t, View<const Index> first);
    void unwrap_turns(View<const double> azimuth, View<const Index> t, View<const Index> first,
                      double rate, Index begin, Index end, View<double> phase, View<Index> steady);
    void typical_of_lines(View<const double> up, View<const double> phase, View<const Index> first,
                          View<double> elevation, View<double> step);
    // recovered_rings.dispatch.cpp
    double spread(View<const double> flat, View<const double> z, double up, double out);
    Owned<double> elevations(View<const double> flat, View<const double> z, double up, double out);
    Owned<Index> times_of_turn(View<const double, 2> xyz);
    // profile_scanner.dispatch.cpp
    Fits fit_lines(View<const double, 3> xyz, View<const double, 2> turned);
    Owned<double> off_plane(View<const double, 3> xyz, View<const double, 2> turned);)

}  // namespace lidar
