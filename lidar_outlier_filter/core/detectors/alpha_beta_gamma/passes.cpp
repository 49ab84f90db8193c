// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Scores, and which points each pass takes out of their segments: see detector.py.
//
// Twin: test/naive/alpha_beta_gamma.py.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "../../kernels/select.hpp"
#include "alpha_beta_gamma.hpp"

namespace lidar {
namespace {

constexpr Index MIN_RESIDUALS = 10;      // fewer of them in a line give no standard deviation
constexpr double MAD_TO_SIGMA = 1.4826;  // median of |N(0, 1)| is 0.6745
constexpr double NONE = std::numeric_limits<double>::quiet_NaN();

enum Window { CENTRED, BEFORE, AFTER };  // of a point

// Estimates 1/σ of points begin to end; NaN of too few.
double one_precision(const double* standard, Index begin, Index end, double floor,
                     double* scratch) {
    Index count = 0;
    for (Index i = begin; i < end; ++i) {
        const double value = std::abs(standard[i]);
        scratch[count] = value;
        count += std::isnan(value) ? 0 : 1;
    }
    if (count < MIN_RESIDUALS) {
        return NONE;
    }
    return 1 / std::max(floor, MAD_TO_SIGMA * LEVEL::median(scratch, count));
}

// Divides the worst coordinate's statistic of one window by the critical value.
double window_score(const View<const double, 3>& standard, Index window, Index m,
                    const View<const double, 2>& precision, Index k, double critical) {
    const double a = std::abs(standard(window, 0, m)) * precision(0, k);
    const double b = std::abs(standard(window, 1, m)) * precision(1, k);
    const double c = std::abs(standard(window, 2, m)) * precision(2, k);
    // All three are NaN together, and max() would not show it.
    return std::isnan(a) ? NONE : std::max(std::max(a, b), c) / critical;
}

}  // namespace

// Estimates 1/σ of each line and coordinate, (3, N), from its median absolute centred difference.
//
// A line with too few differences for a median has NaN: its points stay untested.
void estimate_precision(View<const double, 2> standard, View<const Index> first, double floor,
                        View<double, 2> result) {
    const Index points = standard.shape[1];
    check(standard.size() == 3 && result.shape == standard.shape, "arrays must be (3, N)");
    for (Index line = 0; line + 1 < first.size(); ++line) {
        check_range(first[line], first[line + 1], points);
    }
    std::fill(result.data, result.data + 3 * points, NONE);
    std::vector<double> scratch(static_cast<std::size_t>(points));
    for (Index axis = 0; axis < 3; ++axis) {
        for (Index line = 0; line + 1 < first.size(); ++line) {
            const Index begin = first[line], end = first[line + 1];
            const double found =
                one_precision(standard.row(axis), begin, end, floor, scratch.data());
            std::fill(result.row(axis) + begin, result.row(axis) + end, found);
        }
    }
}

// Scores points by the centred window, or by the side they agree with better, and ranks them.
//
// The centred window stands in for a side that is too short. The rank says which of the points
// that fail goes first: it is the score of the centred window, in which no good point stands out
// more than a lone outlier beside it; one-sided windows extrapolate. NaN for points that pass.
// `standard` is (3 windows, 3, M), `precision` (3, N), all others (M,).
void score_windows(View<const double, 3> standard, View<const double, 2> precision,
                   View<const Index> which, double critical, bool either, View<double> score,
                   View<double> rank) {
    const std::array<Index, 3> shape{3, 3, which.size()};
    check(standard.shape == shape && precision.size() == 3, "standard must be (3, 3, M)");
    check(score.size() == which.size() && rank.size() == which.size(), "results must be (M,)");
    check_indices(which, precision.shape[1]);
    for (Index m = 0; m < which.size(); ++m) {
        const auto of = [&](Window window) {
            return window_score(standard, window, m, precision, which[m], critical);
        };
        const double centred = of(CENTRED);
        score[m] = centred;
        if (either) {
            double front = of(BEFORE), behind = of(AFTER);
            front = std::isnan(front) ? centred : front;
            behind = std::isnan(behind) ? centred : behind;
            score[m] = std::min(front, behind);
        }
        rank[m] = score[m] > 1 ? centred : NONE;
    }
}

// Marks which points fail worse than every other within reach; of equals the first does.
//
// The reach is a whole window: near an end of the segment, where windows are shifted, points may
// see each other from that far.
void find_worst(View<const Index> failing, View<const double> rank, View<const Index> before,
                View<const Index> after, Index reach, View<bool> result) {
    check(rank.size() == before.size(), "ranks must be as many as points");
    check(result.size() == failing.size(), "result must be as long as failing");
    check(before.size() == after.size(), "links must be as many as points");
    check_indices(failing, before.size());
    const auto is_point = [&](Index i) { return LEVEL::leads(i, before.size()); };
    for (Index m = 0; m < failing.size(); ++m) {
        const Index k = failing[m];
        Index i = before[k], j = after[k];
        bool worst = true;
        for (Index step = 0; step < reach && worst && (is_point(i) || is_point(j)); ++step) {
            // A comparison with NaN is false: points that pass exceed no other.
            worst = !((is_point(i) && rank[i] >= rank[k]) || (is_point(j) && rank[j] > rank[k]));
            i = is_point(i) ? before[i] : i;
            j = is_point(j) ? after[j] : j;
        }
        result[m] = worst;
    }
}

// Takes points out of their segments; returns others within their reach, once each.
Owned<Index> unlink_points(View<const Index> worst, View<Index> before, View<Index> after,
                           Index reach, View<const bool> rejected) {
    check(rejected.size() == before.size(), "rejected must be as many as points");
    check(before.size() == after.size(), "links must be as many as points");
    check_indices(worst, before.size());
    std::vector<char> marked(rejected.data, rejected.data + rejected.size());
    std::vector<Index> spoiled;
    for (Index m = 0; m < worst.size(); ++m) {
        for (const auto& link : {before, after}) {
            Index i = link[worst[m]];
            for (Index step = 0; step < reach && LEVEL::leads(i, before.size()); ++step) {
                char& mark = marked[static_cast<std::size_t>(i)];
                if (mark == 0) {
                    mark = 1;
                    spoiled.push_back(i);
                }
                i = link[i];
            }
        }
    }
    for (Index m = 0; m < worst.size(); ++m) {
        const Index k = worst[m];
        if (LEVEL::leads(before[k], before.size())) {
            after[before[k]] = after[k];
        }
        if (LEVEL::leads(after[k], before.size())) {
            before[after[k]] = before[k];
        }
    }
    return Owned<Index>(std::move(spoiled));
}

}  // namespace lidar
