// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this room.
#pragma once

#include <utility>

#include "../../kernels/array_view.hpp"
#include "../../kernels/levels.hpp"
#include "../../neighbours/tree.hpp"

namespace lidar {

// Rules of the judgement.
struct Rules {
    View<const double> critical;  // two-sided quantile of t by freedom; the last for all beyond
    View<const double> ratio;     // the same of F for three more parameters, by the larger model's
    double floor;                 // least standard deviation of a residual, metres
    Index surfaces;               // at most
    // Nothing but a quadric is fitted, to all points, ambiguous or not, and every window is
    // decided; else a surface begins with the points nearest to a plane.
    bool always;
};

inline constexpr Index MIN_POINTS = 12;  // of a surface

// A rim has at most RIM times the points of the largest core; of a fuller one every n-th is used.
inline constexpr Index RIM = 3;

void sort_leaves(View<const double, 2> xyz, const Tree& tree, View<const Index> these,
                 View<Index> place);

FOR_EACH_LEVEL(std::pair<Owned<Index>, Owned<double>> judge_sections(
                   View<const double, 2> xyz, View<const double> variance, const Tree& tree,
                   View<const Index> cores, Index section, Rules rules, View<double> score);
               void judge_patches(View<const double, 2> xyz, View<const double> variance,
                                  View<const std::int32_t, 2> nearest, View<const Index> place,
                                  View<const Index> rank, Index begin, Index end, Rules rules,
                                  View<double> score);)

}  // namespace lidar
