// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What is seen from the air, and what a receiver makes of it: see landscape.py, sensors.py.
#pragma once

#include <tuple>

#include "../../../lidar_outlier_filter/core/kernels/array_view.hpp"

namespace lidar {

struct Grids {  // heights at corners, metres, and of squares of corners
    View<const double, 2> ground, top;
    View<const Index, 2> owner;
    View<const double, 2> highest;
};

Owned<double> view_top(View<const double, 2> top, View<const Index, 2> owner, double cell,
                       View<const double> x, View<const double> y, View<Index> found);
Owned<double> descend(Grids fields, double cell, double side, View<const double, 2> origin,
                      View<const double, 2> direction, View<const double> depth, double bottom,
                      View<Index> found);
std::tuple<Owned<double>, Owned<double>> strongest(View<const double, 2> distance, double pulse);

}  // namespace lidar
