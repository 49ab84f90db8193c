// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Surfaces of a window: where they begin, how they grow, and what they say of its points.
#pragma once

#include "window.hpp"

namespace lidar {
namespace LEVEL {

// A surface that has grown; the test of all points under it is in the window.
struct FittedSurface {
    int size;          // parameters of its model; 0: no surface
    Index support;     // points in the fit
    double deviation;  // standard deviation of their distances, in the scale of the window
};

inline constexpr FittedSurface NONE = {0, 0, 0.0};

// What holds the growth of a surface, in the scale of the window.
struct Growth {
    double floor;   // least standard deviation of a residual
    double noise;   // standard deviation of the first surface, which holds another; inf: free
    Index freedom;  // its degrees of freedom; 0: free
};

inline constexpr int CONCENTRATIONS = 2;  // refits to the half, or the share, that agrees best

// Chooses the points a surface begins with, of those `left`: kept. False: there is no plane.
bool begin_surface(Window& window, Index left, double floor, const Rules& rules);

// Grows a surface from the kept points, and raises its model as far as that pays.
FittedSurface grow(Window& window, const Rules& rules, const Growth& growth);

// Tests all points: T (31) ÷ its critical value. False if there are too few to decide.
bool measure_tests(Window& window, int size, const Rules& rules, const Growth& growth);

// Describes the surface that was fitted last, by the points kept.
FittedSurface describe(const Window& window, int size);

// Returns whether three more parameters lessen a sum of squares significantly (F test).
bool is_better(double before, double after, Index freedom, const Rules& rules);

// Returns whether a paraboloid fits the kept points significantly better than the plane.
bool is_bent(Window& window, const Rules& rules);

// Returns whether (20) approximates a quadric at three of four kept points.
bool is_flat(const Window& window);

// Judges the first n points of a window; coordinates are metres, and lost.
void judge(Window& window, Index n, const Rules& rules);

[[gnu::always_inline]] inline Index count_kept(const Window& window) {
    Index count = 0;
    for (Index i = 0; i < window.padded; ++i) {
        count += window.kept[i];
    }
    return count;
}

}  // namespace LEVEL
}  // namespace lidar
