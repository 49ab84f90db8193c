// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The tests of points (31), and of models against each other. Textbook twin: test/naive/quadric.py.

#include <algorithm>
#include <cmath>

#include "fits.hpp"
#include "ranks.hpp"
#include "surfaces.hpp"

namespace lidar {
namespace LEVEL {

namespace {

constexpr double CURVED = 0.25;  // residual over the radius at which a quadric bends; above (20) is
                                 // no approximation
constexpr double TIGHT = 1.5;    // most that σ̂0 of another surface is, of the first's
constexpr int HEIGHT = 3;        // the column of z

double quantile(View<const double> table, Index freedom) {
    return table[std::min(freedom, table.size() - 1)];
}

struct Spread {  // Σ v²/σ² and its degrees of freedom: σ̂0² is their ratio
    double squares;
    Index freedom;
};

// Returns Σ (v ÷ σ)² of the kept points, and its degrees of freedom.
//
// If the first surface limits this one, the ratio is 1 to TIGHT² times the first's.
Spread find_spread(Window& window, int size, const Growth& growth) {
    const double *residual = window.residual, *sigma2 = window.sigma2, *slope = window.slope;
    const Flag* kept = window.kept;
    double* __restrict parts = window.scratch;
    for (Index i = 0; i < window.padded; ++i) {
        parts[i] = kept[i] != 0 ? residual[i] * residual[i] / sigma2[i] : 0.0;
    }
    double squares = 0;
    for (Index i = 0; i < window.n; ++i) {
        squares += parts[i];
    }
    const Index count = count_kept(window);
    Index freedom = count - (size - 1);
    if (growth.freedom > 0 && freedom > 0) {
        double unit = 0;
        for (Index i = 0; i < window.n; ++i) {
            unit += kept[i] != 0 ? slope[i] * slope[i] / sigma2[i] : 0.0;
        }
        const double least = static_cast<double>(freedom) * (growth.noise * growth.noise) * unit /
                             static_cast<double>(count);
        squares = std::min(std::max(squares, least), TIGHT * TIGHT * least);
        squares *= static_cast<double>(freedom + growth.freedom) / static_cast<double>(freedom);
        freedom += growth.freedom;
    }
    return {squares, freedom};
}

// Puts the residual² ÷ σ² of the kept points into scratch; returns their number.
Index square_kept(Window& window) {
    const double *residual = window.residual, *sigma2 = window.sigma2;
    double* __restrict scratch = window.scratch;
    for (Index i = 0; i < window.padded; ++i) {
        scratch[i] = residual[i] * residual[i] / sigma2[i];
    }
    Index count = 0;
    for (Index i = 0; i < window.n; ++i) {
        scratch[count] = scratch[i];
        count += window.kept[i];
    }
    return count;
}

double sum(const double* values, Index count) {
    double total = 0;
    for (Index i = 0; i < count; ++i) {
        total += values[i];
    }
    return total;
}

// Fits heights over the plane by a paraboloid with the weights; measures all points.
Squares step_from_plane(Window& window) {
    for (int k = 0; k < QUADRIC; ++k) {
        window.a[k] = k == HEIGHT ? 1.0 : 0.0;
    }
    const Squares squares = step<PARABOLOID>(window);
    measure_residuals<PARABOLOID>(window);
    return squares;
}

}  // namespace

// A point outside the fit has the variance of a prediction, and its T is distributed as t(f), with
// the f degrees of freedom of the fit. A point in the fit has its own part in σ̂0; that is taken
// out, which leaves t(f - 1): the test does not depend on whether a point is in. The paper leaves
// it in: a lone outlier among thirty then passes. Here it stays in under `model: always`, and if
// the first surface limits σ̂0.
bool measure_tests(Window& window, int size, const Rules& rules, const Growth& growth) {
    const Spread spread = find_spread(window, size, growth);
    if (spread.freedom < 2) {  // one is left without the point itself
        return false;
    }
    const bool apart = !rules.always && growth.freedom == 0;
    const double critical = quantile(rules.critical, spread.freedom);
    const double critical_kept = apart ? quantile(rules.critical, spread.freedom - 1) : critical;
    const double squares = spread.squares, others = static_cast<double>(spread.freedom - 1);
    const double unit = squares / static_cast<double>(spread.freedom), floor = growth.floor;
    const double *residual = window.residual, *sigma2 = window.sigma2, *slope = window.slope;
    const double* lever = window.lever;
    const Flag* kept = window.kept;
    double* __restrict test = window.test;
    for (Index i = 0; i < window.padded; ++i) {
        const double square = residual[i] * residual[i];
        const double cofactor = sigma2[i] + (kept[i] != 0 ? -lever[i] : lever[i]);
        const double without = std::max(squares * cofactor - square, 0.0) / others;
        const double fitted = kept[i] != 0 && apart ? without : unit * cofactor;
        const double least = floor * slope[i];
        const double variance = std::max(fitted, least * least);
        const double statistic = square > 0 ? std::sqrt(square / variance) : 0.0;
        test[i] = statistic / (kept[i] != 0 ? critical_kept : critical);
    }
    return true;
}

FittedSurface describe(const Window& window, int size) {
    double squares = 0;
    for (Index i = 0; i < window.n; ++i) {
        const double distance = window.residual[i] / window.slope[i];
        squares += window.kept[i] != 0 && window.slope[i] > 0 ? distance * distance : 0.0;
    }
    const Index count = count_kept(window);
    const Index freedom = std::max(count - (size - 1), Index{1});
    return {size, count, std::sqrt(squares / static_cast<double>(freedom))};
}

bool is_better(double before, double after, Index freedom, const Rules& rules) {
    if (freedom < 1) {
        return false;
    }
    const double ratio = quantile(rules.ratio, freedom);
    return (before - after) / 3 > ratio * after / static_cast<double>(freedom);
}

// Outliers that the plane could not distinguish from a bend would spoil it. So it is fitted to all
// kept points, then to the half that agrees best. If either is better, it begins with that half.
bool is_bent(Window& window, const Rules& rules) {
    weigh(window, window.sigma2);
    const Index count = count_kept(window), half = (count + 1) / 2;
    square_kept(window);
    select(window.scratch, count, half - 1);
    const double before_half = sum(window.scratch, half);
    const Squares all = step_from_plane(window);
    bool bent = is_better(all.before, all.after, count - (PARABOLOID - 1), rules);
    const double *residual = window.residual, *sigma2 = window.sigma2;
    for (int number = 0; number < CONCENTRATIONS; ++number) {
        square_kept(window);
        const double reach = find_rank(window.scratch, count, half - 1, window.more_scratch);
        double* __restrict weight = window.weight;
        for (Index i = 0; i < window.padded; ++i) {
            const bool near = residual[i] * residual[i] / sigma2[i] <= reach;
            weight[i] = window.kept[i] != 0 && near ? 1 / sigma2[i] : 0.0;
        }
        if (std::isnan(step_from_plane(window).before)) {
            return false;
        }
    }
    square_kept(window);
    const double reach = select(window.scratch, count, half - 1);
    const double after_half = sum(window.scratch, half);
    bent = bent || is_better(before_half, after_half, half - (PARABOLOID - 1), rules);
    if (bent) {
        for (Index i = 0; i < window.padded; ++i) {
            window.kept[i] &= residual[i] * residual[i] / sigma2[i] <= reach ? 1 : 0;
        }
    }
    normalize<PARABOLOID>(window);
    return bent;
}

// There the residual is small against the radius at which the surface bends. If not, two sheets of
// the quadric run through the noise of one surface.
bool is_flat(const Window& window) {
    double bend = 0;
    for (int k = PLANE; k < QUADRIC; ++k) {
        bend += window.a[k] * window.a[k];
    }
    bend = 2 * std::sqrt(bend);
    Index count = 0, curved = 0;
    for (Index i = 0; i < window.n; ++i) {
        if (window.kept[i] != 0) {
            const double squared = window.slope[i] * window.slope[i];
            count += 1;
            curved += std::abs(window.residual[i]) * bend > CURVED * squared ? 1 : 0;
        }
    }
    return 4 * curved <= count;
}

}  // namespace LEVEL
}  // namespace lidar
