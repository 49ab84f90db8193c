// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Ensembles of decision trees of depth 3: `Trees` of trees.py says what the arrays are.
#pragma once

#include <cstdint>

#include "../../kernels/array_view.hpp"
#include "../../kernels/lanes.hpp"
#include "../../kernels/levels.hpp"

namespace lidar {

struct Trees {
    View<const std::int32_t, 2> feature;
    View<const float, 2> limit, value;
    float start;
};

// Refuses an ensemble that is none, or asks about other features than the first so many.
inline void check_trees(const Trees& trees, Index features) {
    const Index count = trees.feature.size();
    check(trees.limit.size() == count && trees.value.size() == count &&
              trees.feature.shape[1] == 7 && trees.limit.shape[1] == 7 && trees.value.shape[1] == 8,
          "trees must have 7 questions and 8 values");
    check_indices(View<const std::int32_t>{trees.feature.data, {count * 7}}, features);
}

namespace LEVEL {

// Writes the sums of LANES points with these features, in single precision.
inline void add_lanes(const Trees& trees, const float (*features)[LANES], float* total) {
    for (int lane = 0; lane < LANES; lane += WIDTH) {
        Singles some = repeat(trees.start);
        for (Index tree = 0; tree < trees.feature.size(); ++tree) {
            const std::int32_t* f = trees.feature.row(tree);
            const float *t = trees.limit.row(tree), *v = trees.value.row(tree);
            const auto above = [&](int question) {
                return load(features[f[question]] + lane) > repeat(t[question]);
            };
            const auto leaf = [&](int number) { return repeat(v[number]); };
            const Singles left = choose(above(1), choose(above(4), leaf(3), leaf(2)),
                                        choose(above(3), leaf(1), leaf(0)));
            const Singles right = choose(above(2), choose(above(6), leaf(7), leaf(6)),
                                         choose(above(5), leaf(5), leaf(4)));
            some = some + choose(above(0), right, left);
        }
        store(total + lane, some);
    }
}

}  // namespace LEVEL
}  // namespace lidar
