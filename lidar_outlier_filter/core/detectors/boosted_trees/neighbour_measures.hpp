// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What is measured alike among eight and among sixty neighbours.
#pragma once

#include <limits>

#include "neighbour_features.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr double INFINITE = std::numeric_limits<double>::infinity();

// Network that sorts so many rows.
template <int ROWS>
inline constexpr Network SORT = make_network(ROWS, 0, ROWS);

// Writes where the neighbours of p are, and their distances to their own eighth.
template <int ROWS>
inline void gather(const Near& near, Index p, const std::int32_t* index, Index count, int lane,
                   Others<ROWS>& others) {
    const double* const own = near.xyz.row(p);
    for (Index m = 0; m < count; ++m) {
        const double* const other = near.xyz.row(index[m]);
        others.x[m][lane] = other[0] - own[0];
        others.y[m][lane] = other[1] - own[1];
        others.z[m][lane] = other[2] - own[2];
        others.radii[m][lane] = near.radius[index[m]];
    }
}

template <int ROWS>
inline void measure(Others<ROWS>& others, Index count) {
    for (Index m = 0; m < count; ++m) {
        const Doubles x = others.x[m], y = others.y[m], z = others.z[m];
        others.distance[m] = root((x * x + y * y) + z * z);
    }
}

// Copies so many rows, in ascending order; those behind them are infinite.
template <int ROWS>
inline void copy_sorted(const Doubles* rows, Index count, Doubles (&sorted)[ROWS]) {
    for (Index m = 0; m < ROWS; ++m) {
        sorted[m] = m < count ? rows[m] + 0.0 : repeat(INFINITE);  // 0 and -0 are one height
    }
    sort(sorted, SORT<ROWS>);
}

// Finds the plane through the first `count` neighbours.
template <int ROWS>
inline Planes find_plane(const Others<ROWS>& others, Index count) {
    const double number = static_cast<double>(count);
    Doubles x{}, y{}, z{};
    for (Index m = 0; m < count; ++m) {
        x += others.x[m];
        y += others.y[m];
        z += others.z[m];
    }
    x = x / number, y = y / number, z = z / number;
    Doubles xx{}, yy{}, zz{}, xy{}, xz{}, yz{};
    for (Index m = 0; m < count; ++m) {
        const Doubles a = others.x[m] - x, b = others.y[m] - y, c = others.z[m] - z;
        xx += a * a;
        yy += b * b;
        zz += c * c;
        xy += a * b;
        xz += a * c;
        yz += b * c;
    }
    Planes plane{{x, y, z},
                 {xx / number, yy / number, zz / number, xy / number, xz / number, yz / number},
                 {},
                 {}};
    eigenvalues(plane.moment, plane.value);
    eigenvectors(plane.moment, plane.value, NARROW, plane.vector);
    return plane;
}

// Writes how far a point and its neighbours (rms) are from their plane, or line: three rows.
inline void write_off(const Planes& plane, Doubles s, int row, NeighbourFeatures values) {
    const Doubles x = plane.mean[0], y = plane.mean[1], z = plane.mean[2];
    const Doubles along = x * plane.vector[0] + y * plane.vector[1] + z * plane.vector[2];
    const Doubles nothing = repeat(0.0);
    const Doubles across = root(most(x * x + y * y + z * z - along * along, nothing));
    const Wides planar = plane.value[1] > NARROW * plane.value[2];
    const Doubles off = choose(planar, size_of(along), across);
    const Doubles both = plane.value[0] + plane.value[1];
    const Doubles flat = root(most(choose(planar, plane.value[0], both), nothing));
    values.write(row, off / s);
    values.write(row + 1, flat / s);
    values.write(row + 2, off / (flat + SMOOTH * s));
}

// Writes how far points are below and above the first `count` neighbours, in two rows each.
template <int ROWS>
inline void write_heights(const Doubles* z, Index count, Doubles s, int below, int sunk,
                          NeighbourFeatures values) {
    Doubles sorted[ROWS];
    copy_sorted(z, count, sorted);
    const Index quarter = count / 4;
    const Doubles low = sorted[0], high = sorted[count - 1];
    const Doubles next_low = sorted[quarter], next_high = sorted[count - 1 - quarter];
    values.write(below, low / s);
    values.write(below + 1, -high / s);
    values.write(sunk, low / (next_low - low + EVEN_HEIGHTS * s));
    values.write(sunk + 1, -high / (high - next_high + EVEN_HEIGHTS * s));
}

}  // namespace LEVEL
}  // namespace lidar
