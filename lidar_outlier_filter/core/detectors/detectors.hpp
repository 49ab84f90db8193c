// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this folder: sums over neighbours for SOR and LOF, differences of elevations
// and the Gabriel graph.
#pragma once

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"
#include "../neighbours/tree.hpp"

namespace lidar {

// The neighbourhoods N(p) of all points, see lof.py. Row r of `more` is from first[r] on.
struct NearLists {
    Rows<const std::int32_t> listed;
    View<const std::int32_t> row;
    View<const Index> first;
    View<const std::int32_t> more;

    struct List {
        const std::int32_t* points;
        Index count;
    };
    // Returns the neighbourhood of a point; check_near() has been called.
    [[gnu::always_inline]] List of(Index p) const {
        const Index r = row[p];
        return r < 0 ? List{listed.row(p), listed.shape[1]}
                     : List{more.data + first[r], first[r + 1] - first[r]};
    }
};

// Writes the mean distance of a range of points to the neighbours in their lists.
void average_distances(View<const double, 2> xyz, Rows<const std::int32_t> lists, Index begin,
                       Index end, View<double> result);
// Divides 1 by the mean reach distance, from squared k-distances.
void write_densities(NearLists near, View<const double, 2> xyz, View<const double> square,
                     Index begin, Index end, View<double> density);
// Divides the mean density of the neighbours by the own one.
void write_density_ratios(NearLists near, View<const double> density, Index begin, Index end,
                          View<double> factor);
// Sorts rows of neighbours as the points were given: `order`; `position` is its inverse.
void sort_rows_as_given(View<const Index> first, View<const Index> order,
                        View<const Index> position, Index begin, Index end,
                        View<std::int32_t> more);

void check_near(const NearLists& near, Index points, Index begin, Index end);

// Writes M, the mean elevation of the neighbours less the own one, of a range of points.
void elevation_differences(View<const double> elevation, Rows<const std::int32_t> index,
                           Index begin, Index end, View<double> result);

// Returns (E, 2) the edges from points `begin` to `end` to points behind them in tree order.
Owned<std::int32_t, 2> gabriel_edges(View<const double, 2> xyz, Tree tree, Index begin, Index end);
}  // namespace lidar
