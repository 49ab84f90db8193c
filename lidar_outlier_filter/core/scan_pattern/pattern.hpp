// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// A scan pattern as kernels see it: `Pattern` of placed_pattern.py says what its arrays are.
#pragma once

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {

struct Pattern {
    View<const Index> order;
    View<const Index, 2> copies;
    View<const Index> first, last;
    View<const float> x, y, z, range;
    View<const double> phase;
    View<const float, 2> bright;
    View<const float> step, gap, turn;
    View<const float, 2> beside;
    View<const float> uneven, noise, apart, level;
};

}  // namespace lidar
