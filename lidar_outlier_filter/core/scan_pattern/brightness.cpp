// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Brightness of cells, see brightness() of scan_pattern.py.

#include <algorithm>
#include <cmath>
#include <iterator>

#include "../kernels/select.hpp"
#include "scan_pattern.hpp"

namespace lidar {
namespace {

using LEVEL::UNKNOWN;

constexpr float BRIGHTEST = 8.0F;
// Metres. Two to an octave, which single precision holds exactly.
constexpr float EDGES[] = {0.5F,  0.75F, 1.0F,  1.5F,  2.0F,  3.0F,  4.0F,  6.0F,   8.0F,
                           12.0F, 16.0F, 24.0F, 32.0F, 48.0F, 64.0F, 96.0F, 128.0F, 192.0F};
constexpr Index EDGE_COUNT = std::size(EDGES);

// Counts the limits below a power, one less than `ranks`, which is a power of two: a binary search
// without branches.
Index find_rank(View<const double> limits, Index ranks, double power) {
    Index below = 0;
    for (Index step = ranks / 2; step > 0; step /= 2) {
        below += step * (limits[below + step - 1] < power ? 1 : 0);
    }
    return below;
}

}  // namespace

// Returns the median intensity from each edge to the next; 0 where less than `least` cells show it.
//
// `order` and `reach` (M,) are of a sample of the cells, `intensity` (N,) of the points.
Owned<float> usual_brightness(View<const Index> order, View<const float> reach,
                              View<const float> intensity, Index least) {
    check(order.size() == reach.size(), "ranges must be as many as cells");
    check(least > 0, "the least number must be positive");
    const auto shows = [&](Index k) {
        const Index i = order[k];
        check(i < intensity.size(), "cells must be of points that have an intensity");
        return i >= 0 && intensity[i] >= 0;
    };
    const auto between = [&](Index k) {
        return std::lower_bound(std::begin(EDGES), std::end(EDGES), reach[k]) - std::begin(EDGES);
    };
    Index begins[EDGE_COUNT + 2] = {};
    for (Index k = 0; k < order.size(); ++k) {
        if (shows(k)) {
            ++begins[between(k) + 1];
        }
    }
    for (Index b = 0; b <= EDGE_COUNT; ++b) {
        begins[b + 1] += begins[b];
    }
    std::vector<double> values(static_cast<std::size_t>(begins[EDGE_COUNT + 1]));
    Index filled[EDGE_COUNT + 1];
    std::copy_n(begins, EDGE_COUNT + 1, filled);
    for (Index k = 0; k < order.size(); ++k) {
        if (shows(k)) {
            values[static_cast<std::size_t>(filled[between(k)]++)] = intensity[order[k]];
        }
    }
    std::vector<float> usual(EDGE_COUNT + 1);
    for (Index b = 0; b <= EDGE_COUNT; ++b) {
        const Index count = begins[b + 1] - begins[b];
        if (count >= least) {
            const double middle = LEVEL::median(values.data() + begins[b], count);
            usual[static_cast<std::size_t>(b)] = static_cast<float>(middle);
        }
    }
    return Owned<float>(std::move(usual));
}

// Divides intensities of a range of cells by what is usual, and ranks them without the range.
//
// `usual` is from usual_brightness(); `limits` are where ranks begin, none or one less than a power
// of two; `bright` is (2, M).
void compare_brightness(View<const Index> order, View<const float> reach,
                        View<const float> intensity, View<const float> usual,
                        View<const double> limits, Index begin, Index end, View<float, 2> bright) {
    const Index ranks = limits.size() + 1;
    check_range(begin, end, order.size());
    check(order.size() == reach.size() && bright.shape[0] == 2 && bright.shape[1] == order.size(),
          "ranges must be as many as cells, and brightness (2, M)");
    check(usual.size() == EDGE_COUNT + 1, "usual intensities must be between all edges");
    check((ranks & (ranks - 1)) == 0, "ranks must be a power of two");
    float *const relative = bright.row(0), *const ranked = bright.row(1);
    Index b = 0;
    for (Index k = begin; k < end; ++k) {
        const Index i = order[k];
        check(i < intensity.size(), "cells must be of points that have an intensity");
        // Ranges change little from one return to the next.
        while (b < EDGE_COUNT && EDGES[b] < reach[k]) {
            ++b;
        }
        while (b > 0 && !(EDGES[b - 1] < reach[k])) {
            --b;
        }
        relative[k] = ranked[k] = UNKNOWN;
        if (i >= 0 && intensity[i] >= 0) {
            if (usual[b] > 0) {
                relative[k] = std::min(intensity[i] / usual[b], BRIGHTEST);
            }
            if (ranks > 1) {
                const double far = reach[k], power = intensity[i] * (far * far);
                const Index rank = find_rank(limits, ranks, power);
                ranked[k] =
                    static_cast<float>(static_cast<double>(rank) / static_cast<double>(ranks));
            }
        }
    }
}

}  // namespace lidar
