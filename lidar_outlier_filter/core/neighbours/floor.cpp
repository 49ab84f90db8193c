// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The floor of a whole cloud, see floor.py.

#include "floor.hpp"

#include "../kernels/select.hpp"

namespace lidar {

void check_floor(const Floor& around, Index points) {
    check(around.origin.size() == 2 && around.floor.shape[1] == 2 &&
              around.floor.size() == around.wide.size() && (around.wide.size() > 0 || points == 0),
          "a floor must have an origin (2,), and a row of floor for each of its columns");
}

std::tuple<Owned<Index>, Owned<double>> column_runs(View<const double, 2> xyz,
                                                    View<const double> origin, double side) {
    check(xyz.shape[1] == 3 && origin.size() == 2, "xyz must be (N, 3), and origin (2,)");
    std::vector<Index> column;
    std::vector<double> low;
    for (Index p = 0; p < xyz.size(); ++p) {
        const Index row = LEVEL::steps(xyz(p, 0) - origin[0], side);
        const Index number = row * LEVEL::ROW_STEP + LEVEL::steps(xyz(p, 1) - origin[1], side);
        if (column.empty() || column.back() != number) {
            column.push_back(number);
            low.push_back(xyz(p, 2));
        }
        low.back() = std::min(low.back(), xyz(p, 2));
    }
    return {Owned<Index>(std::move(column)), Owned<double>(std::move(low))};
}

// Writes the floors of wide columns, metres: the lower quartile of the lowest z of the WINDOW by
// WINDOW columns around, and the upper quartile less the lower one. `column` ascends.
void write_floor(View<const Index> wide, View<const Index> column, View<const double> lowest,
                 Index begin, Index end, View<double, 2> floor) {
    using LEVEL::ROW_STEP, LEVEL::WIDER, LEVEL::WINDOW;
    check(column.size() == lowest.size() && floor.size() == wide.size() && floor.shape[1] == 2,
          "each column must have a lowest point, and each wide one a row of floor (C, 2)");
    check_range(begin, end, wide.size());
    constexpr Index MOST = 1U << 31U;  // farther columns are none, see FARTHEST
    const Index* const last = column.data + column.size();
    for (Index n = begin; n < end; ++n) {
        double lows[WINDOW * WINDOW];
        check(
            0 <= wide[n] && wide[n] / ROW_STEP < MOST / WIDER && wide[n] % ROW_STEP < MOST / WIDER,
            "wide columns must be numbers of columns");
        const Index first = (wide[n] / ROW_STEP - 1) * WIDER,
                    left = (wide[n] % ROW_STEP - 1) * WIDER;
        Index count = 0;
        for (Index row = std::max<Index>(first, 0); row < first + WINDOW; ++row) {
            const Index* at =
                std::lower_bound(column.data, last, row * ROW_STEP + std::max<Index>(left, 0));
            for (; at < last && *at < row * ROW_STEP + left + WINDOW; ++at) {
                check(count < WINDOW * WINDOW, "columns must ascend");
                lows[count] = lowest[at - column.data];
                ++count;
            }
        }
        check(count > 0, "a wide column must have a column");
        const double low = LEVEL::select(lows, count, (count - 1) / 4);
        floor(n, 0) = low;
        floor(n, 1) = LEVEL::select(lows, count, 3 * (count - 1) / 4) - low;
    }
}

Index count_low(Floor around, View<const double, 2> xyz) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    check_floor(around, xyz.size());
    Index count = 0;
    for (Index p = 0; p < xyz.size(); ++p) {
        const LEVEL::Level there = LEVEL::floor_at(around, xyz(p, 0), xyz(p, 1));
        const double steep = LEVEL::STEEP * (there.spread + around.side);
        count += there.low - xyz(p, 2) > std::max(LEVEL::DEEP * around.side, steep) ? 1 : 0;
    }
    return count;
}

}  // namespace lidar
