// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Building of a kd-tree, see tree_build.py. Naive twin: test/naive/neighbours.py has none of it,
// but finds the same neighbours; what is promised of nodes is checked in test_neighbours.py.

#include "tree_build.hpp"

#include <limits>

#include "../kernels/select.hpp"

namespace lidar {

namespace {

constexpr Index LOPSIDED = 16;  // a cut that leaves less than 1/16 of the points on one side
constexpr double FAR = std::numeric_limits<double>::infinity();

// The points of a node, and the buffer that takes them when it is cut.
struct Points {
    const double* from;
    const std::int32_t* index;
    double* to;
    std::int32_t* index_to;
};

Points points_of(const Buffers& buffers, bool in_spare) {
    const Points points{buffers.points.data, buffers.index.data, buffers.spare_points.data,
                        buffers.spare_index.data};
    const Points spare{buffers.spare_points.data, buffers.spare_index.data, buffers.points.data,
                       buffers.index.data};
    return in_spare ? spare : points;
}

// Returns the smallest box around points; +inf and -inf where there are none.
Box bound(const double* points, Index first, Index last) {
    Box box{{FAR, FAR, FAR}, {-FAR, -FAR, -FAR}};
    for (Index i = first; i < last; ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            box.low[axis] = std::min(box.low[axis], points[3 * i + axis]);
            box.high[axis] = std::max(box.high[axis], points[3 * i + axis]);
        }
    }
    return box;
}

Index count_below(const double* points, Index first, Index last, int axis, double cut) {
    Index count = 0;
    for (Index i = first; i < last; ++i) {
        count += points[3 * i + axis] < cut ? 1 : 0;
    }
    return count;
}

// Returns a cut at the median, or right above the lowest points if they are more than half.
double find_middle(const double* points, Index first, Index last, int axis, double low) {
    std::vector<double> values(static_cast<std::size_t>(last - first));
    for (Index i = first; i < last; ++i) {
        values[static_cast<std::size_t>(i - first)] = points[3 * i + axis];
    }
    double cut = LEVEL::median(values.data(), last - first);
    if (cut > low) {
        return cut;
    }
    cut = FAR;
    for (Index i = first; i < last; ++i) {
        const double value = points[3 * i + axis];
        if (low < value && value < cut) {
            cut = value;
        }
    }
    return cut;
}

int longest_side(const Box& box) {
    int axis = 0;
    for (int other = 1; other < 3; ++other) {
        if (box.high[other] - box.low[other] > box.high[axis] - box.low[axis]) {
            axis = other;
        }
    }
    return axis;
}

// Moves points to the other buffer, those below the cut first, each part in its order.
void part(const Points& points, Index first, Index middle, Index last, int axis, double cut) {
    Index below = first, above = middle;
    for (Index i = first; i < last; ++i) {
        // Without a branch, which could not be predicted.
        const double* from = points.from + 3 * i;
        const Index is_below = from[axis] < cut ? 1 : 0;
        const Index target = above + ((below - above) & -is_below);
        double* to = points.to + 3 * target;
        to[0] = from[0];
        to[1] = from[1];
        to[2] = from[2];
        points.index_to[target] = points.index[i];
        below += is_below;
        above += 1 - is_below;
    }
}

// Cuts a node. Returns where the second part begins, or `first` where all points coincide, and
// nothing is moved; and the patience that is left.
Cut cut_node(const Points& points, Index first, Index last, const Box& box, Index patience) {
    const int axis = longest_side(box);
    const double low = box.low[axis], high = box.high[axis];
    // `!` is for no points at all: the difference of two infinities is no number.
    if (low == high || !(low < high)) {
        return {first, patience};
    }
    // Halved first, lest the sum overflow; rounded down to `low`, it would leave nothing below.
    double cut = 0.5 * low + 0.5 * high;
    if (cut <= low) {
        cut = high;
    }
    Index left = count_below(points.from, first, last, axis, cut);
    if (LOPSIDED * std::min(left, last - first - left) < last - first) {
        if (patience > 0) {
            --patience;
        } else {
            cut = find_middle(points.from, first, last, axis, low);
            left = count_below(points.from, first, last, axis, cut);
        }
    }
    part(points, first, first + left, last, axis, cut);
    return {first + left, patience};
}

// The nodes of a tree that grows.
struct Nodes {
    std::vector<double> low, high;
    std::vector<Index> first, last, child;

    Index add(Index from, Index to) {
        low.insert(low.end(), 3, FAR);
        high.insert(high.end(), 3, -FAR);
        first.push_back(from);
        last.push_back(to);
        child.push_back(-1);
        return static_cast<Index>(child.size()) - 1;
    }
    void set_box(Index node, const Box& box) {
        std::copy(box.low, box.low + 3, low.begin() + 3 * node);
        std::copy(box.high, box.high + 3, high.begin() + 3 * node);
    }
    OwnedTree owned() {
        const std::array<Index, 2> shape{static_cast<Index>(child.size()), 3};
        return {Owned<double, 2>(std::move(low), shape), Owned<double, 2>(std::move(high), shape),
                Owned<Index>(std::move(first)), Owned<Index>(std::move(last)),
                Owned<Index>(std::move(child))};
    }
};

void check_buffers(const Buffers& buffers, Index first, Index last) {
    const Index count = buffers.points.size();
    check(buffers.points.shape[1] == 3 && buffers.spare_points.shape == buffers.points.shape &&
              buffers.index.size() == count && buffers.spare_index.size() == count,
          "both buffers must hold as many points (N, 3) and indices");
    check_range(first, last, count);
}

}  // namespace

std::tuple<Index, Index> halve_node(Buffers buffers, Index first, Index last, bool in_spare,
                                    Index patience) {
    check_buffers(buffers, first, last);
    const Points points = points_of(buffers, in_spare);
    const Cut cut = cut_node(points, first, last, bound(points.from, first, last), patience);
    return {cut.middle, cut.patience};
}

// Cuts points down to leaves, which end up in the first buffer.
OwnedTree grow_tree(Buffers buffers, Index first, Index last, bool in_spare, Index patience) {
    struct Waiting {
        Index node;
        bool in_spare;
        Index patience;
    };
    check_buffers(buffers, first, last);
    Nodes nodes;
    std::vector<Waiting> stack{{nodes.add(first, last), in_spare, patience}};
    while (!stack.empty()) {
        const Waiting next = stack.back();
        stack.pop_back();
        const std::size_t node = static_cast<std::size_t>(next.node);
        const Index i = nodes.first[node], j = nodes.last[node];
        const Points points = points_of(buffers, next.in_spare);
        const Box box = bound(points.from, i, j);
        nodes.set_box(next.node, box);
        Cut cut{i, next.patience};
        if (j - i > LEVEL::LEAF) {
            cut = cut_node(points, i, j, box, next.patience);
        }
        if (cut.middle == i) {
            if (next.in_spare) {
                std::copy(points.from + 3 * i, points.from + 3 * j, points.to + 3 * i);
                std::copy(points.index + i, points.index + j, points.index_to + i);
            }
            continue;
        }
        nodes.child[node] = nodes.add(i, cut.middle);
        nodes.add(cut.middle, j);
        for (Index side = 0; side < 2; ++side) {
            stack.push_back({nodes.child[node] + side, !next.in_spare, cut.patience});
        }
    }
    return nodes.owned();
}

// Returns the tree without the points that are taken out. Now the points of node n begin at
// first[n] and end at last[n]; `xyz` are those that are left.
OwnedTree prune_tree(Tree tree, View<const Index> first, View<const Index> last,
                     View<const double, 2> xyz) {
    check_tree(tree, tree.last.size() > 0 ? tree.last[0] : 0);
    check(first.size() == tree.child.size() && last.size() == first.size() && xyz.shape[1] == 3,
          "nodes must be as many as before, and points (N, 3)");
    for (Index node = 0; node < first.size(); ++node) {
        check_range(first[node], last[node], xyz.size());
    }
    Nodes nodes;
    std::vector<Index> old{0}, stack{nodes.add(0, 0)};
    while (!stack.empty()) {
        const std::size_t node = static_cast<std::size_t>(stack.back());
        stack.pop_back();
        Index was = old[node];
        // A node with an empty child gives way to its other child.
        while (tree.child[was] >= 0 && last[was] - first[was] > LEVEL::LEAF) {
            const Index one = tree.child[was], other = one + 1;
            if (first[one] < last[one] && first[other] < last[other]) {
                break;
            }
            was = first[one] < last[one] ? one : other;
        }
        nodes.first[node] = first[was];
        nodes.last[node] = last[was];
        if (tree.child[was] >= 0 && last[was] - first[was] > LEVEL::LEAF) {
            nodes.child[node] = static_cast<Index>(nodes.child.size());
            for (Index side = 0; side < 2; ++side) {
                old.push_back(tree.child[was] + side);
                stack.push_back(nodes.add(0, 0));
            }
        }
    }
    for (Index node = static_cast<Index>(nodes.child.size()) - 1; node >= 0; --node) {
        const std::size_t n = static_cast<std::size_t>(node);
        if (nodes.child[n] < 0) {
            nodes.set_box(node, bound(xyz.data, nodes.first[n], nodes.last[n]));
            continue;
        }
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::size_t one = 3 * static_cast<std::size_t>(nodes.child[n]) + axis;
            nodes.low[3 * n + axis] = std::min(nodes.low[one], nodes.low[one + 3]);
            nodes.high[3 * n + axis] = std::max(nodes.high[one], nodes.high[one + 3]);
        }
    }
    return nodes.owned();
}

}  // namespace lidar
