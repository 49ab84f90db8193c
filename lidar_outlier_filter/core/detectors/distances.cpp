// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Sums of distances. SOR, see sor.py, takes the mean distance to the k nearest; LOF, see lof.py,
// the local reachability density, with d(p, o) a distance and k(o) that of o to its k-th neighbour:
//
//     lrd(p) = |N(p)| ÷ Σ max(k(o), d(p, o)) over o in N(p).
//
// Naive twins: test/naive/sor.py, test/naive/lof.py.

#include "detectors.hpp"

#include <algorithm>
#include <cmath>

#include "../neighbours/tree.hpp"

namespace lidar {

void average_distances(View<const double, 2> xyz, Rows<const std::int32_t> lists, Index begin,
                       Index end, View<double> result) {
    check(xyz.shape[1] == 3 && lists.size() == xyz.size() && result.size() == xyz.size(),
          "there must be a list and a place for each point (N, 3)");
    check_indices(lists, begin, end, xyz.size());
    const Index k = lists.shape[1];
    for (Index p = begin; p < end; ++p) {
        double total = 0;
        for (Index m = 0; m < k; ++m) {
            total += std::sqrt(LEVEL::squared(xyz.row(p), xyz.row(lists(p, m))));
        }
        result[p] = total / static_cast<double>(k);
    }
}

void write_densities(NearLists near, View<const double, 2> xyz, View<const double> square,
                     Index begin, Index end, View<double> density) {
    check(xyz.shape[1] == 3 && square.size() == xyz.size() && density.size() == xyz.size(),
          "there must be a distance and a place for each point (N, 3)");
    check_near(near, xyz.size(), begin, end);
    for (Index p = begin; p < end; ++p) {
        const auto [list, count] = near.of(p);
        double total = 0;
        for (Index m = 0; m < count; ++m) {
            const Index o = list[m];
            total += std::sqrt(std::max(square[o], LEVEL::squared(xyz.row(p), xyz.row(o))));
        }
        density[p] = static_cast<double>(count) / total;
    }
}

}  // namespace lidar
