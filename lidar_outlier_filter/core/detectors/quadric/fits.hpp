// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Fits to windows of points, and what is measured against them.
#pragma once

#include "window.hpp"

namespace lidar {
namespace LEVEL {

struct Squares {  // sums of the squares of the residuals over σ²; NaN: parameters are ambiguous
    double before, after;
};

// Takes the axes of a plane, by their moments, from eigenvalues and eigenvectors (columns).
void set_axes(const double* values, const double (*vectors)[3], Plane& plane);

// Planes; the points are those from begin to end.
void fit_plane(Window& window, const Coordinates& points, Index begin, Index end);
bool is_plane(const Window& window, double floor);
bool adjust_plane(Window& window, double floor);
void measure_heights(const Plane& plane, const Coordinates& points, Index begin, Index end,
                     double* heights);

// Paraboloids and quadrics; SIZE is one of PARABOLOID and QUADRIC.
void fill_rows(Window& window);
void weigh(Window& window, const double* variance);
template <int SIZE>
void sum_normal(Window& window);
template <int SIZE>
Squares step(Window& window);
template <int SIZE>
void normalize(Window& window);
template <int SIZE>
void measure_residuals(Window& window);
template <int SIZE>
void measure_distances(Window& window);
template <int SIZE>
bool adjust(Window& window);

inline constexpr Index RUN = 16;  // points that follow each other in the window: a plane of its own

// Fits planes to up to DOUBLES runs of `left` points, the first of them at `begin`: each to its
// half that agrees best with a plane through the whole run.
void fit_runs(const Coordinates& points, Index begin, Index left, Plane* planes);

}  // namespace LEVEL
}  // namespace lidar
