// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The windows of sections: a core and a rim. Textbook twin: section_window() in
// test/naive/quadric.py.
#pragma once

#include <algorithm>
#include <cstring>
#include <limits>
#include <vector>

#include "../../kernels/vectors.hpp"
#include "quadric.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr double MARGIN = 0.25;  // of a core's largest extent: how far the rim reaches
inline constexpr double ENOUGH = 1.5;   // times the points of the core: what a window has at least
// Of the largest extent of the cloud: the margin around a single place.
inline constexpr double SMALLEST = 1.0 / (1 << 20);

// Room for the search of one thread.
struct SectionRoom {
    std::vector<Index> found;  // the points of the window, and one more place
    std::vector<Index> stack;  // nodes to visit

    SectionRoom(const Tree& tree, View<const Index> cores, Index section) : stack(2) {
        Index most = 0;
        for (Index i = 0; i < cores.size(); ++i) {
            most = std::max(most, tree.last[cores[i]] - tree.first[cores[i]]);
        }
        const Index points = tree.last[0];
        found.resize(static_cast<std::size_t>(std::min(most + RIM * section, points) + 1));
    }
};

// A box, and tests of points against it, as many at once as a register has elements.
class PointTest {
public:
    PointTest(View<const double, 2> xyz, const Box& box) : xyz_(xyz) {
        for (int k = 0; k < 3 * DOUBLES; ++k) {
            low_[k / DOUBLES][k % DOUBLES] = box.low[k % 3];
            high_[k / DOUBLES][k % DOUBLES] = box.high[k % 3];
        }
    }

    // Writes of DOUBLES points from the first on whether they are inside: 0 or 1.
    [[gnu::always_inline]] void test(Index first, Index* inside) const {
        double copied[3 * DOUBLES] = {};
        const double* from = xyz_.row(first);
        if (first + DOUBLES > xyz_.size()) {  // behind the last are no more
            std::copy(from, xyz_.row(xyz_.size()), copied);
            from = copied;
        }
        std::int64_t each[3 * DOUBLES];
        for (int k = 0; k < 3; ++k) {
            const Doubles values = load(from + k * DOUBLES);
            const Wides within = (low_[k] <= values) & (values <= high_[k]);
            std::memcpy(each + k * DOUBLES, &within, sizeof within);
        }
        for (Index k = 0; k < DOUBLES; ++k) {
            inside[k] = each[3 * k] & each[3 * k + 1] & each[3 * k + 2] & 1;
        }
    }

private:
    View<const double, 2> xyz_;
    Doubles low_[3], high_[3];  // of x, y and z in turn, as in the rows
};

// Returns whether the box of a node and another have no place in common.
[[gnu::always_inline]] inline bool is_apart(const Tree& tree, Index node, const Box& box) {
    const double* low = tree.low.row(node);
    const double* high = tree.high.row(node);
    bool apart = false;
    for (int axis = 0; axis < 3; ++axis) {
        apart |= (low[axis] > box.high[axis]) | (high[axis] < box.low[axis]);
    }
    return apart;
}

// Visits the points in the box of the core grown by a margin, faces included, in tree order.
//
// All points of the core, and of the others every `stride`-th, are found while there is room;
// returns their number.
inline Index visit(View<const double, 2> xyz, const Tree& tree, Index core, double margin,
                   Index stride, SectionRoom& room) {
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
        box.low[axis] = tree.low(core, axis) - margin;
        box.high[axis] = tree.high(core, axis) + margin;
    }
    const PointTest points(xyz, box);
    const auto places = static_cast<Index>(room.found.size());
    Index count = 0, rim = 0;
    std::size_t waiting = 1;
    Index* found = room.found.data();
    room.stack[0] = 0;
    while (waiting > 0) {
        const Index node = room.stack[--waiting], child = tree.child[node];
        if (is_apart(tree, node, box)) {
            continue;
        }
        if (node == core) {  // all of it is inside
            for (Index i = tree.first[node]; i < tree.last[node]; ++i) {
                found[std::min(count++, places - 1)] = i;
            }
            continue;
        }
        if (child >= 0) {
            if (waiting + 2 > room.stack.size()) {
                room.stack.resize(2 * room.stack.size());
            }
            room.stack[waiting++] = child + 1;
            room.stack[waiting++] = child;
            continue;
        }
        for (Index first = tree.first[node]; first < tree.last[node]; first += DOUBLES) {
            Index inside[DOUBLES];
            points.test(first, inside);
            const Index end = std::min(first + DOUBLES, tree.last[node]);
            // Without a branch, which a processor could not predict.
            for (Index i = first; i < end; ++i) {
                const Index is_in = inside[i - first];
                rim += is_in;
                const bool skipped = stride > 1 && (rim - 1) % stride > 0;
                found[std::min(count, places - 1)] = i;
                count += skipped ? 0 : is_in;
            }
        }
    }
    return count;
}

// Finds the points of a core's window, in tree order; returns their number.
inline Index find_points(View<const double, 2> xyz, const Tree& tree, Index core, Index section,
                         SectionRoom& room) {
    const Index size = tree.last[core] - tree.first[core];
    const auto extent_of = [&](Index node) {
        double extent = -std::numeric_limits<double>::infinity();
        for (int axis = 0; axis < 3; ++axis) {
            extent = std::max(extent, tree.high(node, axis) - tree.low(node, axis));
        }
        return extent;
    };
    const double extent = extent_of(core), most = extent_of(0);
    double margin = extent > 0 ? MARGIN * extent : SMALLEST * most;
    const auto grown = static_cast<Index>(ENOUGH * static_cast<double>(size));
    const Index enough = std::min(xyz.size(), std::max(section, grown));
    Index count = visit(xyz, tree, core, margin, 1, room);
    while (count < enough && margin <= most) {
        margin *= 2;
        count = visit(xyz, tree, core, margin, 1, room);
    }
    const Index rim = count - size;
    if (rim > RIM * section) {
        const Index stride = (rim + RIM * section - 1) / (RIM * section);
        count = visit(xyz, tree, core, margin, stride, room);
    }
    return count;
}

}  // namespace LEVEL
}  // namespace lidar
