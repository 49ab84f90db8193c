// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The features of a point among its eight, or sixty, nearest neighbours; features.py says what each
// means. Plain twins: test/naive/survey.py.
//
// Of the eight, all lengths are divided by the local scale s, the median distance of those
// neighbours to their own eighth: so features have no unit, and follow the density. Of the sixty by
// S, the same median. z is expected to point up.
#pragma once

#include "../../kernels/eigen_lanes.hpp"
#include "../../kernels/lanes.hpp"
#include "../../kernels/levels.hpp"
#include "../../kernels/vectors.hpp"
#include "neighbour_trees.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr int K = 8;  // neighbours
inline constexpr int MAX_NEIGHBOURS = 60, FEWER_NEIGHBOURS = 20;
inline constexpr double MIN_SCALE_M = 1e-6;   // metres that are added to scales, which may be 0
inline constexpr double SMOOTH = 0.01;        // of s: less is not expected of any surface
inline constexpr double EVEN_HEIGHTS = 0.02;  // of s: heights differ so much on any surface
inline constexpr double NARROW = 1e-6;      // variances across / along, below which there is a line
inline constexpr double MIN_RANGE_M = 0.1;  // metres: spacings nearer to a sensor say nothing
inline constexpr double MAX_FEATURE = 1e6;  // features are at most so large

// Rows of features, in the order of NEAR, SWEEP and FAR in features.py.
namespace row {
// clang-format off
enum Near {
    near1, near3, near8, denser, sparser, jump, jump_at, listed, steps2, off, flat, off_flat, thin,
    aside, level, below, above, sunk, raised, rare, component_size, deep, deep_steep, range,
    near8_range, NEAR_COUNT
};
enum Far {
    wide8 = NEAR_COUNT, wide20, wide60, densest, contrast, first_edge, longest, before, against,
    group, off20, flat20, off_flat20, off60, flat60, off_flat60, below20, above20, below60, above60,
    sunk20, raised20, sunk60, raised60, rare60, higher, under, over, first, near_odds,
    rejected_neighbour_share8, rejected_neighbour_share60, FAR_COUNT
};
// clang-format on
}  // namespace row

// Features of the points side by side in vectors.
struct NeighbourFeatures {
    float* values;  // rows are LANES apart

    void write(Index row, Doubles value) const {
        store(values + row * LANES, least(most(value, repeat(-MAX_FEATURE)), repeat(MAX_FEATURE)));
    }
    void write_one(Index row, int lane, double value) const {
        values[row * LANES + lane] =
            static_cast<float>(std::min(std::max(value, -MAX_FEATURE), MAX_FEATURE));
    }
};

// Neighbours of the points side by side, the nearest first.
template <int ROWS>
struct Others {
    Doubles x[ROWS], y[ROWS], z[ROWS];  // from the point, metres
    Doubles distance[ROWS];             // from the point, metres
    Doubles radii[ROWS];                // their own to their eighth neighbour, metres
};

// A plane through the neighbours of each point: their mean and second moments, and the eigenvalues
// and normals.
struct Planes {
    Doubles mean[3], moment[6], value[3], vector[3];
};

inline constexpr Index LARGEST_COMPONENT = 61;  // points: so many are no group
inline constexpr Index MAX_REACHED =
    LARGEST_COMPONENT + 1 + K * Index{K + 1};  // before the steps end
inline constexpr Index TABLE = 1024;           // slots for those, a power of 2: few of them meet

// Room for the steps of one point after the other.
struct StepBuffers {
    Index reached[MAX_REACHED];  // in the order in which they were found
    Index table[TABLE];          // of what is hashed; what is below `mark` is of earlier points
    Index mark;
};

struct Sizes {
    Index two, component;  // other points within two steps; points in the component, up to 61
};

// Counts the other points that two steps from p lead to, and all that any number of them does.
Sizes count_steps(const Near& near, Index p, StepBuffers& steps);

// Writes the features of LANES points among eight neighbours, and s (LANES,), metres.
void write_near(const Near& near, const Index* points, StepBuffers& steps, double* scale,
                float* values);

// Writes all features of LANES points, whose sixty neighbours are in these rows of far.index.
void write_far(const Far& far, const Index* points, const Index* rows, StepBuffers& steps,
               float* values);

}  // namespace LEVEL
}  // namespace lidar
