// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What a window of points says of each of them: the surfaces it holds, and the test (31).
//
// A surface begins with the points nearest to a robust plane, and grows: it is fitted to the points
// kept so far, all points are tested against it, those that pass are kept, until nothing changes. A
// point that has left may come back. The model rises only where the lower one leaves a significant
// rest: a plane, a paraboloid standing on it, a quadric. A plane is never judged as a quadric,
// then, which would be ambiguous: z = 0 times any other plane goes through its points, and z² = 0
// too.
//
// A point that no surface explains is tested against all; its lowest score counts. Textbook twin:
// test/naive/quadric.py.

#include "surfaces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../../kernels/eigen.hpp"
#include "fits.hpp"

namespace lidar {
namespace LEVEL {

namespace {

constexpr int PASSES = 30;     // of fit and test; in the second half of them no point comes back
constexpr double GAP = 4.0;    // between the best quadric and the second best, mean squares; below
                               // they are ambiguous
constexpr double THICK = 0.2;  // standard deviation of the first surface over the window's radius
constexpr double LIKE = 2.0;   // most that the standard deviation of another is that of the first
constexpr double PART = 0.25;  // of the points left that another surface must explain
constexpr Index MISSING = 3;   // undecided: more than a third of a window is on no surface

constexpr double INF = std::numeric_limits<double>::infinity();

// Saves the kept points and the test of a model.
void save(Window& window, int model) {
    std::copy(window.kept, window.kept + window.padded, window.saved_kept[model]);
    std::copy(window.test, window.test + window.padded, window.saved_test[model]);
}

// Returns to a model that was saved.
void restore(Window& window, int model) {
    const Flag* kept = window.saved_kept[model];
    const double* test = window.saved_test[model];
    std::copy(kept, kept + window.padded, window.kept);
    std::copy(test, test + window.padded, window.test);
}

void weigh_equally(Window& window) {
    for (Index i = 0; i < window.padded; ++i) {
        window.weight[i] = static_cast<double>(window.kept[i]);
    }
}

// Returns Σ residual² ÷ Σ slope² of the kept points under the quadric a.
double mean_square_distance(Window& window) {
    measure_distances<QUADRIC>(window);
    double residuals = 0, slopes = 0;
    for (Index i = 0; i < window.n; ++i) {
        if (window.kept[i] != 0) {
            residuals += window.residual[i] * window.residual[i];
            slopes += window.slope[i] * window.slope[i];
        }
    }
    return residuals / slopes;
}

// Sets a to the eigenvector of the least eigenvalue of Σ Bᵀ B over the kept points.
//
// Returns the gap: how many times as far, in the mean of the squares, the second best quadric is
// from the points. Distances are those of the first order, residual ÷ slope, because eigenvalues of
// (19) alone take any quadric for good that is flat everywhere.
double start_algebraic(Window& window) {
    weigh_equally(window);
    sum_normal<QUADRIC>(window);
    double(*square)[ROW] = window.square;
    double(*vectors)[ROW] = window.other;
    for (int i = 0; i < QUADRIC; ++i) {
        std::copy(window.normal[i], window.normal[i] + QUADRIC, square[i]);
    }
    eigen(square, vectors, QUADRIC);
    const int least = find_least(square, QUADRIC);
    int second = least == 0 ? 1 : 0;
    for (int k = 0; k < QUADRIC; ++k) {
        if (k != least && square[k][k] < square[second][second]) {
            second = k;
        }
    }
    const auto take = [&](int column) {
        for (int k = 0; k < QUADRIC; ++k) {
            window.a[k] = vectors[k][column];
        }
    };
    take(second);
    const double far = mean_square_distance(window);
    take(least);
    return far / mean_square_distance(window);
}

bool fit(Window& window, int size, double floor) {
    return size == PLANE        ? adjust_plane(window, floor)
           : size == PARABOLOID ? adjust<PARABOLOID>(window)
                                : adjust<QUADRIC>(window);
}

// Fits and tests until no point leaves or comes back; none if the model cannot be had.
FittedSurface settle(Window& window, int size, const Rules& rules, const Growth& growth) {
    Flag* kept = window.kept;
    Flag* following = window.next;
    for (int number = 0; number < PASSES; ++number) {
        if (!fit(window, size, growth.floor) || !measure_tests(window, size, rules, growth)) {
            return NONE;
        }
        // Two points may drive each other out in turn, without end.
        const Flag back = 2 * number < PASSES ? 1 : 0;
        Index count = 0;
        Flag changed = 0;
        for (Index i = 0; i < window.padded; ++i) {
            const Flag welcome = window.left[i] & (kept[i] | back);
            following[i] = welcome & (window.test[i] <= 1 ? 1 : 0);
            count += following[i];
            changed |= following[i] ^ kept[i];
        }
        if (changed == 0) {
            break;
        }
        if (count < std::max(MIN_POINTS, Index{size + 1})) {
            return NONE;
        }
        if (number < PASSES - 1) {
            std::copy(following, following + window.padded, kept);
        }
    }
    return describe(window, size);
}

// Grows a quadric from the algebraic start, in the rows' frame; none if it is ambiguous.
//
// Where a quadric is always fitted, every one is taken.
FittedSurface grow_quadric(Window& window, const Rules& rules, const Growth& growth) {
    if (start_algebraic(window) > GAP || rules.always) {
        const FittedSurface quadric = settle(window, QUADRIC, rules, growth);
        if (rules.always || (quadric.size > 0 && is_flat(window))) {
            return quadric;
        }
    }
    return NONE;
}

// Raises a paraboloid to a quadric if that pays and is not ambiguous.
FittedSurface rise(Window& window, const FittedSurface& paraboloid, const Rules& rules,
                   const Growth& growth) {
    if (paraboloid.deviation <= growth.floor) {
        return paraboloid;
    }
    save(window, 1);
    weigh(window, window.sigma2);
    const Squares squares = step<QUADRIC>(window);
    if (is_better(squares.before, squares.after, paraboloid.support - (QUADRIC - 1), rules)) {
        const FittedSurface quadric = grow_quadric(window, rules, growth);
        if (quadric.size > 0) {
            return quadric;
        }
    }
    restore(window, 1);
    return paraboloid;
}

// Grows one more surface: freely, or if it runs over what lies beside it, held tight.
//
// It is rejected if it explains too few points, or is less exact than the first: a volume.
FittedSurface grow_another(Window& window, Index left, const Rules& rules, const Growth& growth) {
    std::copy(window.kept, window.kept + window.padded, window.start);
    for (const Growth& held : {Growth{growth.floor, INF, 0}, growth}) {
        std::copy(window.start, window.start + window.padded, window.kept);
        const FittedSurface surface = grow(window, rules, held);
        const bool enough = surface.size > 0 && static_cast<double>(surface.support) >=
                                                    PART * static_cast<double>(left);
        if (enough && surface.deviation <= LIKE * growth.noise) {
            return surface;
        }
    }
    return NONE;
}

// Centres the coordinates at their mean and divides them by their rms radius, which is returned.
//
// 0 if all points coincide.
double centre(Window& window) {
    double* const axes[3] = {window.xyz.x, window.xyz.y, window.xyz.z};
    // From the first point: the mean of large coordinates would be rounded.
    const double first[3] = {axes[0][0], axes[1][0], axes[2][0]};
    double total[3] = {}, squares = 0;
    for (Index i = 0; i < window.n; ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            total[axis] += axes[axis][i] - first[axis];
        }
    }
    for (int axis = 0; axis < 3; ++axis) {
        const double mean = total[axis] / static_cast<double>(window.n);
        double* each = axes[axis];
        for (Index i = 0; i < window.n; ++i) {
            each[i] = (each[i] - first[axis]) - mean;
        }
        for (Index i = 0; i < window.n; ++i) {
            squares += each[i] * each[i];
        }
    }
    const double scale = std::sqrt(squares / static_cast<double>(window.n));
    if (scale > 0) {
        for (double* each : axes) {
            for (Index i = 0; i < window.n; ++i) {
                each[i] /= scale;
            }
        }
    }
    return scale;
}

// Fills what follows from the coordinates, and what is behind the points: copies of the first.
void prepare(Window& window) {
    for (Index i = window.n; i < window.padded; ++i) {
        window.xyz.x[i] = window.xyz.x[0];
        window.xyz.y[i] = window.xyz.y[0];
        window.xyz.z[i] = window.xyz.z[0];
        window.variance[i] = window.variance[0];
    }
    for (Index i = 0; i < window.n; ++i) {
        const double quad[4] = {window.xyz.x[i], window.xyz.y[i], window.xyz.z[i], 1.0};
        std::copy_n(quad, 4, window.xyz.quads + 4 * i);
    }
    std::fill(window.left, window.left + window.n, 1);
    std::fill(window.left + window.n, window.left + window.padded, 0);
}

}  // namespace

FittedSurface grow(Window& window, const Rules& rules, const Growth& growth) {
    if (rules.always) {
        weigh_equally(window);
        fit_plane(window, window.xyz, 0, window.n);
        fill_rows(window);
        return grow_quadric(window, rules, growth);
    }
    const FittedSurface plane = settle(window, PLANE, rules, growth);
    if (plane.size == 0 || plane.deviation <= growth.floor) {
        return plane;
    }
    save(window, 0);
    fill_rows(window);
    if (is_bent(window, rules)) {
        const FittedSurface paraboloid = settle(window, PARABOLOID, rules, growth);
        if (paraboloid.size > 0) {
            return rise(window, paraboloid, rules, growth);
        }
    }
    restore(window, 0);
    return plane;
}

// The score is, for each point, T ÷ its critical value under the surface it agrees with best; NaN
// for all if the window is undecided: too few points, all in one place, or more than a third of
// them on no surface (under `model: always`, all of them).
void judge(Window& window, Index n, const Rules& rules) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    window.n = n;
    window.padded = round_up(n);
    std::fill(window.score, window.score + n, nan);
    if (n < MIN_POINTS) {
        return;
    }
    const double scale = centre(window);
    if (!(scale > 0)) {
        return;
    }
    prepare(window);
    std::fill(window.score, window.score + window.padded, INF);
    const double floor = rules.floor / scale;
    double noise = INF;
    Index freedom = 0, left = n;
    for (Index number = 0; number < rules.surfaces; ++number) {
        if (left < MIN_POINTS || !begin_surface(window, left, floor, rules)) {
            break;
        }
        FittedSurface surface = NONE;
        if (number > 0) {
            surface = grow_another(window, left, rules, {floor, noise, freedom});
        } else {
            surface = grow(window, rules, {floor, INF, 0});
            noise = std::max(surface.deviation, floor);
            freedom = surface.support - (surface.size - 1);
        }
        if (surface.size == 0 || (!rules.always && noise > std::max(THICK, floor))) {
            break;
        }
        left = 0;
        for (Index i = 0; i < n; ++i) {
            window.score[i] = std::min(window.score[i], window.test[i]);
            window.left[i] = window.score[i] > 1 ? 1 : 0;
            left += window.left[i];
        }
    }
    if (left == n || (MISSING * left > n && !rules.always)) {
        std::fill(window.score, window.score + n, nan);
    }
}

}  // namespace LEVEL
}  // namespace lidar
