// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The windows of a cloud, judged one by one: sections and patches, see detector.py.

#include <algorithm>

#include "sections.hpp"
#include "surfaces.hpp"

namespace lidar {
namespace LEVEL {

namespace {

void check_points(View<const double, 2> xyz, View<const double> variance, const Rules& rules) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    check(variance.size() == xyz.size(), "each point must have a variance");
    check(rules.critical.size() > 0 && rules.ratio.size() > 0, "quantiles for any freedom");
}

// Copies points into the window.
void fill(Window& window, View<const double, 2> xyz, View<const double> variance,
          const Index* found, Index n) {
    for (Index k = 0; k < n; ++k) {
        const double* point = xyz.row(found[k]);
        window.xyz.x[k] = point[0];
        window.xyz.y[k] = point[1];
        window.xyz.z[k] = point[2];
        window.variance[k] = variance[found[k]];
    }
}

}  // namespace

// Judges the points of some cores, each in its window; fills their scores, in tree order.
//
// Returns the points on rims that lie on a surface, and their scores in that window: (A,), (A,).
std::pair<Owned<Index>, Owned<double>> judge_sections(View<const double, 2> xyz,
                                                      View<const double> variance, const Tree& tree,
                                                      View<const Index> cores, Index section,
                                                      Rules rules, View<double> score) {
    check_points(xyz, variance, rules);
    check(score.size() == xyz.size(), "each point must have a score");
    check_tree(tree, xyz.size());
    check_indices(cores, tree.child.size());
    check(1 <= section && section <= 1 << 30, "a section must be of at least one point");
    SectionRoom room(tree, cores, section);
    Window window(static_cast<Index>(room.found.size()));
    std::vector<Index> index;
    std::vector<double> value;
    for (Index i = 0; i < cores.size(); ++i) {
        const Index first = tree.first[cores[i]], last = tree.last[cores[i]];
        const Index n = find_points(xyz, tree, cores[i], section, room);
        fill(window, xyz, variance, room.found.data(), n);
        judge(window, n, rules);
        for (Index k = 0; k < n; ++k) {
            const Index point = room.found[static_cast<std::size_t>(k)];
            if (first <= point && point < last) {
                score[point] = window.score[k];
            } else if (window.score[k] <= 1) {
                index.push_back(point);
                value.push_back(window.score[k]);
            }
        }
    }
    return {Owned<Index>(std::move(index)), Owned<double>(std::move(value))};
}

// Judges points begin to end, each in the window of its nearest; fills their scores.
//
// `nearest` is by tree position, all else in the order of sort_leaves(): `place` and `rank` lead
// from that to the tree and back.
void judge_patches(View<const double, 2> xyz, View<const double> variance,
                   View<const std::int32_t, 2> nearest, View<const Index> place,
                   View<const Index> rank, Index begin, Index end, Rules rules,
                   View<double> score) {
    check_points(xyz, variance, rules);
    check(score.size() == xyz.size() && nearest.size() == xyz.size() &&
              place.size() == xyz.size() && rank.size() == xyz.size(),
          "all arrays must be of the same points");
    check_range(begin, end, xyz.size());
    const Index n = nearest.shape[1] + 1;
    std::vector<Index> found(static_cast<std::size_t>(n));
    Window window(n);
    for (Index i = begin; i < end; ++i) {
        check(0 <= place[i] && place[i] < xyz.size(), "places must be those of points");
        const std::int32_t* others = nearest.row(place[i]);
        found[0] = i;
        for (Index k = 1; k < n; ++k) {
            const Index other = others[k - 1];
            check(0 <= other && other < xyz.size(), "the nearest must be points");
            found[static_cast<std::size_t>(k)] = rank[other];
        }
        // In tree order those that follow each other lie together.
        std::sort(found.begin(), found.end());
        check(0 <= found.front() && found.back() < xyz.size(), "ranks must be those of points");
        fill(window, xyz, variance, found.data(), n);
        judge(window, n, rules);
        score[i] = window.score[std::lower_bound(found.begin(), found.end(), i) - found.begin()];
    }
}

}  // namespace LEVEL
}  // namespace lidar
