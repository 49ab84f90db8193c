// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Ensembles of decision trees of depth 3, all of them complete, so that lanes need no branch:
// `Trees` of trees.py says what the arrays are. Textbook twin: one tree after the other, question
// by question (test/core/detectors/boosted_trees/test_scan_pattern.py).
#pragma once

#include <cstdint>

#include "../../kernels/array_view.hpp"
#include "../../kernels/lanes.hpp"
#include "../../kernels/levels.hpp"
#include "../../kernels/vectors.hpp"

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

// What Python calls -------------------------------------------------------------------------------

FOR_EACH_LEVEL(
    // Writes the sums (W,) of any number of points with these features (F, W).
    void add_trees(Trees trees, View<const float, 2> features, View<float> total);
    // Adds to (F, W) what each feature adds to the sums of W points with these values (F, W):
    // at each question, how much the mean (T, 15) of the leaves below changes.
    void add_contributions(Trees trees, View<const float, 2> means, View<const float, 2> values,
                           View<float, 2> added);)

// For other kernels -------------------------------------------------------------------------------

namespace LEVEL {

// Writes the sums of VECTORS × WIDTH points with these features, ROW points to a row.
//
// Several vectors share what is loaded of a tree, which takes longer than to compare.
template <int VECTORS, int ROW>
[[gnu::always_inline]] inline void add_vectors(const Trees& trees, const float (*features)[ROW],
                                               float* total) {
    Singles some[VECTORS];
    for (int n = 0; n < VECTORS; ++n) {
        some[n] = repeat(trees.start);
    }
    const std::int32_t* f = trees.feature.data;
    const float *t = trees.limit.data, *v = trees.value.data;
    for (Index tree = 0; tree < trees.feature.size(); ++tree, f += 7, t += 7, v += 8) {
        for (int n = 0; n < VECTORS; ++n) {
            const auto above = [&](int question) {
                return load(features[f[question]] + n * WIDTH) > repeat(t[question]);
            };
            const auto leaf = [&](int number) { return repeat(v[number]); };
            const Singles left = choose(above(1), choose(above(4), leaf(3), leaf(2)),
                                        choose(above(3), leaf(1), leaf(0)));
            const Singles right = choose(above(2), choose(above(6), leaf(7), leaf(6)),
                                         choose(above(5), leaf(5), leaf(4)));
            some[n] = some[n] + choose(above(0), right, left);
        }
    }
    for (Index n = 0; n < VECTORS; ++n) {
        store(total + n * WIDTH, some[n]);
    }
}

// Writes the sums of LANES points with these features, in single precision.
inline void add_lanes(const Trees& trees, const float (*features)[LANES], float* total) {
    constexpr int VECTORS = 2;
    for (int lane = 0; lane < LANES; lane += VECTORS * WIDTH) {
        const auto from = reinterpret_cast<const float(*)[LANES]>(&features[0][lane]);
        add_vectors<VECTORS>(trees, from, total + lane);
    }
}

}  // namespace LEVEL
}  // namespace lidar
