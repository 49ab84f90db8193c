// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Where rays meet surfaces; each surface is one row of numbers.
//
// A row holds the shape's code, the low and the high corner of a box around it, the velocity with
// which all of it moves, and from REST on what its shape needs: see the functions meet_... A ray
// has an origin, a direction of length one and a time. The result is the distance (inf: missed),
// the cosine of incidence and the part that was met: 0 to 2, a face that is normal to this axis;
// ROUND, any other; PANE more for the pane of a window.
#pragma once

#include <tuple>

#include "../../../lidar_outlier_filter/core/kernels/array_view.hpp"
#include "../../../lidar_outlier_filter/core/kernels/levels.hpp"

namespace lidar {
namespace LEVEL {

enum Shape : int { GROUND, BOX, BUILDING, TUBE, ARM, BALL, LID, CROWN };
inline constexpr Index LOW = 1, HIGH = 4, VELOCITY = 7, REST = 10, WIDTH = 24;  // of a row
inline constexpr Index ROUND = 3, PANE = 4;                                     // parts

}  // namespace LEVEL

// Finds the nearest surface on every ray.
//
// `table` (S, WIDTH), of equally near surfaces the first counts; `origin`, `direction` (3, N, K) of
// N bundles of K rays; `t` (N,) seconds, for what moves; `reach` metres within which the rays of a
// bundle stay of its first. Returns distance, cosine, surface, part: (N, K); surface is the row, -1
// where nothing was met.
std::tuple<Owned<double, 2>, Owned<double, 2>, Owned<Index, 2>, Owned<Index, 2>> cast_rays(
    View<const double, 2> table, View<const double, 3> origin, View<const double, 3> direction,
    View<const double> t, double reach);

}  // namespace lidar
