// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Peaks of the histogram of elevations, see recovered_rings.py; textbook twin:
// test/naive/recovered_rings.py.

#include <algorithm>

#include "scan_pattern.hpp"

namespace lidar {
namespace {

constexpr Index VALLEY = 2;  // times as many points as between two rings, at either

}  // namespace

// Returns where a histogram has peaks.
//
// A peak has at least `least`; somewhere between two peaks is at most 1 / VALLEY of either.
Owned<Index> find_peaks(View<const Index> count, Index least) {
    std::vector<Index> peaks;
    Index top = 0, index = 0, low = 0;
    bool climbing = true;
    for (Index i = 0; i < count.size(); ++i) {
        const Index value = count[i];
        if (climbing) {
            if (value > top) {
                top = value;
                index = i;
            } else if (top >= least && value * VALLEY < top) {
                peaks.push_back(index);
                low = value;
                climbing = false;
            } else if (value == 0) {
                top = 0;
            }
        } else if (value >= least && value >= VALLEY * low) {
            top = value;
            index = i;
            climbing = true;
        } else {
            low = std::min(low, value);
        }
    }
    return Owned<Index>(std::move(peaks));
}

}  // namespace lidar
