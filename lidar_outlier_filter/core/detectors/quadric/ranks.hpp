// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The value of a rank, where the order of the others does not matter. Textbook twin: a sort.
#pragma once

#include <algorithm>
#include <limits>

#include "../../kernels/select.hpp"

namespace lidar {
namespace LEVEL {

// Returns the value of `rank` (from 0) among at most SMALL values: the largest of those that no
// more than so many are less than.
[[gnu::always_inline]] inline double find_among_few(const double* values, Index count, Index rank) {
    double each[SMALL];
    for (Index i = 0; i < SMALL; ++i) {
        each[i] = i < count ? values[i] : std::numeric_limits<double>::infinity();
    }
    std::int64_t less[SMALL] = {};
    for (Index j = 0; j < SMALL; ++j) {
        for (Index i = 0; i < SMALL; ++i) {
            less[i] += each[j] < each[i] ? 1 : 0;
        }
    }
    double found = -std::numeric_limits<double>::infinity();
    for (Index i = 0; i < SMALL; ++i) {
        found = std::max(found, less[i] <= rank ? each[i] : found);
    }
    return found;
}

// Returns the value of `rank` (from 0) among the first `count`, none NaN; as select(), but it
// leaves nothing in order. `room` is for as many values.
//
// What is below a pivot and what is above it go to two places, so that no value waits for another.
inline double find_rank(double* values, Index count, Index rank, double* room) {
    Index left = MAX_PASSES * count;
    while (count > SMALL) {
        left -= count;
        if (left < 0) {
            return select(values, count, rank);
        }
        const double a = values[0], b = values[count / 2], c = values[count - 1];
        const double pivot = std::max(std::min(a, b), std::min(std::max(a, b), c));
        Index below = 0, above = 0;
        for (Index i = 0; i < count; ++i) {
            const double value = values[i];
            values[below] = value;  // which is at most at i
            room[above] = value;
            below += value < pivot ? 1 : 0;
            above += value > pivot ? 1 : 0;
        }
        if (rank < below) {
            count = below;
        } else if (rank >= count - above) {
            rank -= count - above;
            count = above;
            std::swap(values, room);
        } else {
            return pivot;
        }
    }
    return find_among_few(values, count, rank);
}

}  // namespace LEVEL
}  // namespace lidar
