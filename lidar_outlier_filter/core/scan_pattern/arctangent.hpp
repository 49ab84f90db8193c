// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Angles of directions, the same on every machine: no processor's own function, whose results
// differ.
#pragma once

#include <algorithm>
#include <cmath>
#include <iterator>

#include "../kernels/levels.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr double PI = 3.14159265358979323846;
inline constexpr double TURN = 2.0 * PI;
// atan(x) / x in x^2, up to 1, within 1e-9.
inline constexpr double ATAN[] = {
    0.9999999995535,  -0.3333332248889,   0.1999955809988,   -0.1427857601947,
    0.1105077124416,  -0.08785043170557,  0.06685281272741,  -0.04392840736215,
    0.02191294303868, -0.007030668149872, 0.001057607174682,
};

// Returns the angle of (x, y), -pi to pi, within 1e-6.
[[gnu::always_inline]] inline double arctangent(double y, double x) {
    const double a = std::abs(x), b = std::abs(y);
    const double high = std::max(a, b), low = std::min(a, b);
    const double share = high > 0 ? low / high : 0.0;
    const double square = share * share;
    double total = ATAN[std::size(ATAN) - 1];
#pragma GCC unroll 16
    for (int m = static_cast<int>(std::size(ATAN)) - 2; m >= 0; --m) {
        total = total * square + ATAN[m];
    }
    double angle = total * share;
    angle = b > a ? PI / 2.0 - angle : angle;
    angle = x < 0 ? PI - angle : angle;
    return y < 0 ? -angle : angle;
}

}  // namespace LEVEL
}  // namespace lidar
