// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Fits of paraboloids and quadrics to the points of a window, (18)-(30) of the paper.
//
// They and the plane are one model with 4, 7 or 10 of the parameters of (18), nested: the columns
// of B (23) are 1, x, y, z, then x², xy, y², then xz, yz, z², where z is the normal of a plane
// through the points (a paraboloid stands on it). Products of two coordinates are multiplied by √2,
// so that the norm (19) is the same whichever way the axes point; a4, a5 and a6 of (18) are √2
// times the ones here. Textbook twin: test/naive/quadric.py.

#include "fits.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "../../kernels/vectors.hpp"

namespace lidar {
namespace LEVEL {

namespace {

constexpr double ROOT2 = 1.4142135623730951;
constexpr double MIN_VARIANCE = 0.01;  // of the mean of all: near an edge the gradient vanishes
constexpr double SINGULAR = 1e-12;  // a pivot below this part of the matrix: ambiguous parameters
constexpr int ADJUSTMENTS = 10;
constexpr double CONVERGED = 1e-6;  // largest change of a parameter

// Returns how many registers hold the first elements of a row.
constexpr int registers(int elements) {
    return static_cast<int>((elements + DOUBLES - 1) / DOUBLES);
}

// Adds a multiple of a row to another one: of the first SIZE elements, and what is beside them.
template <int SIZE>
[[gnu::always_inline]] inline void add_row(double* target, double factor, const double* source) {
    for (int k = 0; k < registers(SIZE); ++k) {
        store(target + k * DOUBLES,
              load(target + k * DOUBLES) + factor * load(source + k * DOUBLES));
    }
}

// Turns the unit matrix `inverse` into that of `square`, by Gauss and Jordan.
//
// False if a pivot is not larger than the least.
template <int SIZE>
bool eliminate(double (*__restrict square)[ROW], double (*__restrict inverse)[ROW], double least) {
    for (int i = 0; i < SIZE; ++i) {
        int pivot = i;
        double most = std::abs(square[i][i]);
        for (int j = i + 1; j < SIZE; ++j) {
            if (std::abs(square[j][i]) > most) {
                pivot = j;
                most = std::abs(square[j][i]);
            }
        }
        if (!(most > least)) {
            return false;
        }
        if (pivot != i) {
            for (int k = 0; k < ROW; ++k) {
                std::swap(square[i][k], square[pivot][k]);
                std::swap(inverse[i][k], inverse[pivot][k]);
            }
        }
        const double factor = 1 / square[i][i];
        for (int k = 0; k < ROW; ++k) {
            square[i][k] *= factor;
            inverse[i][k] *= factor;
        }
        for (int j = 0; j < SIZE; ++j) {
            if (j != i) {
                const double times = -square[j][i];
                add_row<SIZE>(square[j], times, square[i]);
                add_row<SIZE>(inverse[j], times, inverse[i]);
            }
        }
    }
    return true;
}

// Finds Q: the inverse of the normal matrix bordered by a, without the border.
//
// That is the cofactor matrix of the parameters under aᵀ δa = 0. False if the parameters are
// ambiguous: the points lie on more than one such surface.
template <int SIZE>
bool invert_bordered(Window& window) {
    double(*square)[ROW] = window.square;
    double(*inverse)[ROW] = window.other;
    double largest = 0;
    for (int i = 0; i < SIZE; ++i) {
        largest = std::max(largest, window.normal[i][i]);
    }
    for (int i = 0; i <= SIZE; ++i) {
        for (int j = 0; j < ROW; ++j) {
            square[i][j] = i < SIZE && j < SIZE ? window.normal[i][j] : 0.0;
            inverse[i][j] = i == j ? 1.0 : 0.0;
        }
    }
    for (int i = 0; i < SIZE; ++i) {
        // The border is as large as the rest: the choice of pivots shall not depend on weights.
        square[i][SIZE] = square[SIZE][i] = window.a[i] * largest;
    }
    if (!eliminate<SIZE + 1>(square, inverse, SINGULAR * largest)) {
        return false;
    }
    for (int i = 0; i < SIZE; ++i) {
        for (int j = 0; j < SIZE; ++j) {
            window.cofactor[i][j] = (inverse[i][j] + inverse[j][i]) / 2;
        }
    }
    return true;
}

// Measures the gradient (25)-(27) of all points: its square, and the variance (30).
//
// Where two sheets of a quadric meet, the gradient and the variance vanish. The variance is at
// least 1 % of the mean of the kept points; else these points would decide all.
void measure_gradient(Window& window) {
    double a[ROW];
    std::copy(window.a, window.a + ROW, a);
    const Plane plane = window.plane;
    const double *xs = window.local.x, *ys = window.local.y, *zs = window.local.z;
    const double* variance = window.variance;
    double* __restrict slope = window.slope;
    double* __restrict sigma2 = window.sigma2;
    for (Index i = 0; i < window.padded; ++i) {
        const double x = xs[i], y = ys[i], z = zs[i];
        const double u = a[1] + 2 * a[4] * x + ROOT2 * (a[5] * y + a[7] * z);
        const double v = a[2] + 2 * a[6] * y + ROOT2 * (a[5] * x + a[8] * z);
        const double w = a[3] + 2 * a[9] * z + ROOT2 * (a[7] * x + a[8] * y);
        slope[i] = u * u + v * v + w * w;
        double squared = 0;  // A Aᵀ (30), with A in the frame of the cloud
#pragma GCC unroll 3
        for (int k = 0; k < 3; ++k) {
            const double part =
                u * plane.axes[LONG][k] + v * plane.axes[MIDDLE][k] + w * plane.axes[NORMAL][k];
            squared += part * part;
        }
        sigma2[i] = variance[i] * squared;
    }
    double total = 0;
    Index count = 0;
    for (Index i = 0; i < window.n; ++i) {
        total += window.kept[i] != 0 ? sigma2[i] : 0.0;
        count += window.kept[i];
    }
    const double least = MIN_VARIANCE * total / static_cast<double>(count);
    for (Index i = 0; i < window.padded; ++i) {
        sigma2[i] = std::max(sigma2[i], least);
    }
}

// Writes the columns of B (23) of one point, or of points side by side.
template <int SIZE, typename Number>
[[gnu::always_inline]] inline void write_columns(Number x, Number y, Number z, Number* columns) {
    columns[0] = Number{} + 1.0;
    columns[1] = x;
    columns[2] = y;
    columns[3] = z;
    columns[4] = x * x;
    columns[5] = ROOT2 * x * y;
    columns[6] = y * y;
    if (SIZE == QUADRIC) {
        columns[7] = ROOT2 * x * z;
        columns[8] = ROOT2 * y * z;
        columns[9] = z * z;
    }
}

template <int SIZE>
[[gnu::always_inline]] inline void fill_columns(const Window& window, Index i, Doubles* columns) {
    const Coordinates& local = window.local;
    write_columns<SIZE>(load(local.x + i), load(local.y + i), load(local.z + i), columns);
}

// Measures B Q Bᵀ of all points.
template <int SIZE>
void measure_levers(Window& window) {
    for (Index i = 0; i < window.padded; i += DOUBLES) {
        Doubles columns[QUADRIC];
        fill_columns<SIZE>(window, i, columns);
        Doubles lever{};
        for (int j = 0; j < SIZE; ++j) {
            Doubles product{};
#pragma GCC unroll 10
            for (int k = 0; k < SIZE; ++k) {
                product += columns[k] * window.cofactor[j][k];  // which is symmetric
            }
            lever += product * columns[j];
        }
        store(window.lever + i, lever);
    }
}

}  // namespace

// Sums the normal matrix Bᵀ P B, each element point by point.
template <int SIZE>
void sum_normal(Window& window) {
    const double* weight = window.weight;
    Flag* which = window.which;
    Index count = 0;
    for (Index i = 0; i < window.n; ++i) {
        which[count] = i;
        count += weight[i] != 0 ? 1 : 0;
    }
    Doubles sums[SIZE][registers(SIZE)] = {};
    for (Index m = 0; m < count; ++m) {
        const double* row = window.rows + which[m] * ROW;
        const double p = weight[which[m]];
        // By way of memory: there each element can be read into all of a register.
        Doubles part[registers(SIZE)];
        double factors[registers(SIZE) * DOUBLES];
        for (int k = 0; k < registers(SIZE); ++k) {
            part[k] = load(row + k * DOUBLES);
            store(factors + k * DOUBLES, p * part[k]);
        }
#pragma GCC unroll 10
        for (int j = 0; j < SIZE; ++j) {
            // Of the upper triangle only what comes with the lower one.
            for (int k = 0; k < registers(j + 1); ++k) {
                sums[j][k] += factors[j] * part[k];
            }
        }
    }
    for (int j = 0; j < SIZE; ++j) {
        for (int k = 0; k < registers(j + 1); ++k) {
            store(window.normal[j] + k * DOUBLES, sums[j][k]);
        }
    }
    for (int j = 0; j < SIZE; ++j) {
        for (int k = 0; k < j; ++k) {
            window.normal[k][j] = window.normal[j][k];
        }
    }
}

// Solves (29) once, by the weights: δa = -Q Bᵀ P w is added to a.
template <int SIZE>
Squares step(Window& window) {
    sum_normal<SIZE>(window);
    if (!invert_bordered<SIZE>(window)) {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        return {nan, nan};
    }
    // Both matrices are symmetric: row by row is column by column.
    double gradient[ROW] = {}, change[ROW] = {};
    for (int j = 0; j < SIZE; ++j) {
        add_row<SIZE>(gradient, window.a[j], window.normal[j]);
    }
    for (int j = 0; j < SIZE; ++j) {
        add_row<SIZE>(change, -gradient[j], window.cofactor[j]);
    }
    double before = 0;
    for (int i = 0; i < SIZE; ++i) {
        before += gradient[i] * window.a[i];
    }
    double after = before;
    for (int i = 0; i < SIZE; ++i) {
        after += gradient[i] * change[i];
    }
    for (int i = 0; i < SIZE; ++i) {
        window.step[i] = change[i];
        window.a[i] += change[i];
    }
    return {before, std::max(after, 0.0)};
}

// Gives the parameters the norm 1 (19).
template <int SIZE>
void normalize(Window& window) {
    double squared = 0;
    for (int i = 0; i < SIZE; ++i) {
        squared += window.a[i] * window.a[i];
    }
    const double length = std::sqrt(squared);
    for (int i = 0; i < SIZE; ++i) {
        window.a[i] /= length;
    }
}

// Fills the coordinates of all points in the frame of the plane, and B (23).
void fill_rows(Window& window) {
    const Plane plane = window.plane;
    const double *xs = window.xyz.x, *ys = window.xyz.y, *zs = window.xyz.z;
    double* __restrict along = window.local.x;
    double* __restrict across = window.local.y;
    double* __restrict height = window.local.z;
    const double *lengthwise = plane.axes[LONG], *middle = plane.axes[MIDDLE];
    const double* normal = plane.axes[NORMAL];
    for (Index i = 0; i < window.padded; ++i) {
        const double a = xs[i] - plane.mean[0], b = ys[i] - plane.mean[1],
                     c = zs[i] - plane.mean[2];
        along[i] = lengthwise[0] * a + lengthwise[1] * b + lengthwise[2] * c;
        across[i] = middle[0] * a + middle[1] * b + middle[2] * c;
        height[i] = normal[0] * a + normal[1] * b + normal[2] * c;
    }
    for (Index i = 0; i < window.n; ++i) {
        write_columns<QUADRIC>(along[i], across[i], height[i], window.rows + i * ROW);
    }
}

// Gives the kept points the weight 1/variance, the others none.
void weigh(Window& window, const double* variance) {
    const Flag* kept = window.kept;
    double* __restrict weight = window.weight;
    for (Index i = 0; i < window.padded; ++i) {
        weight[i] = kept[i] != 0 ? 1 / variance[i] : 0.0;
    }
}

// Measures the residuals (29) of all points: B a.
template <int SIZE>
void measure_residuals(Window& window) {
    for (Index i = 0; i < window.padded; i += DOUBLES) {
        Doubles columns[QUADRIC], value{};
        fill_columns<SIZE>(window, i, columns);
#pragma GCC unroll 10
        for (int j = 0; j < SIZE; ++j) {
            value += columns[j] * window.a[j];
        }
        store(window.residual + i, value);
    }
}

// Measures residual, variance and slope of all points under the surface a.
template <int SIZE>
void measure_distances(Window& window) {
    measure_gradient(window);
    for (Index i = 0; i < window.padded; ++i) {
        window.slope[i] = std::sqrt(window.slope[i]);
    }
    measure_residuals<SIZE>(window);
}

// Repeats the adjustment of the kept points from a until it stands; measures all points.
//
// False if the parameters are ambiguous.
template <int SIZE>
bool adjust(Window& window) {
    for (int number = 0; number < ADJUSTMENTS; ++number) {
        measure_gradient(window);
        weigh(window, window.sigma2);
        if (std::isnan(step<SIZE>(window).before)) {
            return false;
        }
        normalize<SIZE>(window);
        double largest = 0;
        for (int i = 0; i < SIZE; ++i) {
            largest = std::max(largest, std::abs(window.step[i]));
        }
        if (largest < CONVERGED) {
            break;
        }
    }
    measure_distances<SIZE>(window);
    measure_levers<SIZE>(window);
    return true;
}

template void sum_normal<QUADRIC>(Window&);
template Squares step<PARABOLOID>(Window&);
template Squares step<QUADRIC>(Window&);
template void normalize<PARABOLOID>(Window&);
template void measure_residuals<PARABOLOID>(Window&);
template void measure_distances<QUADRIC>(Window&);
template bool adjust<PARABOLOID>(Window&);
template bool adjust<QUADRIC>(Window&);

}  // namespace LEVEL
}  // namespace lidar
