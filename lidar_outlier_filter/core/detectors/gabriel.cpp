// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The Gabriel graph, see hierarchical.py. Naive twin: test/naive/hierarchical.py.

#include "detectors.hpp"

#include <cmath>

namespace lidar {

namespace {

constexpr Index PLANES = 64;     // most that are kept for a point: those of the nearest candidates
constexpr Index MANY = 256;      // candidates: more have their planes among the points before, too
constexpr double SLACK = 1e-14;  // of a product of lengths, or of a coordinate: above its rounding

// The plane through a point at a right angle to the line from the tested one.
struct Plane {
    double away[3];  // the point less the tested one
    double square;   // of that
    double point[3];
    double distance;  // from the tested one
};

// Finds the edges of one point after another.
class Graph {
public:
    Graph(View<const double, 2> xyz, const Tree& tree)
        : xyz_(xyz), tree_(tree), stack_(static_cast<std::size_t>(tree_height(tree) + 2)) {}

    void add_edges(Index p, std::vector<std::int32_t>& ends) {
        find_candidates(p, false);
        if (static_cast<Index>(candidates_.size()) > MANY) {
            find_candidates(p, true);
        }
        for (const std::int32_t q : candidates_) {
            // The point's own plane leaves it alone: r - q is zero.
            if (!is_beyond(xyz_.row(q)) && is_empty(xyz_.row(p), xyz_.row(q))) {
                ends.push_back(static_cast<std::int32_t>(p));
                ends.push_back(q);
            }
        }
    }

private:
    // Gathers points behind p in tree order that no plane hides, and the planes.
    //
    // The planes of the points behind p mostly do. Where they leave many, as on a circle with
    // points on its axis, those `before` p hide the most. Without them the search ends at MANY.
    void find_candidates(Index p, bool before) {
        const double* const own = xyz_.row(p);
        const Box here = LEVEL::box_of(own);
        Index waiting = 1;
        stack_[0] = 0;
        kept_ = 0;
        candidates_.clear();
        while (waiting > 0) {
            const Index node = stack_[static_cast<std::size_t>(--waiting)];
            const bool many = static_cast<Index>(candidates_.size()) > MANY;
            if (!before && (many || tree_.last[node] <= p + 1)) {
                continue;
            }
            if (is_hidden(node, own)) {
                continue;
            }
            Index near = tree_.child[node];
            if (near >= 0) {
                Index far = near + 1;
                // The nearer one first: its points make better planes.
                if (LEVEL::gap(tree_, far, here) < LEVEL::gap(tree_, near, here)) {
                    std::swap(near, far);
                }
                stack_[static_cast<std::size_t>(waiting)] = far;
                stack_[static_cast<std::size_t>(waiting + 1)] = near;
                waiting += 2;
                continue;
            }
            for (Index q = tree_.first[node]; q < tree_.last[node]; ++q) {
                if (q == p || is_beyond(xyz_.row(q))) {
                    continue;
                }
                if (q > p) {
                    candidates_.push_back(static_cast<std::int32_t>(q));
                }
                add_plane(own, xyz_.row(q));
            }
        }
    }

    // Whether the whole box of a node is beyond one of the planes.
    bool is_hidden(Index node, const double* own) const {
        const double* const low = tree_.low.row(node);
        const double* const high = tree_.high.row(node);
        const auto farther = [&](int axis) {
            return std::max(std::abs(low[axis] - own[axis]), std::abs(high[axis] - own[axis]));
        };
        // To the farthest corner: what a product with it is rounded by goes with its length.
        double reach = farther(0) + farther(1);
        reach += farther(2);
        for (Index k = 0; k < kept_; ++k) {
            const Plane& plane = planes_[k];
            const double* const away = plane.away;
            const double u = away[0] > 0 ? low[0] : high[0];
            const double v = away[1] > 0 ? low[1] : high[1];
            const double w = away[2] > 0 ? low[2] : high[2];
            const double slack = SLACK * plane.distance * (reach + plane.distance);
            if ((away[0] * (u - own[0]) + away[1] * (v - own[1])) + away[2] * (w - own[2]) >
                plane.square + slack) {
                return true;
            }
        }
        return false;
    }

    // Whether a point is beyond one of the planes: whether the plane's point is inside the ball.
    bool is_beyond(const double* point) const {
        for (Index k = 0; k < kept_; ++k) {
            const double* const away = planes_[k].away;
            const double* const at = planes_[k].point;
            if ((away[0] * (at[0] - point[0]) + away[1] * (at[1] - point[1])) +
                    away[2] * (at[2] - point[2]) <
                0) {
                return true;
            }
        }
        return false;
    }

    // Sorts the plane of a point, seen from the tested one, in by its distance.
    void add_plane(const double* own, const double* point) {
        Plane plane{};
        for (int axis = 0; axis < 3; ++axis) {
            plane.away[axis] = point[axis] - own[axis];
            plane.point[axis] = point[axis];
        }
        const double* const away = plane.away;
        plane.square = (away[0] * away[0] + away[1] * away[1]) + away[2] * away[2];
        plane.distance = std::sqrt(plane.square);
        Index k = kept_;
        if (kept_ == PLANES) {
            if (planes_[kept_ - 1].square <= plane.square) {
                return;
            }
            k = kept_ - 1;
        }
        while (k > 0 && planes_[k - 1].square > plane.square) {
            planes_[k] = planes_[k - 1];
            --k;
        }
        planes_[k] = plane;
        kept_ = std::min(kept_ + 1, PLANES);
    }

    // Whether no point is inside the ball between p and q.
    bool is_empty(const double* p, const double* q) {
        const double middle[3] = {0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])};
        const Box here = LEVEL::box_of(middle);
        const double square = 0.25 * LEVEL::squared(q, p);
        // The middle is rounded as the coordinates are, which may be far off.
        const double slack = SLACK * (std::abs(p[0]) + std::abs(p[1]) + std::abs(p[2]) +
                                      std::abs(q[0]) + std::abs(q[1]) + std::abs(q[2]));
        const double reach = square + slack * (std::sqrt(square) + slack);
        Index waiting = 1;
        stack_[0] = 0;
        while (waiting > 0) {
            const Index node = stack_[static_cast<std::size_t>(--waiting)];
            Index near = tree_.child[node];
            if (near >= 0) {
                Index far = near + 1;
                double near_gap = LEVEL::gap(tree_, near, here);
                double far_gap = LEVEL::gap(tree_, far, here);
                if (far_gap < near_gap) {
                    std::swap(near, far);
                    std::swap(near_gap, far_gap);
                }
                if (far_gap < reach) {
                    stack_[static_cast<std::size_t>(waiting++)] = far;
                }
                if (near_gap < reach) {
                    stack_[static_cast<std::size_t>(waiting++)] = near;
                }
                continue;
            }
            for (Index r = tree_.first[node]; r < tree_.last[node]; ++r) {
                const double* const at = xyz_.row(r);
                if (((p[0] - at[0]) * (q[0] - at[0]) + (p[1] - at[1]) * (q[1] - at[1])) +
                        (p[2] - at[2]) * (q[2] - at[2]) <
                    0) {
                    return false;
                }
            }
        }
        return true;
    }

    const View<const double, 2> xyz_;
    const Tree tree_;
    std::vector<Index> stack_;
    std::vector<std::int32_t> candidates_;  // points in front of all planes so far
    Plane planes_[PLANES] = {};
    Index kept_ = 0;
};

}  // namespace

Owned<std::int32_t, 2> gabriel_edges(View<const double, 2> xyz, Tree tree, Index begin, Index end) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    check_tree(tree, xyz.size());
    check_range(begin, end, xyz.size());
    Graph graph(xyz, tree);
    std::vector<std::int32_t> ends;
    for (Index p = begin; p < end; ++p) {
        graph.add_edges(p, ends);
    }
    const Index count = static_cast<Index>(ends.size()) / 2;
    return {std::move(ends), {count, 2}};
}

}  // namespace lidar
