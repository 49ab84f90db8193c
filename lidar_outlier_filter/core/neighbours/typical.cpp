// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Samples of positions, see typical.py.

#include "typical.hpp"

#include "neighbours.hpp"

namespace lidar {

Owned<Index> numbers(View<const double, 2> xyz) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    std::vector<Index> result(static_cast<std::size_t>(xyz.size()));
    for (Index i = 0; i < xyz.size(); ++i) {
        result[static_cast<std::size_t>(i)] = LEVEL::number(xyz.row(i));
    }
    return Owned<Index>(std::move(result));
}

}  // namespace lidar
