// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Points judged by their scan pattern: what Python calls of it.
#pragma once

#include <tuple>

#include "pattern_scores.hpp"
#include "profile_features.hpp"
#include "trees.hpp"

namespace lidar {

// Writes the scores (N,) of the points of lines begin to end, as given, and which positions (M,)
// are rejected: log-odds (M,) of `limit` above the `least` make a score of 1.
void scale_odds(Pattern pattern, View<const float> odds, double least, double limit, Index begin,
                Index end, View<double> score, View<bool> rejected);
// Counts the points with a score (M,) above 0: before each position, as a share of those at its
// range, and as a share of all.
std::tuple<Owned<std::int32_t>, Owned<float>, double> count_scores(Pattern pattern,
                                                                   View<const float> score);
inline constexpr Index PANE_FEATURES = 7;

FOR_EACH_LEVEL(
    // Writes the roughness of lines begin to end.
    void write_roughness(Pattern pattern, Index begin, Index end, View<float> rough);
    // Writes the place nearest in azimuth on each ring beside, for lines begin to end.
    void find_beside(Pattern pattern, Index begin, Index end, View<std::int32_t, 2> near);
    // Writes the log-odds (M,) of the asked positions (M,) of lines begin to end; and their
    // features (F, W) into columns (M,) if these have rows.
    void judge_pattern(Prepared prepared, FirstPass first, bool second, View<const bool> asked,
                       Trees trees, View<const Index> column, Index begin, Index end,
                       View<float> odds, View<float, 2> values);
    // Writes what may have mirrored the points of places begin to end, (7, W) as PANE in
    // features.py; 0 if nothing.
    void find_panes(Prepared prepared, View<const Index> places, Index begin, Index end,
                    View<float, 2> out);)

}  // namespace lidar
