// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The value of a rank, and medians. Textbook twin: a sort (test/core/kernels/test_kernels.py).
#pragma once

#include <algorithm>

#include "array_view.hpp"
#include "levels.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr Index SMALL = 16;  // values that are sorted rather than partitioned
// Passes over the values before pivots are taken at pseudo-random indices.
inline constexpr Index MAX_PASSES = 8;

// Returns the value of `rank` (from 0) among the first `count`, none NaN; reorders them.
//
// Afterwards no value before `rank` is larger, and none behind it smaller. Quickselect; its
// partition has no branch on the values, which a processor could not predict. Periodic values give
// poor pivots: after MAX_PASSES passes these are drawn pseudo-randomly.
inline double select(double* values, Index count, Index rank) {
    Index low = 0, high = count - 1, left = MAX_PASSES * count, drawn = 1;
    const auto draw = [&] {  // the generator in POSIX
        drawn = (drawn * 1103515245 + 12345) & 0x7FFFFFFF;
        return values[low + drawn % (high - low)];
    };
    const auto partition = [&](Index from, auto is_before) {
        Index middle = from;
        for (Index i = from; i <= high; ++i) {
            const double value = values[i];
            values[i] = values[middle];
            values[middle] = value;
            middle += is_before(value) ? 1 : 0;
        }
        return middle;
    };
    while (high - low > SMALL) {
        double a = values[low], b = values[(low + high) / 2];
        const double c = values[high];
        left -= high - low;
        if (left < 0) {
            a = draw();
            b = draw();
        }
        const double pivot = std::max(std::min(a, b), std::min(std::max(a, b), c));
        Index middle = partition(low, [&](double value) { return value < pivot; });
        if (rank < middle) {
            high = middle - 1;
        } else if (middle > low) {
            low = middle;
        } else {
            // The pivot is the smallest: take all its equals out, so that ties end the search.
            middle = partition(low, [&](double value) { return value <= pivot; });
            if (rank < middle) {
                return pivot;
            }
            low = middle;
        }
    }
    for (Index i = low + 1; i <= high; ++i) {
        const double value = values[i];
        Index j = i;
        while (j > low && values[j - 1] > value) {
            values[j] = values[j - 1];
            --j;
        }
        values[j] = value;
    }
    return values[rank];
}

// Returns the median of the first `count` values, at least one; reorders them.
//
// An even count gives the mean of the two in the middle, as NumPy's does.
inline double median(double* values, Index count) {
    const Index half = count / 2;
    const double upper = select(values, count, half);
    if (count % 2 == 1) {
        return upper;
    }
    double lower = values[0];
    for (Index i = 1; i < half; ++i) {
        lower = std::max(lower, values[i]);
    }
    return (lower + upper) / 2;
}

}  // namespace LEVEL
}  // namespace lidar
