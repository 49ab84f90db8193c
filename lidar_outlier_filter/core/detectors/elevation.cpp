// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Differences of elevations, see elevation.py. Naive twin: test/naive/elevation.py.

#include "detectors.hpp"

namespace lidar {

void elevation_differences(View<const double> elevation, Rows<const std::int32_t> index,
                           Index begin, Index end, View<double> result) {
    check(index.size() == elevation.size() && result.size() == elevation.size(),
          "there must be a list and a place for each point");
    check_indices(index, begin, end, elevation.size());
    const Index k = index.shape[1];
    for (Index i = begin; i < end; ++i) {
        double total = 0;
        for (Index j = 0; j < k; ++j) {
            total += elevation[index(i, j)] - elevation[i];
        }
        result[i] = total / static_cast<double>(k);
    }
}

void elevation_differences_of_lists(View<const double> elevation, View<const Index> which,
                                    View<const Index> offsets, View<const std::int32_t> near,
                                    View<double> result) {
    check(offsets.size() == which.size() + 1 && result.size() == elevation.size(),
          "there must be a place for each point, and one more offset");
    check_indices(which, elevation.size());
    check_indices(near, elevation.size());
    for (Index i = 0; i < which.size(); ++i) {
        check_range(offsets[i], offsets[i + 1], near.size());
        double total = 0;
        for (Index j = offsets[i]; j < offsets[i + 1]; ++j) {
            total += elevation[near[j]] - elevation[which[i]];
        }
        result[which[i]] = total / static_cast<double>(offsets[i + 1] - offsets[i]);
    }
}

}  // namespace lidar
