// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The features of the second pass: log-odds of the first pass around a point, see SECOND_PASS in
// features.py.
#pragma once

#include <algorithm>

#include "window_features.hpp"

namespace lidar {

// Scores of the first pass, and how many points have one above 0: see FirstPass in
// pattern_trees.py.
struct FirstPass {
    View<const float> score;          // (M,)
    View<const std::int32_t> before;  // (M + 1,)
    View<const float> share;          // (M,)
    double whole;
};

// Rows of the features of the second pass, from the first of these on.
enum SecondFeature {
    FIRST,
    FIRST_OWN,
    FIRST_OTHER,
    FIRST_CLOSE,
    FIRST_LEVEL,
    FIRST_BEHIND,
    FIRST_BEFORE,
    WIDE_OWN,
    WIDE_OTHER,
    SHARE,
    SHARE_RANGE,
    SECOND_FEATURES
};
inline constexpr float CLIP = 4;      // of scores
inline constexpr float NO_MEAN = -5;  // a mean of none

namespace LEVEL {

struct Mean {
    Singles sum = repeat(0.0F), count = repeat(0.0F);

    [[gnu::always_inline]] void add(Counts mask, Singles value) {
        sum = sum + choose(mask, value, repeat(0.0F));
        count += choose(mask, repeat(1.0F), repeat(0.0F));
    }
    [[gnu::always_inline]] Singles value() const {
        return choose(count > repeat(0.0F), sum / count, repeat(NO_MEAN));
    }
};

// Writes means of clipped scores over windows: of the ring, other rings, and by where they are.
template <int ROW>
inline void write_means(const Line& line, const float* score, const Places& points,
                        const Points& mine, const Returns& returns, Features<ROW> to) {
    const Singles unit = mine.range * line.gap + line.apart, unit_square = unit * unit;
    Mean part[2], close, level, behind, before;
    for (int slot = 0; slot < SIZE; ++slot) {
        const bool own = slot < 2 * OWN;
        const int ring = own ? 0 : (slot - 2 * OWN) / AROUND;
        Singles c;
        if (own) {
            c = points.of(score, slot < OWN ? slot - OWN : slot - OWN + 1);
        } else {
            c = take(score + (slot - 2 * OWN) % AROUND - OTHER, returns.others[ring]);
        }
        c = least(most(c, repeat(-CLIP)), repeat(CLIP));
        const Singles square = returns.square[slot], away = returns.away[slot];
        const Counts good = square < FAR;
        part[own ? 0 : 1].add(good, c);
        const Singles weight = choose(good, unit_square / (unit_square + square), repeat(0.0F));
        close.sum = close.sum + weight * c;
        close.count = close.count + weight;
        level.add(good & (size_of(away) <= mine.same), c);
        behind.add(away > mine.same, c);
        before.add(away < mine.closer, c);
    }
    const Singles first = points.of(score);
    to.set(FIRST, least(most(first, repeat(-CLIP)), repeat(CLIP)));
    to.set(FIRST_OWN, part[0].value());
    to.set(FIRST_OTHER, part[1].value());
    to.set(FIRST_CLOSE, close.value());
    to.set(FIRST_LEVEL, level.value());
    to.set(FIRST_BEHIND, behind.value());
    to.set(FIRST_BEFORE, before.value());
}

// Writes the shares of points with a score above 0: in long stretches, of all, and at the range.
template <int ROW>
inline void write_suspects(const FirstPass& first, const Places& points, const Returns& returns,
                           Features<ROW> to) {
    constexpr float STRETCHED = 2 * STRETCH + 1;
    const auto count = [&](Index k) {
        return static_cast<float>(first.before[k + STRETCH + 1] - first.before[k - STRETCH]);
    };
    for (int lane = 0; lane < WIDTH; ++lane) {
        const Index k = points.at[lane];
        float wide_other = 0;
        for (const Counts& others : returns.others) {
            const Index j = std::max<Index>(others[lane], STRETCH);
            wide_other += count(j) / (STRETCHED * (2.0F * RINGS));
        }
        to.values[WIDE_OWN][lane] = count(k) / STRETCHED;
        to.values[WIDE_OTHER][lane] = wide_other;
        to.values[SHARE][lane] = static_cast<float>(first.whole);
        to.values[SHARE_RANGE][lane] = first.share[k];
    }
}

}  // namespace LEVEL
}  // namespace lidar
