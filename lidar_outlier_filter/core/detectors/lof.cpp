// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The local outlier factor (Breunig et al. 2000), see lof.py: with N(p) the k-neighbourhood of p
// and lrd the local reachability density, which distances.cpp writes,
//
//     LOF(p) = Σ lrd(o) over o in N(p) ÷ |N(p)| ÷ lrd(p).
//
// Naive twin: test/naive/lof.py.

#include <algorithm>

#include "detectors.hpp"

namespace lidar {

// Refuses lists of a range of points that are not of such points.
void check_near(const NearLists& near, Index points, Index begin, Index end) {
    check(near.listed.size() == points && near.row.size() == points && near.first.size() > 0,
          "there must be a list and a row for each point");
    check_range(begin, end, points);
    check_indices(near.listed, begin, end, points);
    bool fits = true;
    for (Index p = begin; p < end; ++p) {
        const Index row = near.row[p];
        if (row < 0) {
            continue;
        }
        check(row < near.first.size() - 1, "rows must be those of lists");
        check_range(near.first[row], near.first[row + 1], near.more.size());
        for (Index m = near.first[row]; m < near.first[row + 1]; ++m) {
            fits &= 0 <= near.more[m] && near.more[m] < points;
        }
    }
    check(fits, "neighbours must be points");
}

void write_density_ratios(NearLists near, View<const double> density, Index begin, Index end,
                          View<double> factor) {
    check(factor.size() == density.size(), "there must be a place for each point");
    check_near(near, density.size(), begin, end);
    for (Index p = begin; p < end; ++p) {
        const auto [list, count] = near.of(p);
        double total = 0;
        for (Index m = 0; m < count; ++m) {
            total += density[list[m]];
        }
        factor[p] = total / static_cast<double>(count) / density[p];
    }
}

void sort_rows_as_given(View<const Index> first, View<const Index> order,
                        View<const Index> position, Index begin, Index end,
                        View<std::int32_t> more) {
    check(position.size() == order.size(), "there must be a position for each point");
    check_range(begin, end, first.size() - 1);
    for (Index row = begin; row < end; ++row) {
        check_range(first[row], first[row + 1], more.size());
        std::int32_t* const from = more.data + first[row];
        std::int32_t* const to = more.data + first[row + 1];
        for (std::int32_t* each = from; each < to; ++each) {
            check(0 <= *each && *each < order.size(), "neighbours must be points");
            const Index given = order[*each];
            check(0 <= given && given < order.size(), "points must be numbered");
            *each = static_cast<std::int32_t>(given);
        }
        std::sort(from, to);
        for (std::int32_t* each = from; each < to; ++each) {
            *each = static_cast<std::int32_t>(position[*each]);
        }
    }
}

}  // namespace lidar
