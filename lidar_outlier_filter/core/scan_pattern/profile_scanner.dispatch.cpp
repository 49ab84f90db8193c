// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Where a profile scanner was, by some returns of each line, see profile_scanner.py.
//
// Textbook twin: test/naive/profile_pattern.py.

#include <algorithm>
#include <cmath>
#include <limits>

#include "../kernels/eigen.hpp"
#include "../kernels/select.hpp"
#include "scan_pattern.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr int FITS = 3;
constexpr double MIN_WEIGHED_M = 0.5;  // m: what is nearer does not weigh more
constexpr double TINY = std::numeric_limits<double>::min();
constexpr double INFINITE = std::numeric_limits<double>::infinity();

// Rows of numbers side by side, each as long.
struct Rows {
    std::vector<double> numbers;
    Index count;

    Rows(Index rows, Index columns)
        : numbers(static_cast<std::size_t>(rows * columns)), count(columns) {}
    double* operator[](Index row) {
        return numbers.data() + row * count;
    }
};

double dot(const double* one, const double* other, Index count) {
    double total = 0;
    for (Index m = 0; m < count; ++m) {
        total += one[m] * other[m];
    }
    return total;
}

double mean(const double* values, Index count, Index apart) {
    double total = 0;
    for (Index m = 0; m < count; ++m) {
        total += values[m * apart];
    }
    return total / static_cast<double>(count);
}

// Sums up products of SIZE rows, and turns them into axes; returns which is the shortest.
template <int SIZE>
int find_axes(const double* rows, Index count, double (*products)[SIZE], double (*axes)[SIZE]) {
    double sums[SIZE][SIZE] = {};
    // All at once, so that none waits for the one before; each in the order of the returns.
    for (Index m = 0; m < count; ++m) {
#pragma GCC unroll 4
        for (int i = 0; i < SIZE; ++i) {
#pragma GCC unroll 4
            for (int j = 0; j <= i; ++j) {
                sums[i][j] += rows[i * count + m] * rows[j * count + m];
            }
        }
    }
    for (int i = 0; i < SIZE; ++i) {
        for (int j = 0; j <= i; ++j) {
            products[i][j] = products[j][i] = sums[i][j];
        }
    }
    eigen(products, axes, SIZE);
    return find_least(products, SIZE);
}

struct PlaneFit {
    double x, y, off, unsure, cosine, sine;  // the last two of delta
};

struct Scratch {  // of a line of so many returns
    Rows flat, weighed;
    std::vector<double> far, off, weight;

    explicit Scratch(Index count)
        : flat(4, count),
          weighed(4, count),
          far(static_cast<std::size_t>(count)),
          off(far.size()),
          weight(far.size()) {}
};

// Fits the position in a plane; says how far off returns are, and how unsure it is, too.
//
// Scratch has the returns there, `flat` (4, S): x, y, and the sines and cosines of mirror angles.
// The row (x sine - y cosine, x cosine + y sine, -sine, cosine) of each, weighed by 1 / range,
// times (cos delta, sin delta, and these times the position) is 0 but for noise.
PlaneFit fit_plane(Scratch& scratch, double sense) {
    auto& [flat, rows, fars, offs, weights] = scratch;
    const Index count = flat.count;
    const double *xs = flat[0], *ys = flat[1], *sines = flat[2], *cosines = flat[3];
    double *const weight = weights.data(), *const far = fars.data(), *const off = offs.data();
    double products[4][4], axes[4][4];
    double east = 0, north = 0, square = 0, error = 0, second = 0, along = 0, a = 0, b = 0;
    std::fill(weight, weight + count, 1.0);
    for (int fit = 0; fit < FITS; ++fit) {
        for (Index m = 0; m < count; ++m) {
            const double x = xs[m], y = ys[m], cosine = cosines[m], w = weight[m];
            const double sine = sense * sines[m];
            rows[0][m] = w * (x * sine - y * cosine);
            rows[1][m] = w * (x * cosine + y * sine);
            rows[2][m] = -w * sine;
            rows[3][m] = w * cosine;
        }
        const int least = find_axes<4>(rows[0], count, products, axes);
        a = axes[0][least];
        b = axes[1][least];
        const double c = axes[2][least], d = axes[3][least];
        square = std::max(a * a + b * b, TINY);
        east = (c * a - d * b) / square;
        north = (c * b + d * a) / square;
        along = 0;
        for (Index m = 0; m < count; ++m) {
            const double residual =
                a * rows[0][m] + b * rows[1][m] + c * rows[2][m] + d * rows[3][m];
            const double x = xs[m] - east, y = ys[m] - north;
            far[m] = std::sqrt(x * x + y * y);
            const double sine = sense * sines[m], cosine = cosines[m], before = weight[m];
            along += (x * (a * cosine - b * sine) + y * (b * cosine + a * sine)) * before;
            weight[m] = 1.0 / std::max(far[m], MIN_WEIGHED_M);
            off[m] = std::abs(residual) / before * weight[m];
        }
        error = std::max(products[least][least], 0.0);
        products[least][least] = INFINITE;
        double lowest = products[0][0];
        for (int i = 1; i < 4; ++i) {
            lowest = std::min(lowest, products[i][i]);
        }
        second = std::max(lowest * square, TINY);
    }
    // Points that all lie where the scanner is fit any angle.
    const bool shown = median(far, count) > MIN_RANGE_M;
    const double typical = shown ? median(off, count) / std::sqrt(square) : INFINITE;
    // Lines through the scanner have two ends: most returns are at that which the beam points to.
    const double size = along >= 0 ? std::sqrt(square) : -std::sqrt(square);
    const double unsure = std::sqrt(error / (static_cast<double>(count) * second));
    return {east, north, typical, unsure, a / size, b / size};
}

void check_returns(View<const double, 3> xyz, View<const double, 2> turned) {
    check(xyz.shape[0] == turned.shape[0] && xyz.shape[1] == turned.shape[1] && xyz.shape[2] == 3,
          "returns must be (L, S, 3), and angles (L, S)");
    check(turned.shape[1] > 0, "lines must have returns");
}

}  // namespace

// Fits the scanner's position to S returns (L, S, 3) of each line, at mirror angles (L, S), rad.
//
// Returns what Fit of profile_scanner.py says.
Fits fit_lines(View<const double, 3> xyz, View<const double, 2> turned) {
    check_returns(xyz, turned);
    const Index lines = turned.shape[0], count = turned.shape[1];
    const auto size = static_cast<std::size_t>(lines);
    std::vector<double> position(size * 3), offs(size), unsure(size), beam(size * 6);
    Rows at(3, count);
    Scratch scratch(count);
    for (Index line = 0; line < lines; ++line) {
        const double *const points = &xyz(line, 0, 0), *const angles = turned.row(line);
        double centre[3], products[3][3], axes[3][3], east[3], north[3];
        for (int i = 0; i < 3; ++i) {
            centre[i] = mean(points + i, count, 3);
            for (Index m = 0; m < count; ++m) {
                at[i][m] = points[3 * m + i] - centre[i];
            }
        }
        const int normal = find_axes<3>(at[0], count, products, axes);
        for (int i = 0; i < 3; ++i) {
            east[i] = axes[i][(normal + 1) % 3];
            north[i] = axes[i][(normal + 2) % 3];
        }
        for (Index m = 0; m < count; ++m) {
            const double x = at[0][m], y = at[1][m], z = at[2][m];
            scratch.flat[0][m] = x * east[0] + y * east[1] + z * east[2];
            scratch.flat[1][m] = x * north[0] + y * north[1] + z * north[2];
            scratch.flat[2][m] = std::sin(angles[m]);
            scratch.flat[3][m] = std::cos(angles[m]);
        }
        // Which side of the plane is seen is not known: the mirror turns one way or the other.
        for (const double sense : {1.0, -1.0}) {
            const auto fit = fit_plane(scratch, sense);
            if (!(sense > 0 || fit.off < offs[static_cast<std::size_t>(line)])) {
                continue;
            }
            offs[static_cast<std::size_t>(line)] = fit.off;
            unsure[static_cast<std::size_t>(line)] = fit.unsure;
            double *const where = position.data() + 3 * line, *const to = beam.data() + 6 * line;
            for (int i = 0; i < 3; ++i) {
                where[i] = centre[i] + fit.x * east[i] + fit.y * north[i];
                to[i] = fit.cosine * east[i] + fit.sine * north[i];
                to[3 + i] = sense * (fit.cosine * north[i] - fit.sine * east[i]);
            }
        }
    }
    return {Owned<double, 2>(std::move(position), {lines, 3}), Owned<double>(std::move(offs)),
            Owned<double>(std::move(unsure)), Owned<double, 3>(std::move(beam), {lines, 2, 3})};
}

// Returns how far S returns of each line (L, S, 3), from the scanner, are off a plane, rad.
//
// The median of the distances from the best plane / range. The plane may move steadily along its
// normal as the mirror turns (L, S): a scanner that drives draws a screw.
Owned<double> off_plane(View<const double, 3> xyz, View<const double, 2> turned) {
    check_returns(xyz, turned);
    const Index lines = turned.shape[0], count = turned.shape[1];
    std::vector<double> found(static_cast<std::size_t>(lines)),
        off(static_cast<std::size_t>(count));
    Rows rows(5, count);
    for (Index line = 0; line < lines; ++line) {
        const double *const points = &xyz(line, 0, 0), *const angles = turned.row(line);
        const double middle = mean(angles, count, 1);
        for (Index m = 0; m < count; ++m) {
            const double x = points[3 * m], y = points[3 * m + 1], z = points[3 * m + 2];
            const double weight = 1.0 / std::max(std::sqrt(x * x + y * y + z * z), MIN_WEIGHED_M);
            rows[0][m] = weight;
            rows[1][m] = weight * (angles[m] - middle);
            rows[2][m] = weight * x;
            rows[3][m] = weight * y;
            rows[4][m] = weight * z;
        }
        // What shift and drive explain is taken off.
        for (int k = 0; k < 2; ++k) {
            const double size = std::max(dot(rows[k], rows[k], count), TINY);
            for (int i = k + 1; i < 5; ++i) {
                const double part = dot(rows[i], rows[k], count) / size;
                for (Index m = 0; m < count; ++m) {
                    rows[i][m] -= part * rows[k][m];
                }
            }
        }
        double products[3][3], axes[3][3];
        const int normal = find_axes<3>(rows[2], count, products, axes);
        const double x = axes[0][normal], y = axes[1][normal], z = axes[2][normal];
        for (Index m = 0; m < count; ++m) {
            off[static_cast<std::size_t>(m)] =
                std::abs(rows[2][m] * x + rows[3][m] * y + rows[4][m] * z);
        }
        found[static_cast<std::size_t>(line)] = median(off.data(), count);
    }
    return Owned<double>(std::move(found));
}

}  // namespace LEVEL
}  // namespace lidar
