// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What is counted once for all points of a scan pattern, and what arrays must be like.

#include "pattern_trees.hpp"

#include <algorithm>
#include <vector>

namespace lidar {

void check_pattern(const Pattern& pattern, Index begin, Index end) {
    const Index size = pattern.order.size(), lines = pattern.first.size();
    const bool rows = pattern.x.size() == size && pattern.y.size() == size &&
                      pattern.z.size() == size && pattern.range.size() == size &&
                      pattern.phase.size() == size && pattern.bright.size() == 2 &&
                      pattern.bright.shape[1] == size;
    const bool of_lines = pattern.last.size() == lines && pattern.step.size() == lines &&
                          pattern.gap.size() == lines && pattern.turn.size() == lines &&
                          pattern.beside.size() == 2 * RINGS && pattern.beside.shape[1] == lines &&
                          pattern.uneven.size() == lines && pattern.noise.size() == lines &&
                          pattern.apart.size() == lines && pattern.level.size() == lines;
    check(rows && of_lines && size <= INT32_MAX,
          "the arrays of a pattern must be of M positions, or of L lines");
    check_range(begin, end, lines);
    bool fits = true;
    for (Index line = std::max<Index>(begin - RINGS, 0); line < std::min<Index>(end + RINGS, lines);
         ++line) {
        const Index first = pattern.first[line], last = pattern.last[line];
        fits &= PAD <= first && first <= last && last <= size - PAD;
    }
    check(fits, "lines must lie within the pattern, with empty positions around each");
}

void check_beside(const Pattern& pattern, View<const std::int32_t, 2> near, Index begin,
                  Index end) {
    const Index size = pattern.order.size();
    check(near.size() == 2 * RINGS && near.shape[1] == size, "places beside must be (4, M)");
    const auto highest = static_cast<std::int32_t>(size - STRETCH);
    bool fits = true;
    for (Index line = begin; line < end; ++line) {
        for (int ring = 0; ring < 2 * RINGS; ++ring) {
            const std::int32_t* row = near.row(ring);
            // Positions are read side by side, beyond the end of a line.
            const Index last = pattern.last[line] + PAD - STRETCH;
            for (Index k = pattern.first[line]; k < last; ++k) {
                fits &= OTHER <= row[k] && row[k] < highest;
            }
        }
    }
    check(fits, "places beside must lie within the pattern");
}

void scale_odds(Pattern pattern, View<const float> odds, double least, double limit, Index begin,
                Index end, View<double> score, View<bool> rejected) {
    check_pattern(pattern, begin, end);
    const Index size = pattern.order.size();
    check(odds.size() == size && rejected.size() == size,
          "log-odds and what is rejected must be (M,)");
    for (Index line = begin; line < end; ++line) {
        for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
            const Index i = pattern.order[k];
            check(0 <= i && i < score.size(), "indices must lie within the scores");
            const double value = std::max(static_cast<double>(odds[k]) - least, 0.0) / limit;
            score[i] = value;
            rejected[k] = value > 1;
        }
    }
}

std::tuple<Owned<std::int32_t>, Owned<float>, double> count_scores(Pattern pattern,
                                                                   View<const float> score) {
    constexpr int BINS = 8;  // of range: up to 1, 2, 4, 8 ... m
    check_pattern(pattern, 0, 0);
    const Index size = pattern.order.size();
    check(score.size() == size, "scores must be (M,)");
    std::vector<std::int32_t> before(static_cast<std::size_t>(size) + 1);
    std::vector<float> share(static_cast<std::size_t>(size));
    const auto bin = [](float range) {
        int b = 0;
        float edge = 1;
        for (int n = 0; n < BINS - 1; ++n, edge *= 2) {
            b += range > edge ? 1 : 0;
        }
        return b;
    };
    Index count[BINS] = {}, above[BINS] = {}, points = 0, outliers = 0;
    std::int32_t so_far = 0;
    for (Index k = 0; k < size; ++k) {
        const bool there = pattern.order[k] >= 0, flag = there && score[k] > 0;
        so_far += flag ? 1 : 0;
        before[static_cast<std::size_t>(k) + 1] = so_far;
        const int b = bin(pattern.range[k]);
        count[b] += there ? 1 : 0;
        above[b] += flag ? 1 : 0;
    }
    float shares[BINS];
    for (int b = 0; b < BINS; ++b) {
        points += count[b];
        outliers += above[b];
        shares[b] = static_cast<float>(static_cast<double>(above[b]) /
                                       static_cast<double>(std::max<Index>(count[b], 1)));
    }
    for (Index k = 0; k < size; ++k) {
        share[static_cast<std::size_t>(k)] = shares[bin(pattern.range[k])];
    }
    const double whole =
        static_cast<double>(outliers) / static_cast<double>(std::max<Index>(points, 1));
    return {Owned<std::int32_t>(std::move(before)), Owned<float>(std::move(share)),
            static_cast<double>(static_cast<float>(whole))};
}

}  // namespace lidar
