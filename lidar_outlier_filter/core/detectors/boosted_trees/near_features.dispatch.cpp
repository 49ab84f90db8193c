// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The features of points among their eight nearest neighbours.

#include "neighbour_features.hpp"
#include "neighbour_measures.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr Index MARK = Index{1} << 32U;  // more than there are points
constexpr double FEW = 3;                // of the neighbours

// Puts a point into a table; returns whether it was not there.
[[gnu::always_inline]] inline bool put(Index* table, Index mark, Index point) {
    // Which of the slots hold another point, and whether this one is there, cannot be predicted
    // together; so there is one question: is table[slot] >= mark, but not mark + point?
    const auto is_other = [&](Index slot) {
        const auto differs = static_cast<std::uint64_t>((table[slot] - mark) ^ point);
        return differs - 1 < static_cast<std::uint64_t>(MARK - 1);
    };
    Index slot = point & (TABLE - 1);
    while (is_other(slot)) {
        slot = (slot + 1) & (TABLE - 1);
    }
    const bool is_new = table[slot] != mark + point;
    table[slot] = mark + point;
    return is_new;
}

// Appends the neighbours of a point that were not reached before; returns the new count.
[[gnu::always_inline]] inline Index step(const std::int32_t* index, std::uint32_t size, Index one,
                                         Index count, Index mark, StepBuffers& steps) {
    const std::int32_t* const others = index + one * K;
    bool fits = true;
    for (int m = 0; m < K; ++m) {
        fits &= static_cast<std::uint32_t>(others[m]) < size;
    }
    check(fits, "neighbours must be points");
    for (int m = 0; m < K; ++m) {
        // Without a branch, which could not be predicted.
        steps.reached[count] = others[m];
        count += put(steps.table, mark, others[m]) ? 1 : 0;
    }
    return count;
}

}  // namespace

// Of the points that so many steps lead to, those found last are taken first: they are far out,
// and lead to new ones. What the table holds of earlier counts is less than `mark`: so nothing is
// cleared.
Sizes count_steps(const Near& near, Index p, StepBuffers& steps) {
    const auto size = static_cast<std::uint32_t>(near.index.size());
    const std::int32_t* const index = near.index.data;
    const Index mark = steps.mark += MARK;
    put(steps.table, mark, p);
    steps.reached[0] = p;
    Index count = 1, done = 0;
    for (; done < std::min(count, Index{K + 1}); ++done) {
        count = step(index, size, steps.reached[done], count, mark, steps);
    }
    const Index two = count - 1;
    // A point that reaches a large component belongs to it.
    for (Index i = 0; i < count; ++i) {
        if (near.is_large[steps.reached[i]]) {
            return {two, LARGEST_COMPONENT};
        }
    }
    Index begin = done, end = count, at = count;
    while (begin < at && count < LARGEST_COMPONENT) {
        --at;
        count = step(index, size, steps.reached[at], count, mark, steps);
        if (at == begin) {
            begin = end, end = at = count;
        }
    }
    return {two, std::min(count, LARGEST_COMPONENT)};
}

namespace {

// Writes the greatest ratio of successive distances, and how many neighbours list the point.
void write_jump(const Others<K>& others, NeighbourFeatures values) {
    const Doubles one = repeat(1.0), nothing = repeat(0.0);
    Doubles jump = one, jump_at = nothing;
    Doubles listed = choose(others.distance[0] <= others.radii[0], one, nothing);
    for (int m = 1; m < K; ++m) {
        const Doubles ratio = others.distance[m] / (others.distance[m - 1] + MIN_SCALE_M);
        jump_at = choose(ratio > jump, repeat(static_cast<double>(m)), jump_at);
        jump = most(jump, ratio);
        listed += choose(others.distance[m] <= others.radii[m], one, nothing);
    }
    values.write(row::jump, jump);
    values.write(row::jump_at, jump_at);
    values.write(row::listed, listed);
}

// Writes the features of distances; returns s.
Doubles write_distances(const Others<K>& others, NeighbourFeatures values) {
    Doubles sorted[K];
    copy_sorted(others.radii, K, sorted);
    const Doubles s = (sorted[K / 2 - 1] + sorted[K / 2]) / 2.0 + MIN_SCALE_M;
    const Doubles first = others.distance[0], eighth = others.distance[K - 1];
    values.write(row::near1, first / s);
    values.write(row::near8, eighth / s);
    values.write(row::near3, (first + others.distance[1] + others.distance[2]) / (FEW * s));
    values.write(row::denser, eighth / (sorted[0] + MIN_SCALE_M));
    values.write(row::sparser, sorted[K - 1] / s);
    write_jump(others, values);
    return s;
}

// Writes what does not need vectors.
void write_alone(const Near& near, Index p, int lane, StepBuffers& steps,
                 NeighbourFeatures values) {
    const Sizes sizes = count_steps(near, p, steps);
    values.write_one(row::steps2, lane, static_cast<double>(sizes.two));
    values.write_one(row::component_size, lane, static_cast<double>(sizes.component));
    values.write_one(row::rare, lane, near.radius[p] / near.around.typical);
    const double* const own = near.xyz.row(p);
    float depth[2];
    write_depth(near.around, own[0], own[1], own[2], 1, depth);
    values.write_one(row::deep, lane, depth[0]);
    values.write_one(row::deep_steep, lane, depth[1]);
    const double range =
        near.is_sweep ? std::sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2]) : 0.0;
    values.write_one(row::range, lane, range);
    values.write_one(row::near8_range, lane,
                     near.is_sweep ? near.radius[p] / std::max(range, MIN_RANGE_M) : 0.0);
}

}  // namespace

void write_near(const Near& near, const Index* points, StepBuffers& steps, double* scale,
                float* values) {
    for (int begin = 0; begin < LANES; begin += DOUBLES) {
        Others<K> others;
        const NeighbourFeatures written{values + begin};
        for (int lane = 0; lane < DOUBLES; ++lane) {
            const Index p = points[begin + lane];
            write_alone(near, p, lane, steps, written);  // it checks what the neighbours are
            gather(near, p, near.index.row(p), K, lane, others);
        }
        measure(others, K);
        const Doubles s = write_distances(others, written);
        store(scale + begin, s);
        write_heights<K>(others.z, K, s, row::below, row::sunk, written);
        const Planes plane = find_plane(others, K);
        write_off(plane, s, row::off, written);
        const Doubles nothing = repeat(0.0), x = plane.mean[0], y = plane.mean[1],
                      z = plane.mean[2];
        const Doubles along = root(most(plane.value[2], nothing));
        written.write(row::thin, root(most(plane.value[1], nothing)) / (along + MIN_SCALE_M));
        const Doubles spread = root(plane.moment[0] + plane.moment[1] + plane.moment[2]);
        written.write(row::aside, root(x * x + y * y + z * z) / (spread + MIN_SCALE_M));
        written.write(row::level, size_of(plane.vector[2]));
    }
}

}  // namespace LEVEL
}  // namespace lidar
