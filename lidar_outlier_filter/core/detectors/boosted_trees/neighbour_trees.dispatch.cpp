// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Points without scan lines, judged by trees: see neighbour_trees.py.

#include "neighbour_trees.hpp"

#include <algorithm>
#include <limits>

#include "../../neighbours/typical.hpp"
#include "neighbour_features.hpp"

namespace lidar {
namespace LEVEL {
namespace {

// Points of which it is found first whether their component is large: one of so many.
constexpr Index SAMPLED = 8;

void check_near(const Near& near) {
    const Index size = near.xyz.size();
    check(size <= std::numeric_limits<std::int32_t>::max(), "indices of points must be int32");
    check(near.xyz.shape[1] == 3 && near.index.size() == size && near.index.shape[1] == K &&
              near.radius.size() == size && near.is_large.size() == size,
          "xyz must be (N, 3), index (N, 8), radius and is_large (N,)");
    check_floor(near.around, size);
}

// Writes what was found of the points that there are.
void keep(const float* total, const float (*some)[LANES], Index start, Index end, View<float> odds,
          View<float, 2> values) {
    const Index count = std::min(Index{LANES}, end - start);
    std::copy(total, total + count, &odds[start]);
    for (Index f = 0; f < values.size(); ++f) {
        std::copy(some[f], some[f] + count, values.row(f) + start);
    }
}

void check_written(Index begin, Index end, int features, View<float> odds, View<float, 2> values) {
    check_range(begin, end, odds.size());
    check(values.size() == 0 || (values.size() == features && end <= values.shape[1]),
          "values must be (features, M), or empty");
}

// Returns these elements, those of whole rows where there are rows.
View<const Index> part(View<const Index> array, Index begin, Index end) {
    return {array.data + begin, {end - begin}};
}
View<const std::int32_t> part(View<const std::int32_t, 2> array, Index begin, Index end) {
    return {array.row(begin), {(end - begin) * array.shape[1]}};
}

}  // namespace

void write_large_components(Near near, Index begin, Index end, View<bool> is_large) {
    check_near(near);
    check(is_large.size() == near.xyz.size(), "is_large must be (N,)");
    check_range(begin, end, is_large.size());
    StepBuffers steps{};
    for (Index p = begin; p < end; ++p) {
        if (number(near.xyz.row(p)) % SAMPLED == 0) {
            is_large[p] = count_steps(near, p, steps).component == LARGEST_COMPONENT;
        }
    }
}

void judge_near(Near near, Trees trees, View<const Index> which, Index begin, Index end,
                View<float> odds, View<float, 2> values) {
    check_near(near);
    check_trees(trees, row::NEAR_COUNT);
    check_range(begin, end, which.size() > 0 ? which.size() : near.xyz.size());
    if (which.size() > 0) {
        check_indices(part(which, begin, end), near.xyz.size());
    }
    check_written(begin, end, row::NEAR_COUNT, odds, values);
    StepBuffers steps{};
    Index points[LANES];
    double scale[LANES];
    float some[row::NEAR_COUNT][LANES], total[LANES];
    for (Index start = begin; start < end; start += LANES) {
        for (Index lane = 0; lane < LANES; ++lane) {
            const Index at = std::min(start + lane, end - 1);
            points[lane] = which.size() > 0 ? which[at] : at;
        }
        write_near(near, points, steps, scale, some[0]);
        add_lanes(trees, some, total);
        keep(total, some, start, end, odds, values);
    }
}

void judge_far(Far far, Trees trees, View<const Index> which, Index begin, Index end,
               View<float> odds, View<float, 2> values) {
    check_near(far.near);
    check_trees(trees, row::FAR_COUNT);
    const Index columns = far.index.shape[1];
    check(far.odds.size() == far.near.xyz.size() && far.index.size() == which.size() &&
              columns > 0 && columns <= MAX_NEIGHBOURS,
          "odds must be (N,), and index (M, 1 to 60)");
    check_range(begin, end, which.size());
    check_written(begin, end, row::FAR_COUNT, odds, values);
    check_indices(part(which, begin, end), far.near.xyz.size());
    check_indices(part(far.index, begin, end), far.near.xyz.size());
    StepBuffers steps{};
    Index points[LANES], rows[LANES];
    float some[row::FAR_COUNT][LANES], total[LANES];
    for (Index start = begin; start < end; start += LANES) {
        for (Index lane = 0; lane < LANES; ++lane) {
            rows[lane] = std::min(start + lane, end - 1);
            points[lane] = which[rows[lane]];
        }
        write_far(far, points, rows, steps, some[0]);
        add_lanes(trees, some, total);
        keep(total, some, start, end, odds, values);
    }
}

}  // namespace LEVEL
}  // namespace lidar
