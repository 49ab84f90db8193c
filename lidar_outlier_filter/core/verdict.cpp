// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Scores that are added to a verdict, see verdict.py.

#include <algorithm>
#include <cmath>

#include "points/points.hpp"

namespace lidar {

// Adds the scores of one detector for the points `where`; NaN means undecided.
void add_scores(std::uint16_t bit, View<const Index> where, View<const double> score,
                View<float> largest, View<std::uint16_t> detectors, View<std::uint16_t> undecided) {
    check(score.size() == where.size(), "there must be as many scores as points");
    check(detectors.size() == largest.size() && undecided.size() == largest.size(),
          "largest, detectors and undecided must be as long");
    check_indices(where, largest.size());
    // Rounding to float32 must not turn a rejected point into a kept one.
    const float above_one = std::nextafter(1.0F, 2.0F);
    for (Index i = 0; i < where.size(); ++i) {
        // Without branches on the scores, which a processor could not predict.
        const Index k = where[i];
        const double value = score[i];
        // Beyond float32 it is inf, which is as good.
        auto rounded = static_cast<float>(value);
        rounded = value > 1 ? std::max(rounded, above_one) : rounded;
        undecided[k] |= std::isnan(value) ? bit : 0;
        detectors[k] |= value > 1 ? bit : 0;
        // A comparison with NaN is false: the NaN of untested points is overwritten.
        largest[k] = std::isnan(value) || largest[k] >= rounded ? largest[k] : rounded;
    }
}

}  // namespace lidar
