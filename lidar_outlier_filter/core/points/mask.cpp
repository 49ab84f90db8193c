// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The cells of a mask, see mask.py. Twin: test/naive/mask.py.

#include <cmath>

#include "points.hpp"

namespace lidar {
namespace {

constexpr double TURN = 2 * 3.141592653589793;

// Returns the column of a point, of so many in a turn; 0 of NaN.
Index column_of(const double* p, Index columns) {
    const double azimuth = (std::atan2(p[1], p[0]) / TURN) * static_cast<double>(columns);
    if (!(std::abs(azimuth) <= static_cast<double>(columns))) {
        return 0;
    }
    const Index column = static_cast<Index>(std::floor(azimuth)) % columns;
    return column < 0 ? column + columns : column;
}

double range_of(const double* p) {
    return std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
}

}  // namespace

// Marks the valid points that are on the vehicle: within the ranges of their cell, (rings,
// columns).
void find_masked(View<const double, 2> xyz, View<const Index> line, View<const bool> valid,
                 View<const double, 2> near, View<const double, 2> far, double tolerance,
                 View<bool> result) {
    const Index points = line.size(), columns = near.shape[1];
    check(xyz.size() == points && xyz.shape[1] == 3, "xyz must be (N, 3)");
    check(valid.size() == points && result.size() == points, "valid and result must be (N,)");
    check(near.shape == far.shape && columns > 0, "near and far must have the same cells");
    for (Index i = 0; i < points; ++i) {
        result[i] = false;
        if (valid[i] && 0 <= line[i] && line[i] < near.size()) {
            const Index column = column_of(xyz.row(i), columns);
            const double distance = range_of(xyz.row(i));
            const double low = near(line[i], column) - tolerance;
            const double high = far(line[i], column) + tolerance;
            result[i] = low <= distance && distance <= high;
        }
    }
}

// Writes the column of each point, of so many in a turn, and its range, metres.
void find_columns(View<const double, 2> xyz, Index columns, View<Index> column,
                  View<double> distance) {
    check(xyz.shape[1] == 3 && columns > 0, "xyz must be (N, 3), in at least one column");
    check(column.size() == xyz.size() && distance.size() == xyz.size(),
          "column and distance must be (N,)");
    for (Index i = 0; i < xyz.size(); ++i) {
        column[i] = column_of(xyz.row(i), columns);
        distance[i] = range_of(xyz.row(i));
    }
}

}  // namespace lidar
