// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The floor of a whole cloud, see floor.py: the lowest points of columns around a place.
#pragma once

#include <algorithm>
#include <tuple>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {

struct Floor {
    double typical;               // distance of its points, metres
    View<const double> origin;    // (2,) the least x and y, metres
    double side;                  // of a column, metres
    View<const Index> wide;       // (C,) wide columns that hold points, ascending
    View<const double, 2> floor;  // (C, 2) the floor of each; its upper quartile less the lower
};

// Refuses a floor whose arrays do not fit together, or that has no column though there are points.
void check_floor(const Floor& around, Index points);

// Returns the columns of points, and the lowest z of those in one column that come together.
std::tuple<Owned<Index>, Owned<double>> column_runs(View<const double, 2> xyz,
                                                    View<const double> origin, double side);
void write_floor(View<const Index> wide, View<const Index> column, View<const double> lowest,
                 Index begin, Index end, View<double, 2> floor);
Index count_low(Floor around, View<const double, 2> xyz);

namespace LEVEL {

inline constexpr Index WIDER = 5;  // columns to the side of a wide one
inline constexpr Index WINDOW = 3 * WIDER;
inline constexpr double FARTHEST = 1U << 30U;  // columns from the first: those beyond are one
inline constexpr Index ROW_STEP = Index{1}
                                  << 32U;       // a column: row * ROW_STEP + number within the row
inline constexpr double DEEP = 4, STEEP = 0.5;  // features from which on a point counts as low

struct Level {
    double low, spread;  // metres
};

// Returns how many columns fit into a length; none into NaN.
inline Index steps(double along, double side) {
    return static_cast<Index>(std::min(std::max(0.0, along / side), FARTHEST));
}

// Returns the floor around a place, and how far apart the quartiles are there.
inline Level floor_at(const Floor& around, double x, double y) {
    const Index i = steps(x - around.origin[0], around.side);
    const Index j = steps(y - around.origin[1], around.side);
    const Index* const begin = around.wide.data;
    const Index* const end = begin + around.wide.size();
    const Index column = i / WIDER * ROW_STEP + j / WIDER;
    const Index place = std::min(std::lower_bound(begin, end, column) - begin, end - begin - 1);
    return {around.floor(place, 0), around.floor(place, 1)};
}

// Writes the features `deep` and `deep_steep` of a point, in rows `lanes` apart.
inline void write_depth(const Floor& around, double x, double y, double z, Index lanes,
                        float* values) {
    const Level there = floor_at(around, x, y);
    values[0] = static_cast<float>((there.low - z) / around.side);
    values[lanes] = static_cast<float>((there.low - z) / (there.spread + around.side));
}

}  // namespace LEVEL
}  // namespace lidar
