// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Elevations of points, and how near they lie together, see recovered_rings.py.
//
// Textbook twin: test/naive/recovered_rings.py.

#include <algorithm>
#include <cmath>

#include "arctangent.hpp"
#include "scan_pattern.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr double SECOND = 1e9;        // ns
constexpr Index RANKS_ON = 4;         // positions on in the order of elevations: copies share one
constexpr double MIN_GAP_RAD = 2e-5;  // rad that is added to a distance: copies have none

std::vector<double> find_elevations(View<const double> flat, View<const double> z, double up,
                                    double out) {
    check(flat.size() == z.size(), "distances must be as many as heights");
    std::vector<double> elevation(static_cast<std::size_t>(z.size()));
    double* const result = elevation.data();
    for (Index i = 0; i < z.size(); ++i) {
        result[i] = arctangent(z[i] - up, flat[i] - out);
    }
    return elevation;
}

}  // namespace

// Returns the mean base-2 logarithm of the gaps between elevations seen from a position.
//
// `flat` and `z` (N,) are distances from the axis, and heights; `up` and `out` the position,
// metres.
double spread(View<const double> flat, View<const double> z, double up, double out) {
    auto elevation = find_elevations(flat, z, up, out);
    const auto numbers = std::partition(elevation.begin(), elevation.end(),
                                        [](double value) { return !std::isnan(value); });
    std::sort(elevation.begin(), numbers);
    const Index gaps = z.size() - RANKS_ON;
    double total = 0;
    for (Index i = 0; i < gaps; ++i) {
        // Straight lines between powers of two: no processor's own logarithm.
        const double* const here = elevation.data() + i;
        int power = 0;
        const double part = std::frexp(here[RANKS_ON] - here[0] + MIN_GAP_RAD, &power);
        total += power + 2.0 * (part - 1.0);
    }
    return total / static_cast<double>(std::max<Index>(gaps, 1));
}

// Returns the elevation of each point from where beams leave, rad.
Owned<double> elevations(View<const double> flat, View<const double> z, double up, double out) {
    return Owned<double>(find_elevations(flat, z, up, out));
}

// Returns when a steadily turning head points at each point, nanoseconds; it turns in a second.
Owned<Index> times_of_turn(View<const double, 2> xyz) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    std::vector<Index> t(static_cast<std::size_t>(xyz.size()));
    for (Index i = 0; i < xyz.size(); ++i) {
        const double turned = arctangent(xyz(i, 1), xyz(i, 0)) / TURN + 0.5;
        t[static_cast<std::size_t>(i)] = static_cast<Index>(std::rint(turned * SECOND));
    }
    return Owned<Index>(std::move(t));
}

}  // namespace LEVEL
}  // namespace lidar
