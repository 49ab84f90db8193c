// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The features of windows: features.py says what each means. Lengths are divided by the spacing of
// the beams: range × step along the ring, or × the angle to the next ring.
#pragma once

#include "window.hpp"

namespace lidar {

// Rows of the features of windows, as WINDOW in features.py.
enum WindowFeature {
    STEP,
    LEAP,
    ALONG,
    ALONG_M,
    BETWEEN,
    BESIDE,
    ACROSS,
    NEAR3,
    NEAR5,
    NEAR5_M,
    BEFORE_OWN,
    BEHIND_OWN,
    BEFORE_OTHER,
    BEHIND_OTHER,
    LEVEL_OWN,
    LEVEL_OTHER,
    THERE_OWN,
    THERE_OTHER,
    ROUGH_OWN,
    ROUGH_OTHER,
    RANGE,
    RANGE_RATIO_GLARE,
    DEPTH,
    DENSE,
    SPARSE,
    BRIGHT,
    UNEVEN,
    RANK,
    WINDOW_FEATURES
};

namespace LEVEL {

// Rows of features of several vectors of points, from one of these on.
template <int ROW>
struct Features {
    float (*values)[ROW];

    [[gnu::always_inline]] void set(int row, Singles value) const {
        store(values[row], value);
    }
    // Lengths beyond MAX_VALUE are all alike.
    [[gnu::always_inline]] void set_length(int row, Singles value) const {
        store(values[row], least(value, repeat(MAX_VALUE)));
    }
};

// Returns how far ranges are from the straight line through two others, as a part of them.
//
// pa and pb are their phases, less those of the ranges. On a line, the inverse range is even.
[[gnu::always_inline]] inline Singles off_line(Singles r, Singles ra, Singles pa, Singles rb,
                                               Singles pb, float reach) {
    const Singles one = repeat(1.0F), zero = repeat(0.0F), span = pb - pa;
    const Counts good =
        (size_of(pa) <= repeat(reach)) & (size_of(pb) <= repeat(reach)) & (size_of(span) > zero);
    const Singles part = (zero - pa) / choose(good, span, one);
    const Singles value = (one - part) / ra + part / rb;
    // What the noise of both adds is taken off.
    const Singles size = root(one + (one - part) * (one - part) + part * part);
    const Singles off = least(size_of(one - r * value) / size, repeat(MAX_VALUE));
    return choose(good, off, repeat(MAX_VALUE));
}

// Writes how far the range is from three predictions along the ring.
template <int ROW>
[[gnu::always_inline]] inline void write_along(const Line& line, const Sums& sums, Singles r,
                                               Features<ROW> to) {
    const Singles *at = sums.range, *phase = sums.phase;
    const float reach = line.reach_along;
    const Singles middle = off_line(r, at[1], phase[1], at[2], phase[2], reach);
    const Singles before = off_line(r, at[1], phase[1], at[0], phase[0], reach);
    const Singles after = off_line(r, at[2], phase[2], at[3], phase[3], reach);
    const Singles off = least(least(middle, before), after);
    const Singles unit = line.step + line.noise / r;
    to.set_length(ALONG, off / unit);
    to.set_length(ALONG_M, off * r);
    to.set_length(BETWEEN, middle / unit);
}

// Writes how far the nearest returns are: in the ring, in other rings, and of all.
template <int ROW>
[[gnu::always_inline]] inline void write_distances(const Line& line, const Sums& sums, Singles r,
                                                   Features<ROW> to) {
    const Singles own_unit = r * line.step + line.noise, unit = r * line.gap + line.apart;
    const Singles a = root(sums.square_before), b = root(sums.square_behind);
    to.set_length(STEP, least(a, b) / own_unit);
    to.set_length(LEAP, most(a, b) / own_unit);
    to.set_length(BESIDE, root(sums.nearest_other) / unit);
    const Singles three = root(sums.best0) + root(sums.best1) + root(sums.best2);
    const Singles five = three + root(sums.best3) + root(sums.best4);
    to.set_length(NEAR3, three / (3.0F * unit));
    to.set_length(NEAR5, five / (5.0F * unit));
    to.set_length(NEAR5_M, five / 5.0F);
}

// Writes shares of the window, and how rough it is.
template <int ROW>
[[gnu::always_inline]] inline void write_shares(const Sums& sums, Features<ROW> to) {
    constexpr float PLACES[] = {2 * OWN, SIZE - 2 * OWN}, POSITIONS = SIZE;
    const Singles one = repeat(1.0F);
    for (int n = 0; n < 2; ++n) {
        const Sums::Part& part = n == 0 ? sums.own : sums.other;
        const Singles there = most(part.there, one);
        to.set(BEFORE_OWN + 2 * n, part.before / there);
        to.set(BEHIND_OWN + 2 * n, part.behind / there);
        to.set(LEVEL_OWN + n, part.level / PLACES[n]);
        to.set(THERE_OWN + n, part.there / PLACES[n]);
        to.set(ROUGH_OWN + n, part.rough / most(part.rough_count, one));
    }
    to.set(DENSE, sums.dense / POSITIONS);
    to.set(SPARSE, sums.sparse / POSITIONS);
}

// Writes how far the range is from predictions across the rings.
//
// Of a plane, the inverse range is straight across the rings; below 0 it is unknown.
template <int ROW>
[[gnu::always_inline]] inline void write_across(const Line& line, const Sums& sums, Singles r,
                                                Features<ROW> to) {
    const float* beside = line.beside;
    const float part = beside[1] / (beside[1] + beside[2]);
    const float low = beside[1] / (beside[0] - beside[1]);
    const float high = beside[2] / (beside[3] - beside[2]);
    const Singles a = sums.inverse[0], b = sums.inverse[1];
    const Singles c = sums.inverse[2], d = sums.inverse[3];
    const Singles zero = repeat(0.0F), one = repeat(1.0F), unknown = repeat(MAX_VALUE);
    Singles between = size_of(one - r * ((1.0F - part) * b + part * c));
    between = choose((b > zero) & (c > zero), between, unknown);
    Singles below = size_of(one - r * ((1.0F + low) * b - low * a)) / (1.0F + low);
    below = choose((a > zero) & (b > zero), below, unknown);
    Singles above = size_of(one - r * ((1.0F + high) * c - high * d)) / (1.0F + high);
    above = choose((c > zero) & (d > zero), above, unknown);
    to.set_length(ACROSS, least(least(between, below), above) / (line.gap + line.noise / r));
}

// Writes the features of gathered windows.
template <int ROW>
[[gnu::always_inline]] inline void write_window(const Line& line, const Sums& sums,
                                                const Points& mine, Features<ROW> to) {
    const Singles r = mine.range;
    write_along(line, sums, r, to);
    write_distances(line, sums, r, to);
    write_shares(sums, to);
    write_across(line, sums, r, to);
    to.set(RANGE, r);
    to.set(RANGE_RATIO_GLARE, r * r / sums.farthest);
    to.set(DEPTH, r / sums.farthest);
    to.set(UNEVEN, repeat(line.uneven));
}

}  // namespace LEVEL
}  // namespace lidar
