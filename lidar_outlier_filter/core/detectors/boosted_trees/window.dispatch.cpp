// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What all windows of a pattern share: roughness, and places beside.

#include <algorithm>
#include <cmath>

#include "pattern_trees.hpp"

namespace lidar {
namespace LEVEL {

// Writes how much ranges differ from what their neighbours in the ring predict.
//
// For lines begin to end: |1 - range × predicted inverse range| ÷ step; 0 at the ends. On a plane
// the inverse range varies evenly along a ring.
void write_roughness(Pattern pattern, Index begin, Index end, View<float> rough) {
    check_pattern(pattern, begin, end);
    check(rough.size() == pattern.order.size(), "roughness must be (M,)");
    const float* range = pattern.range.data;
    const double* phase = pattern.phase.data;
    float* out = rough.data;
    for (Index line = begin; line < end; ++line) {
        const Index low = pattern.first[line], high = pattern.last[line];
        const float step = pattern.step[line], noise = pattern.noise[line];
        out[low] = out[high - 1] = 0;
        Index k = low + 1;
        for (; k + WIDTH <= high - 1; k += WIDTH) {
            const Singles r = load(range + k), one = repeat(1.0F);
            const DoublePair last = load_pair(phase + k - 1);
            const Singles before = single(load_pair(phase + k) - last);
            const Singles span = single(load_pair(phase + k + 1) - last);
            const Singles part = choose(span > repeat(0.0F), before / span, repeat(0.5F));
            const Singles value = (one - part) / load(range + k - 1) + part / load(range + k + 1);
            const Singles off = size_of(one - r * value) / (step + noise / r);
            store(out + k, least(off, repeat(MAX_VALUE)));
        }
        for (; k < high - 1; ++k) {  // the rest, alike
            const float before = static_cast<float>(phase[k] - phase[k - 1]);
            const float span = static_cast<float>(phase[k + 1] - phase[k - 1]);
            const float part = span > 0 ? before / span : 0.5F;
            const float value = (1 - part) / range[k - 1] + part / range[k + 1];
            out[k] =
                std::min(std::abs(1 - range[k] * value) / (step + noise / range[k]), MAX_VALUE);
        }
    }
}

// Writes the position of the nearest return in azimuth on each ring beside, for some lines.
//
// near (4, M): on the second below, the one below, the one above, the second above; a place of no
// point where there is no such ring. Of two equally near, the first. Entries without a point must
// be valid positions, too.
void find_beside(Pattern pattern, Index begin, Index end, View<std::int32_t, 2> near) {
    check_pattern(pattern, begin, end);
    check(near.size() == 2 * RINGS && near.shape[1] == pattern.order.size(),
          "places beside must be (4, M)");
    const Index lines = pattern.first.size();
    const double* phase = pattern.phase.data;
    for (Index line = begin; line < end; ++line) {
        const Index low = pattern.first[line], high = pattern.last[line];
        for (int m = 0; m < 2 * RINGS; ++m) {
            const Index other = line + (m < RINGS ? m - RINGS : m - RINGS + 1);
            std::int32_t* const to = near.row(m);
            if (other < 0 || other >= lines) {
                std::fill(to + low, to + high, OTHER);
                continue;
            }
            Index j = pattern.first[other];
            const Index stop = pattern.last[other] - 1;
            for (Index k = low; k < high; ++k) {
                const double mine = phase[k];
                while (j < stop && phase[j + 1] <= mine) {
                    ++j;
                }
                // Behind the last one is a place that is far away.
                const bool next = phase[j + 1] - mine < mine - phase[j];
                to[k] = static_cast<std::int32_t>(next ? j + 1 : j);
            }
        }
    }
}

}  // namespace LEVEL
}  // namespace lidar
