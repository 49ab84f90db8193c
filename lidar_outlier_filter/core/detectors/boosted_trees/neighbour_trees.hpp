// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls, to judge clouds without scan lines by the neighbours of each point.
#pragma once

#include <cstdint>

#include "../../kernels/array_view.hpp"
#include "../../kernels/levels.hpp"
#include "../../neighbours/floor.hpp"
#include "trees.hpp"

namespace lidar {

// N points in tree order, and their neighbours: `Near` of neighbour_features.py.
struct Near {
    View<const double, 2> xyz;          // (N, 3) metres
    View<const std::int32_t, 2> index;  // (N, 8) the nearest first
    View<const double> radius;          // (N,) distance to the eighth, metres
    Floor around;                       // what the whole cloud is like
    View<const bool> is_large;          // (N,) those that write_large_components() found
    bool is_sweep;                      // whether a sensor at the origin saw them
};

// `Far` of neighbour_features.py.
struct Far {
    Near near;
    View<const float> odds;             // (N,) log-odds by the first trees
    View<const std::int32_t, 2> index;  // (M, up to 60) neighbours of M points, the nearest first
};

FOR_EACH_LEVEL(
    // Writes which points of a sample lead to more than sixty others; `near` marks none yet.
    void write_large_components(Near near, Index begin, Index end, View<bool> is_large);

    // Writes log-odds of points `which` (M,), or of all if empty; if there is room, features.
    void judge_near(Near near, Trees trees, View<const Index> which, Index begin, Index end,
                    View<float> odds, View<float, 2> values);

    // Writes log-odds of points `which` (M,); where there is room, features.
    void judge_far(Far far, Trees trees, View<const Index> which, Index begin, Index end,
                   View<float> odds, View<float, 2> values);)

}  // namespace lidar
