// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Sums of ensembles of trees, and what each feature adds to them.

#include <algorithm>
#include <vector>

#include "trees.hpp"

namespace lidar {
namespace LEVEL {

void add_trees(Trees trees, View<const float, 2> features, View<float> total) {
    check_trees(trees, features.size());
    check(features.shape[1] == total.size(), "features (F, W) and sums (W,) must fit together");
    std::vector<float> room(static_cast<std::size_t>(features.size() * LANES));
    const auto some = reinterpret_cast<float(*)[LANES]>(room.data());
    float sums[LANES];
    for (Index begin = 0; begin < total.size(); begin += LANES) {
        const Index count = std::min<Index>(LANES, total.size() - begin);
        for (Index f = 0; f < features.size(); ++f) {
            std::copy_n(features.row(f) + begin, count, some[f]);
        }
        add_lanes(trees, some, sums);
        std::copy_n(sums, count, total.data + begin);
    }
}

void add_contributions(Trees trees, View<const float, 2> means, View<const float, 2> values,
                       View<float, 2> added) {
    check_trees(trees, values.size());
    check(
        means.size() == trees.feature.size() && means.shape[1] == 15 && added.shape == values.shape,
        "means must be (T, 15), values and what is added (F, W)");
    for (Index k = 0; k < values.shape[1]; ++k) {
        for (Index tree = 0; tree < trees.feature.size(); ++tree) {
            const std::int32_t* f = trees.feature.row(tree);
            const float *t = trees.limit.row(tree), *mean = means.row(tree);
            int node = 0;
            while (node < 7) {
                const int number = 2 * node + (values(f[node], k) > t[node] ? 2 : 1);
                added(f[node], k) += mean[number] - mean[node];
                node = number;
            }
        }
    }
}

}  // namespace LEVEL
}  // namespace lidar
