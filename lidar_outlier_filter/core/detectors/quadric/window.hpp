// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// A window of points, and room to work on it: see fits.dispatch.cpp and surfaces.dispatch.cpp.
#pragma once

#include <vector>

#include "../../kernels/array_view.hpp"
#include "../../kernels/levels.hpp"
#include "quadric.hpp"

namespace lidar {
namespace LEVEL {

// Parameters, one of which the norm takes away.
inline constexpr int PLANE = 4, PARABOLOID = 7, QUADRIC = 10;
inline constexpr int ROW = 16;    // elements of a row of a matrix: whole registers of any level
inline constexpr Index PACK = 8;  // points come in so many: whole registers, too
inline constexpr int NORMAL = 0, MIDDLE = 1, LONG = 2;  // axes of a plane, by their moments

using Flag = std::int64_t;  // 0 or 1: as wide as the numbers beside it, for the registers

struct Plane {
    double axes[3][3];  // normal, axis of the middle moment, and of the largest
    double mean[3], moments[3], weight;
};

[[gnu::always_inline]] inline Index round_up(Index points) {
    return (points + PACK - 1) / PACK * PACK;
}

struct Coordinates {  // coordinates, metres or in the scale of the window
    double *x, *y, *z;
    double* quads;  // the same point by point: x, y, z, 1
};

// Of up to `room` points; only the first n count. Behind them, up to `padded`, are copies that are
// in no fit, so that loops over points can do whole registers.
struct Window {
    Index n = 0, padded = 0;
    Coordinates xyz{};      // of the frame of the cloud, until judge() scales them
    Coordinates local{};    // in the frame of the plane: along LONG, MIDDLE, NORMAL
    Coordinates some{};     // the points on no surface so far
    double* rows;           // (n, ROW) B (23) in the frame of the plane, and zeros
    double* variance;       // of any coordinate of each point; only their ratios count
    double* saved_test[2];  // test of the plane, and of the paraboloid
    double* residual;       // v (29)
    double* sigma2;         // σ² (30)
    double* slope;          // the length of the gradient (25)-(27)
    double* lever;          // B Q Bᵀ
    double* weight;         // in the next fit
    double* test;           // T ÷ its critical value under the last surface
    double* score;          // the least of all surfaces
    double *scratch, *more_scratch;
    Flag* saved_kept[2];        // kept of the plane, and of the paraboloid
    Flag* left;                 // on no surface so far
    Flag* kept;                 // in the fit
    Flag* next;                 // in the next one
    Flag* start;                // in the first fit of a surface
    Flag* which;                // indices of some of the points
    Plane plane, best;          // the best one to begin with
    double a[ROW];              // parameters
    double step[ROW];           // what (29) is to change of them
    double normal[ROW][ROW];    // Bᵀ P B
    double cofactor[ROW][ROW];  // Q of the parameters
    double square[ROW][ROW], other[ROW][ROW];

    explicit Window(Index most) {
        const Index room = round_up(most);
        numbers_.resize(static_cast<std::size_t>(room * NUMBERS));
        flags_.resize(static_cast<std::size_t>(room * FLAGS));
        double* number = numbers_.data();
        const auto some_numbers = [&](Index columns) {
            number += room * columns;
            return number - room * columns;
        };
        rows = some_numbers(ROW);
        for (Coordinates* points : {&xyz, &local, &some}) {
            *points = {some_numbers(1), some_numbers(1), some_numbers(1), some_numbers(4)};
        }
        for (double** each : {&variance, saved_test, saved_test + 1, &residual, &sigma2, &slope,
                              &lever, &weight, &test, &score, &scratch, &more_scratch}) {
            *each = some_numbers(1);
        }
        Flag* flag = flags_.data();
        for (Flag** each : {saved_kept, saved_kept + 1, &left, &kept, &next, &start, &which}) {
            *each = flag;
            flag += room;
        }
    }
    Window(const Window&) = delete;
    Window& operator=(const Window&) = delete;

private:
    static constexpr Index NUMBERS = ROW + 3 * 7 + 12, FLAGS = 7;  // a point has
    std::vector<double> numbers_;
    std::vector<Flag> flags_;
};

}  // namespace LEVEL
}  // namespace lidar
