// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Planes through runs of points, a run in each element of a register. Plain form: fit_plane() and
// eigen() for one run after the other.

#include <algorithm>
#include <limits>

#include "../../kernels/eigen.hpp"
#include "../../kernels/vectors.hpp"
#include "fits.hpp"

namespace lidar {
namespace LEVEL {

namespace {

struct Runs {
    Doubles x[RUN], y[RUN], z[RUN], weight[RUN];  // the first points of the runs, the second, ...
    Wides count;                                  // points of a run
};

struct Moments {
    Doubles total, mean[3];
    Doubles square[3][3];   // the upper triangle: it is symmetric
    Doubles vectors[3][3];  // by rows, as in eigen.hpp
};

bool any(Wides mask) {
    std::int64_t all = 0;
    for (int lane = 0; lane < DOUBLES; ++lane) {
        all |= mask[lane];
    }
    return all != 0;
}

// Places that a run does not have get the weight 0, which changes no sum.
void gather(const Coordinates& points, Index begin, Index left, Runs& runs) {
    for (int lane = 0; lane < DOUBLES; ++lane) {
        const Index first = begin + lane * RUN;
        const Index count = std::max(std::min(RUN, left - first), Index{0});
        runs.count[lane] = count;
        for (Index i = 0; i < RUN; ++i) {
            const Index k = std::min(first + i, left - 1);
            runs.x[i][lane] = points.x[k];
            runs.y[i][lane] = points.y[k];
            runs.z[i][lane] = points.z[k];
            runs.weight[i][lane] = i < count ? 1.0 : 0.0;
        }
    }
}

void sum_moments(const Runs& runs, Moments& moments) {
    Doubles total{}, x{}, y{}, z{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
    for (Index i = 0; i < RUN; ++i) {
        const Doubles p = runs.weight[i], a = runs.x[i], b = runs.y[i], c = runs.z[i];
        total += p;
        x += p * a;
        y += p * b;
        z += p * c;
        xx += p * a * a;
        xy += p * a * b;
        xz += p * a * c;
        yy += p * b * b;
        yz += p * b * c;
        zz += p * c * c;
    }
    x /= total;
    y /= total;
    z /= total;
    moments.total = total;
    moments.mean[0] = x;
    moments.mean[1] = y;
    moments.mean[2] = z;
    moments.square[0][0] = xx - total * x * x;
    moments.square[0][1] = xy - total * x * y;
    moments.square[0][2] = xz - total * x * z;
    moments.square[1][1] = yy - total * y * y;
    moments.square[1][2] = yz - total * y * z;
    moments.square[2][2] = zz - total * z * z;
}

// Turns axes I and J, of those matrices that are marked; K is the third.
template <int I, int J, int K>
[[gnu::always_inline]] inline void rotate(Moments& moments, Wides alive) {
    auto& square = moments.square;
    Doubles& beside = square[I][J];
    Doubles& one = I < K ? square[I][K < I ? I : K] : square[K < I ? K : I][I];
    Doubles& other = J < K ? square[J][K < J ? J : K] : square[K < J ? K : J][J];
    const Wides turns = alive & (beside != 0.0);
    const Doubles ratio = (square[J][J] - square[I][I]) / (2 * beside);
    const Doubles size = 1 / (size_of(ratio) + root(ratio * ratio + 1));
    const Doubles tangent = choose(ratio < 0.0, -size, size);
    const Doubles cosine = 1 / root(tangent * tangent + 1), sine = tangent * cosine;
    square[I][I] = choose(turns, square[I][I] - tangent * beside, square[I][I]);
    square[J][J] = choose(turns, square[J][J] + tangent * beside, square[J][J]);
    beside = choose(turns, Doubles{}, beside);
    const Doubles turned = cosine * one - sine * other;
    other = choose(turns, sine * one + cosine * other, other);
    one = choose(turns, turned, one);
    for (auto& row : moments.vectors) {
        const Doubles first = row[I], second = row[J];
        row[I] = choose(turns, cosine * first - sine * second, first);
        row[J] = choose(turns, sine * first + cosine * second, second);
    }
}

// As eigen(), for the matrices side by side: each rests when it is done.
void find_axes(Moments& moments) {
    auto& square = moments.square;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            moments.vectors[i][j] = repeat(i == j ? 1.0 : 0.0);
        }
    }
    Wides alive = moments.total > 0.0;
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        const Doubles diagonal =
            square[0][0] * square[0][0] + square[1][1] * square[1][1] + square[2][2] * square[2][2];
        const Doubles beside =
            square[0][1] * square[0][1] + square[0][2] * square[0][2] + square[1][2] * square[1][2];
        alive &= beside > NEGLIGIBLE * diagonal;
        if (!any(alive)) {
            return;
        }
        rotate<0, 1, 2>(moments, alive);
        rotate<0, 2, 1>(moments, alive);
        rotate<1, 2, 0>(moments, alive);
    }
}

// Writes the plane of each run.
void write_planes(const Moments& moments, Plane* planes) {
    for (int lane = 0; lane < DOUBLES; ++lane) {
        double values[3], vectors[3][3];
        for (int i = 0; i < 3; ++i) {
            values[i] = moments.square[i][i][lane];
            planes[lane].mean[i] = moments.mean[i][lane];
            for (int j = 0; j < 3; ++j) {
                vectors[i][j] = moments.vectors[i][j][lane];
            }
        }
        planes[lane].weight = moments.total[lane];
        set_axes(values, vectors, planes[lane]);
    }
}

void fit(const Runs& runs, Plane* planes) {
    Moments moments;
    sum_moments(runs, moments);
    find_axes(moments);
    write_planes(moments, planes);
}

// Takes the weight from the points of each run that are farther from its plane than its median.
void drop_worse_halves(Runs& runs, const Plane* planes) {
    Doubles normal[3], zero, distance[RUN];
    for (int lane = 0; lane < DOUBLES; ++lane) {
        const double* axis = planes[lane].axes[NORMAL];
        const double* mean = planes[lane].mean;
        for (int k = 0; k < 3; ++k) {
            normal[k][lane] = axis[k];
        }
        zero[lane] = axis[0] * mean[0] + axis[1] * mean[1] + axis[2] * mean[2];
    }
    for (Index i = 0; i < RUN; ++i) {
        const Doubles height =
            normal[0] * runs.x[i] + normal[1] * runs.y[i] + normal[2] * runs.z[i] - zero;
        distance[i] = choose(runs.count > Wides{} + i, size_of(height),
                             repeat(std::numeric_limits<double>::infinity()));
    }
    const Wides half = runs.count / 2;
    for (Index i = 0; i < RUN; ++i) {
        Wides nearer{};
        for (Index j = 0; j < RUN; ++j) {
            nearer -= distance[j] < distance[i];  // true is -1
        }
        runs.weight[i] =
            choose((nearer <= half) & (runs.count > Wides{} + i), repeat(1.0), Doubles{});
    }
}

}  // namespace

void fit_runs(const Coordinates& points, Index begin, Index left, Plane* planes) {
    Runs runs;
    gather(points, begin, left, runs);
    fit(runs, planes);
    drop_worse_halves(runs, planes);
    fit(runs, planes);
}

}  // namespace LEVEL
}  // namespace lidar
