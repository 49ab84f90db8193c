// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Features of profile scanners alone: predictions by pairs of returns, free groups, and heights.
// See profile_features.py for the method. Naive twins:
// test/naive/{profile_pattern,groups,survey}.py.
#pragma once

#include <algorithm>
#include <cstdint>
#include <tuple>

#include "../../kernels/lanes.hpp"
#include "../../neighbours/floor.hpp"
#include "window_features.hpp"

namespace lidar {

// Rows of the features of profile scanners, from the first of these on, as PROFILE in features.py.
enum ProfileFeature { MIDDLE, AGREE, GROUP, HEIGHT = GROUP + 5, PROFILE_FEATURES };
inline constexpr int GROUP_FEATURES = HEIGHT - GROUP;
inline constexpr int BLOCK_FEATURES = PROFILE_FEATURES - GROUP;  // that all lines give together

struct Segments {                   // of all lines, numbered from 0
    View<const std::int32_t> of;    // (M,) of each position; -1: no point
    View<const std::int32_t> size;  // (S,) how many returns each has
};

// Finds the segments of all lines, one after the other: `of` and `size`.
std::tuple<Owned<std::int32_t>, Owned<std::int32_t>> find_segments(Pattern pattern, double reach);
// Returns the number of the free group that each segment is in, from 0; -1 for none.
Owned<std::int32_t> join_segments(Pattern pattern, View<const std::int32_t, 2> near, double reach,
                                  Segments segments);
// Returns the features of each group, (5, G).
Owned<float, 2> describe_groups(Pattern pattern, Segments segments, View<const std::int32_t> group);
// Writes the features (5, G) of its group to each position (5, M) that has one.
void write_groups(Pattern pattern, Segments segments, View<const std::int32_t> group,
                  View<const float, 2> described, View<float, 2> out);
// Writes how high the points of some lines are above a floor, metres, to their positions (M,).
void write_heights(Pattern pattern, Floor around, Index begin, Index end, View<float> out);

namespace LEVEL {

inline constexpr int PAIRS = OWN + RINGS * AROUND;
inline constexpr float MAX_OFF_SIGMAS = 3.5;  // standard deviations up to which a pair is right
inline constexpr float MISSING = 1e6;         // behind all others
// Where the median is, of any number.
inline constexpr Network LOWER_HALF = make_network(PAIRS, 0, PAIRS / 2 + 1);

// Writes the median deviation, in σ, from what opposite returns predict, and the share of those
// that predict the range.
template <int ROW>
inline void write_predictions(const Line& line, Singles r, const Returns& returns,
                              Features<ROW> to) {
    const Singles zero = repeat(0.0F), one = repeat(1.0F), offset = repeat(MAX_VALUE);
    const float sigma = 0.5F * line.noise;
    Singles pairs[PAIRS], there = zero, right = zero;
    for (int m = 0; m < PAIRS; ++m) {
        // Before and after in the line; then in the lines before and after.
        const int a = m < OWN ? OWN - 1 - m : OWN + m, b = m < OWN ? OWN + m : SIZE - 1 + OWN - m;
        Counts good = (returns.square[a] < FAR) & (returns.square[b] < FAR);
        Singles off;
        if (m < OWN) {
            const Singles pa = returns.phase[a], pb = returns.phase[b];
            good &= pb > pa;
            const Singles part = (zero - pa) / choose(good, pb - pa, one);
            const Singles value = (one - part) / returns.range[a] + part / returns.range[b];
            // Of a plane, the inverse range is a sine: between two others it is more than a line.
            off = r * value - one - 0.5F * pa * pb;
        } else {
            const float aside = static_cast<float>((m - OWN) % AROUND - OTHER) * line.step;
            const Singles value = 0.5F / (r + returns.away[a]) + 0.5F / (r + returns.away[b]);
            off = r * value - one + 0.5F * aside * aside;
        }
        off = least(most(off * r / sigma, -offset), offset) + offset;
        pairs[m] = choose(good, off, repeat(MISSING));
        right += choose(good & (size_of(off - offset) < MAX_OFF_SIGMAS), one, zero);
        there += choose(good, one, zero);
    }
    for (int k = 0; k < LOWER_HALF.size; ++k) {
        Singles &smaller = pairs[LOWER_HALF.pairs[k].smaller],
                &larger = pairs[LOWER_HALF.pairs[k].larger];
        const Singles low = least(smaller, larger);
        larger = most(smaller, larger);
        smaller = low;
    }
    for (int lane = 0; lane < WIDTH; ++lane) {
        const int count = static_cast<int>(there[lane]);
        const float low = pairs[std::max(count - 1, 0) / 2][lane], high = pairs[count / 2][lane];
        to.values[MIDDLE][lane] = count > 0 ? (low + high) / 2.0F - MAX_VALUE : 0.0F;
    }
    to.set(AGREE, choose(there > zero, right / most(there, one), -one));
}

// Writes the features of profile scanners of gathered windows.
template <int ROW>
inline void write_profile(const Line& line, const Prepared& prepared, const Places& points,
                          Singles r, const Returns& returns, Features<ROW> to) {
    write_predictions(line, r, returns, to);
    for (int row = 0; row < BLOCK_FEATURES; ++row) {
        to.set(GROUP + row, points.of(prepared.of_block.row(row)));
    }
}

}  // namespace LEVEL
}  // namespace lidar
