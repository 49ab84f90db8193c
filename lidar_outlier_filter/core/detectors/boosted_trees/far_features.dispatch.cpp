// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The features of points among their sixty nearest neighbours.

#include "neighbour_features.hpp"
#include "neighbour_measures.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr double OPPOSITE = -0.8;  // cosine of the angle between neighbours, at most
constexpr Index DENSE_RANK = 5;    // rank of the neighbour that is dense, from 0
constexpr double GROUP_GAP = 2;    // S: a longer distance ends a group

typedef Others<MAX_NEIGHBOURS> Many;

// Writes the first log-odds of a point, and their statistics over its neighbours.
void write_odds(const Far& far, Index p, Index at, int lane, NeighbourFeatures values) {
    const std::int32_t* const nearest = far.near.index.row(p);
    const std::int32_t* const others = far.index.row(at);
    const Index size = far.index.shape[1];
    double total = 0;
    Index few = 0, many = 0;
    for (int m = 0; m < K; ++m) {
        total += static_cast<double>(far.odds[nearest[m]]);
        few += far.odds[nearest[m]] > 0 ? 1 : 0;
    }
    for (Index m = 0; m < size; ++m) {
        many += far.odds[others[m]] > 0 ? 1 : 0;
    }
    values.write_one(row::first, lane, far.odds[p]);
    values.write_one(row::near_odds, lane, total / K);
    values.write_one(row::rejected_neighbour_share8, lane, static_cast<double>(few) / K);
    values.write_one(row::rejected_neighbour_share60, lane,
                     static_cast<double>(many) / static_cast<double>(size));
}

// Writes the features of distances; `near_scale` is s. Returns S.
Doubles write_distances(const Near& near, const Index* points, Doubles near_scale,
                        const Many& others, Index count, NeighbourFeatures values) {
    Doubles sorted[MAX_NEIGHBOURS], own;
    copy_sorted(others.radii, count, sorted);
    for (int lane = 0; lane < DOUBLES; ++lane) {
        own[lane] = near.radius[points[lane]];
    }
    // Ranks of a sorted list: the upper of two in the middle.
    const Doubles s = sorted[count / 2] + MIN_SCALE_M;
    const Index twentieth = std::min(Index{FEWER_NEIGHBOURS}, count) - 1;
    values.write(row::wide8, own / s);
    values.write(row::wide20, others.distance[twentieth] / s);
    values.write(row::wide60, others.distance[count - 1] / s);
    values.write(row::densest, own / (sorted[std::min(DENSE_RANK, count - 1)] + MIN_SCALE_M));
    values.write(row::contrast, s / near_scale);
    values.write(row::rare60, s / near.around.typical);
    return s;
}

struct Extent {
    Doubles low, high;  // metres from the point; infinite, and -infinite, without neighbours
};

// Returns the lowest and highest z between two opposite neighbours of the first `count`.
Extent find_between(const Many& others, Index count) {
    Doubles length[FEWER_NEIGHBOURS], low = repeat(INFINITE), high = repeat(-INFINITE);
    for (Index m = 0; m < count; ++m) {
        const Doubles x = others.x[m], y = others.y[m];
        const Doubles one = root(x * x + y * y);
        for (Index n = 0; n < m; ++n) {
            const Doubles across = x * others.x[n] + y * others.y[n], other = length[n];
            const Doubles z = (others.z[m] * other + others.z[n] * one) / (one + other);
            const Wides found = across < OPPOSITE * (one * other);
            low = least(low, choose(found, z, low));
            high = most(high, choose(found, z, high));
        }
        length[m] = one;
    }
    return {low, high};
}

// Writes how many neighbours are higher, and where the point is between opposite ones.
void write_between(const Many& others, Index count, Doubles s, NeighbourFeatures values) {
    const Doubles one = repeat(1.0), nothing = repeat(0.0);
    Doubles higher = nothing;
    for (Index m = 0; m < count; ++m) {
        higher += choose(others.z[m] > 0.0, one, nothing);
    }
    const auto [low, high] = find_between(others, std::min(Index{FEWER_NEIGHBOURS}, count));
    values.write(row::higher, higher / static_cast<double>(count));
    values.write(row::under, choose(low < INFINITE, low / s, nothing));
    values.write(row::over, choose(high > -INFINITE, -high / s, nothing));
}

// The neighbours that are left while they are joined one by one.
struct Joining {
    Doubles x, y, z;                // where the latest is
    Doubles reach[MAX_NEIGHBOURS];  // squared distances to the nearest of those that are joined
    Doubles best, least;            // which of those left is nearest, and how near
};

// Finds which of those left is nearest to any that are joined.
void find_next(const Many& others, Index left, Joining& joining) {
    const Doubles x = joining.x, y = joining.y, z = joining.z;
    Doubles best = repeat(0.0), shortest = repeat(INFINITE), number = repeat(0.0);
    for (Index m = 0; m < left; ++m) {
        const Doubles dx = others.x[m] - x, dy = others.y[m] - y, dz = others.z[m] - z;
        const Doubles squared = least(joining.reach[m], (dx * dx + dy * dy) + dz * dz);
        joining.reach[m] = squared;
        best = choose(squared < shortest, number, best);
        shortest = least(shortest, squared);
        number += 1.0;
    }
    joining.best = best;
    joining.least = shortest;
}

// Puts the last of those left where the best one was; what is left is together at the begin.
void take_out(Many& others, Index last, Joining& joining) {
    for (int lane = 0; lane < DOUBLES; ++lane) {
        const auto m = static_cast<Index>(joining.best[lane]);
        joining.x[lane] = others.x[m][lane];
        joining.y[lane] = others.y[m][lane];
        joining.z[lane] = others.z[m][lane];
        joining.reach[m][lane] = joining.reach[last][lane];
        others.x[m][lane] = others.x[last][lane];
        others.y[m][lane] = others.y[last][lane];
        others.z[m][lane] = others.z[last][lane];
    }
}

// Joins the neighbours one by one (Prim's spanning tree), and writes features of the edges.
//
// The neighbours are put into another order.
void write_group(Many& others, Index count, Doubles s, NeighbourFeatures values) {
    const Doubles nothing = repeat(0.0);
    Doubles first = nothing, longest = nothing, before = nothing, against = nothing;
    Doubles group = repeat(static_cast<double>(count));
    Joining joining;
    joining.x = joining.y = joining.z = nothing;
    std::fill(joining.reach, joining.reach + count, repeat(INFINITE));
    for (Index joined = 0; joined < count; ++joined) {
        find_next(others, count - joined, joining);
        const Doubles edge = root(joining.least), number = repeat(static_cast<double>(joined));
        const Wides longer = edge > longest;
        first = joined == 0 ? edge : first;
        const Doubles of = joined > 0 ? longest : s;
        against = choose(longer, edge / (of + MIN_SCALE_M), against);
        before = choose(longer, number, before);
        longest = choose(longer, edge, longest);
        group = choose(edge > GROUP_GAP * s, least(group, number), group);
        take_out(others, count - joined - 1, joining);
    }
    values.write(row::first_edge, first / s);
    values.write(row::longest, longest / s);
    values.write(row::before, before);
    values.write(row::against, against);
    values.write(row::group, group);
}

}  // namespace

void write_far(const Far& far, const Index* points, const Index* rows, StepBuffers& steps,
               float* values) {
    const Index count = far.index.shape[1], some = std::min(Index{FEWER_NEIGHBOURS}, count);
    double near_scale[LANES];
    write_near(far.near, points, steps, near_scale, values);
    for (int begin = 0; begin < LANES; begin += DOUBLES) {
        Many others;
        const NeighbourFeatures written{values + begin};
        for (int lane = 0; lane < DOUBLES; ++lane) {
            const Index p = points[begin + lane], row = rows[begin + lane];
            gather(far.near, p, far.index.row(row), count, lane, others);
            write_odds(far, p, row, lane, written);
        }
        measure(others, count);
        const Doubles s = write_distances(far.near, points + begin, load(near_scale + begin),
                                          others, count, written);
        write_off(find_plane(others, some), s, row::off20, written);
        write_off(find_plane(others, count), s, row::off60, written);
        write_heights<FEWER_NEIGHBOURS>(others.z, some, s, row::below20, row::sunk20, written);
        write_heights<MAX_NEIGHBOURS>(others.z, count, s, row::below60, row::sunk60, written);
        write_between(others, count, s, written);
        write_group(others, count, s, written);
    }
}

}  // namespace LEVEL
}  // namespace lidar
