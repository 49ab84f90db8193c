// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Eigenvalues and eigenvectors of symmetric 3 x 3 matrices side by side.
//
// Elements of a matrix are xx, yy, zz, xy, xz, yz. Twin: numpy.linalg.eigh, in
// test/naive/survey.py.
#pragma once

#include <algorithm>
#include <cmath>

#include "levels.hpp"
#include "vectors.hpp"

namespace lidar {
namespace LEVEL {

// Writes the eigenvalues, ascending (Smith 1961).
inline void eigenvalues(const Doubles (&moment)[6], Doubles (&value)[3]) {
    const Doubles xx = moment[0], yy = moment[1], zz = moment[2];
    const Doubles xy = moment[3], xz = moment[4], yz = moment[5];
    const Doubles mean = (xx + yy + zz) / 3.0;
    Doubles a = xx - mean, b = yy - mean, c = zz - mean;
    const Doubles s = root((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0);
    a = a / s, b = b / s, c = c / s;
    const Doubles d = xy / s, e = xz / s, f = yz / s;
    const Doubles half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2.0;
    constexpr double THIRD = 2 * 3.141592653589793 / 3;  // of a turn
    Doubles least_cosine, most_cosine;
    for (int i = 0; i < DOUBLES; ++i) {  // one by one, because there are no such functions of many
        const double angle = std::acos(std::min(std::max(half[i], -1.0), 1.0)) / 3;
        least_cosine[i] = std::cos(angle + THIRD);
        most_cosine[i] = std::cos(angle);
    }
    const Doubles high = mean + 2.0 * s * most_cosine, low = mean + 2.0 * s * least_cosine;
    const Wides equal = s == 0.0;
    value[0] = choose(equal, mean, low);
    value[1] = choose(equal, mean, 3.0 * mean - low - high);
    value[2] = choose(equal, mean, high);
}

struct LongVector {
    Doubles x, y, z, square;  // its squared length
};

[[gnu::always_inline]] inline void keep_longer(Doubles x, Doubles y, Doubles z, LongVector& best) {
    const Doubles square = x * x + y * y + z * z;
    const Wides longer = square > best.square;
    best.x = choose(longer, x, best.x);
    best.y = choose(longer, y, best.y);
    best.z = choose(longer, z, best.z);
    best.square = choose(longer, square, best.square);
}

// Writes a unit eigenvector each: the longest cross product of two rows of matrix - eigenvalue.
//
// That of the lowest eigenvalue; but of the highest, where the middle one is not greater than
// `narrow` times that. 0 0 1 where all are equal.
inline void eigenvectors(const Doubles (&moment)[6], const Doubles (&value)[3], double narrow,
                         Doubles (&vector)[3]) {
    const Doubles of = choose(value[1] > narrow * value[2], value[0], value[2]);
    const Doubles xy = moment[3], xz = moment[4], yz = moment[5];
    const Doubles a = moment[0] - of, b = moment[1] - of, c = moment[2] - of;
    LongVector best{repeat(0.0), repeat(0.0), repeat(1.0), repeat(0.0)};
    keep_longer(xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy, best);
    keep_longer(xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz, best);
    keep_longer(b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz, best);
    const Doubles length = choose(best.square != 0.0, root(best.square), repeat(1.0));
    vector[0] = best.x / length;
    vector[1] = best.y / length;
    vector[2] = best.z / length;
}

}  // namespace LEVEL
}  // namespace lidar
