// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What a receiver makes of the rays of a footprint, see sensors.py.

#include <limits>

#include "kernels.hpp"

namespace lidar {

// Returns the mean distance (N,) and share of the largest group of rays (N, K); of equals the
// nearest.
//
// A group ends where the next ray met something more than `pulse` farther on. Without any the mean
// is inf and the share 0.
std::tuple<Owned<double>, Owned<double>> strongest(View<const double, 2> distance, double pulse) {
    constexpr double INFINITE = std::numeric_limits<double>::infinity();
    const Index shots = distance.shape[0], count = distance.shape[1];
    std::vector<double> mean(static_cast<std::size_t>(shots), INFINITE), share(mean.size());
    std::vector<double> sorted(static_cast<std::size_t>(count));
    double* const rays = sorted.data();
    for (Index n = 0; n < shots; ++n) {
        Index met = 0, best = 0, start = 0;
        for (Index k = 0; k < count; ++k) {
            const double far = distance(n, k);
            if (far < INFINITE) {
                Index j = met++;
                for (; j > 0 && rays[j - 1] > far; --j) {
                    rays[j] = rays[j - 1];
                }
                rays[j] = far;
            }
        }
        for (Index end = 1; end <= met; ++end) {
            if (end < met && !(rays[end] - rays[end - 1] > pulse)) {
                continue;
            }
            if (end - start > best) {
                best = end - start;
                double total = 0;
                for (Index k = start; k < end; ++k) {
                    total += rays[k];
                }
                mean[static_cast<std::size_t>(n)] = total / static_cast<double>(best);
            }
            start = end;
        }
        share[static_cast<std::size_t>(n)] = static_cast<double>(best) / static_cast<double>(count);
    }
    return {Owned<double>(std::move(mean)), Owned<double>(std::move(share))};
}

}  // namespace lidar
