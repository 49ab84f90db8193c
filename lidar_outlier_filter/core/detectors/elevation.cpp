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

}  // namespace lidar
