// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Planes: the first of the models, see surfaces.dispatch.cpp.
//
// The normal of a plane is the axis of the least moment, which is the exact solution of (29).
// Textbook twin: test/naive/quadric.py.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "../../kernels/eigen.hpp"
#include "fits.hpp"

namespace lidar {
namespace LEVEL {

namespace {

typedef double Quad __attribute__((vector_size(32)));

}  // namespace

void set_axes(const double* values, const double (*vectors)[3], Plane& plane) {
    int least = 0;  // the first of those that tie
    for (int k = 1; k < 3; ++k) {
        least = values[k] < values[least] ? k : least;
    }
    int middle = (least + 1) % 3, largest = (least + 2) % 3;
    if (values[middle] > values[largest]) {
        std::swap(middle, largest);
    }
    const int order[3] = {least, middle, largest};
    for (int axis = 0; axis < 3; ++axis) {
        const int k = order[axis];
        plane.moments[axis] = std::max(values[k], 0.0);
        for (int j = 0; j < 3; ++j) {
            plane.axes[axis][j] = vectors[j][k];
        }
    }
}

// Fits the plane through points begin to end by their weights, at least one of them not 0.
void fit_plane(Window& window, const Coordinates& points, Index begin, Index end) {
    Plane& plane = window.plane;
    // Of p (x, y, z, 1) times 1, x, y and z, in the order of p * x * y.
    Quad sums{}, of_x{}, of_y{}, of_z{};
    for (Index i = begin; i < end; ++i) {
        Quad quad;
        std::memcpy(&quad, points.quads + 4 * i, sizeof quad);
        const Quad weighted = window.weight[i] * quad;
        sums += weighted;
        of_x += weighted[0] * quad;
        of_y += weighted[1] * quad;
        of_z += weighted[2] * quad;
    }
    const double total = sums[3], x = sums[0] / total, y = sums[1] / total, z = sums[2] / total;
    const double xx = of_x[0], xy = of_x[1], xz = of_x[2], yy = of_y[1], yz = of_y[2], zz = of_z[2];
    plane.mean[0] = x;
    plane.mean[1] = y;
    plane.mean[2] = z;
    plane.weight = total;
    double square[3][3] = {{xx - total * x * x, xy - total * x * y, xz - total * x * z},
                           {xy - total * x * y, yy - total * y * y, yz - total * y * z},
                           {xz - total * x * z, yz - total * y * z, zz - total * z * z}};
    double vectors[3][3];
    eigen(square, vectors, 3);
    const double values[3] = {square[0][0], square[1][1], square[2][2]};
    set_axes(values, vectors, plane);
}

// Tells a plane from a line: it is wider than the least standard deviation.
bool is_plane(const Window& window, double floor) {
    return window.plane.moments[MIDDLE] > floor * floor * window.plane.weight;
}

// Measures the residuals (29) of points begin to end from a plane: heights over it.
void measure_heights(const Plane& plane, const Coordinates& points, Index begin, Index end,
                     double* heights) {
    const double x = plane.axes[NORMAL][0], y = plane.axes[NORMAL][1], z = plane.axes[NORMAL][2];
    const double zero = x * plane.mean[0] + y * plane.mean[1] + z * plane.mean[2];
    const double *a = points.x, *b = points.y, *c = points.z;
    double* __restrict to = heights;
    for (Index i = begin; i < end; ++i) {
        to[i] = x * a[i] + y * b[i] + z * c[i] - zero;
    }
}

namespace {

// Measures all points against the plane: residual, variance, slope and lever.
//
// Height and tilts of the plane are uncorrelated in its own axes: Q is diagonal.
void measure_plane(Window& window) {
    const Plane plane = window.plane;
    measure_heights(plane, window.xyz, 0, window.padded, window.residual);
    const double level = 1 / plane.weight;
    const double* normal = plane.axes[NORMAL];
    const double squared =  // 1, rounded
        normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
    const double tilt_middle = 1 / plane.moments[MIDDLE], tilt_long = 1 / plane.moments[LONG];
    const double *middle = plane.axes[MIDDLE], *lengthwise = plane.axes[LONG];
    const double *xs = window.xyz.x, *ys = window.xyz.y, *zs = window.xyz.z;
    const double* variance = window.variance;
    double* __restrict lever = window.lever;
    double* __restrict sigma2 = window.sigma2;
    double* __restrict slope = window.slope;
    for (Index i = 0; i < window.padded; ++i) {
        const double x = xs[i] - plane.mean[0], y = ys[i] - plane.mean[1],
                     z = zs[i] - plane.mean[2];
        const double u = middle[0] * x + middle[1] * y + middle[2] * z;
        const double v = lengthwise[0] * x + lengthwise[1] * y + lengthwise[2] * z;
        lever[i] = level + u * u * tilt_middle + v * v * tilt_long;
        sigma2[i] = variance[i] * squared;
        slope[i] = 1.0;
    }
}

}  // namespace

// Fits the plane to the kept points; measures all points. False if they lie on a line.
bool adjust_plane(Window& window, double floor) {
    weigh(window, window.variance);
    fit_plane(window, window.xyz, 0, window.n);
    if (!is_plane(window, floor)) {
        return false;
    }
    measure_plane(window);
    return true;
}

}  // namespace LEVEL
}  // namespace lidar
