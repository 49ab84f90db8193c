// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Where a surface begins: the points nearest to a robust plane. Textbook twin:
// test/naive/quadric.py.

#include <algorithm>
#include <cmath>
#include <limits>

#include "../../kernels/vectors.hpp"
#include "fits.hpp"
#include "ranks.hpp"
#include "surfaces.hpp"

namespace lidar {
namespace LEVEL {

namespace {

constexpr double SHARE = 0.3;  // of the points that are to lie near a plane that begins a surface
constexpr double BLUNT =
    0.01;  // of the least standard deviation: planes that near are equally good

// Measures the points left from the plane; the distance of each is in scratch.
void measure_sizes(Window& window, Index begin, Index end) {
    measure_heights(window.plane, window.some, begin, end, window.residual);
    const double* residual = window.residual;
    double* __restrict scratch = window.scratch;
    for (Index i = begin; i < end; ++i) {
        scratch[i] = std::abs(residual[i]);
    }
}

// Measures the points left from the plane; returns the distance of that rank.
double find_near(Window& window, Index left, Index rank) {
    measure_sizes(window, 0, left);
    return find_rank(window.scratch, left, rank, window.more_scratch);
}

// Remembers the plane if the point of that rank is nearer than the best; returns the better.
double compare(Window& window, Index left, Index rank, double floor, double best) {
    if (!is_plane(window, floor)) {
        return best;
    }
    measure_sizes(window, 0, left);
    Index nearer = 0;
    for (Index i = 0; i < left; ++i) {
        const double distance = window.scratch[i];
        window.scratch[nearer] = distance;
        nearer += distance < best ? 1 : 0;
    }
    if (nearer <= rank) {
        return best;
    }
    const double at_rank = find_rank(window.scratch, nearer, rank, window.more_scratch);
    const double near = std::max(at_rank, BLUNT * floor);
    if (near < best) {
        window.best = window.plane;
        return near;
    }
    return best;
}

// Copies the points left side by side.
void gather_left(Window& window) {
    Index count = 0;
    for (Index i = 0; i < window.n; ++i) {
        window.which[count] = i;
        window.some.x[count] = window.xyz.x[i];
        window.some.y[count] = window.xyz.y[i];
        window.some.z[count] = window.xyz.z[i];
        std::copy_n(window.xyz.quads + 4 * i, 4, window.some.quads + 4 * count);
        count += window.left[i];
    }
    std::fill(window.weight, window.weight + window.padded, 1.0);
}

}  // namespace

// Planes are suggested by all points left, and by runs of them without the worse half of each. The
// one that has a share of the points left nearest to it is fitted again to those.
bool begin_surface(Window& window, Index left, double floor, const Rules& rules) {
    std::copy(window.left, window.left + window.padded, window.kept);
    gather_left(window);
    if (rules.always) {
        return true;
    }
    const auto share = static_cast<Index>(std::ceil(SHARE * static_cast<double>(left)));
    const Index rank = std::min(left, std::max(MIN_POINTS, share)) - 1;
    fit_plane(window, window.some, 0, left);
    double best = compare(window, left, rank, floor, std::numeric_limits<double>::infinity());
    Plane planes[DOUBLES];
    const Index runs = (left + RUN / 2) / RUN;  // the last has at least half of the points
    for (Index run = 0; run < runs; ++run) {
        if (run % DOUBLES == 0) {
            fit_runs(window.some, run * RUN, left, planes);
        }
        window.plane = planes[run % DOUBLES];
        best = compare(window, left, rank, floor, best);
    }
    if (!(best < std::numeric_limits<double>::infinity())) {
        return false;
    }
    window.plane = window.best;
    for (int number = 0; number < CONCENTRATIONS; ++number) {
        const double reach = find_near(window, left, rank);
        for (Index i = 0; i < left; ++i) {
            window.weight[i] = std::abs(window.residual[i]) <= reach ? 1.0 : 0.0;
        }
        fit_plane(window, window.some, 0, left);
    }
    std::fill(window.kept, window.kept + window.padded, 0);
    for (Index i = 0; i < left; ++i) {
        window.kept[window.which[i]] = window.weight[i] > 0 ? 1 : 0;
    }
    return true;
}

}  // namespace LEVEL
}  // namespace lidar
