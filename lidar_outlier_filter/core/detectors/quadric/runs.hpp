// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Planes through runs of points, several runs side by side: each gets the same bits as by itself.
#pragma once

#include "../../kernels/vectors.hpp"
#include "window.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr Index RUN = 16;  // points that follow each other in the window: a plane of its own

// Fits planes to up to DOUBLES runs of `left` points, the first of them at `begin`: each to its
// half that agrees best with a plane through the whole run.
void fit_runs(const Coordinates& points, Index begin, Index left, Plane* planes);

}  // namespace LEVEL
}  // namespace lidar
