// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Points as given, and their order by line.
#pragma once

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {

struct OrderedLines {  // as in placed_pattern.py
    View<const double, 2> xyz;
    View<const double> distance;
    View<Index> order;
    View<const Index> first;
};

// Refuses lines, of a range of them, that do not follow each other within so many points.
inline void check_starts(View<const Index> first, Index begin, Index end, Index points) {
    check_range(begin, end, first.size() - 1);
    bool fits = 0 <= first[begin] && first[end] <= points;
    for (Index line = begin; line < end; ++line) {
        fits &= first[line] <= first[line + 1];
    }
    check(fits, "lines must follow each other within their points");
}

// Refuses points whose positions, or whose order in a range of it, are none of so many.
inline void check_points(View<const double, 2> xyz, View<const Index> order, Index begin,
                         Index end) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    check_range(begin, end, order.size());
    check_indices(View<const Index>{order.data + begin, {end - begin}}, xyz.size());
}

// Refuses a range of lines whose numbers are no addresses; `along` are in the order.
inline void check_lines(const OrderedLines& lines, Index begin, Index end,
                        std::initializer_list<View<const double>> along) {
    check_starts(lines.first, begin, end, lines.order.size());
    check_points(lines.xyz, lines.order, lines.first[begin], lines.first[end]);
    bool fits = lines.distance.size() == lines.xyz.size();
    for (const auto& values : along) {
        fits &= values.size() == lines.order.size();
    }
    check(fits, "points, and values along their order, must be as many");
}

}  // namespace lidar
