// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Points into cells: lines in the order of their phase, and shots, see placed_pattern.py.
//
// Textbook twins: test/naive/scan_pattern.py, test/naive/profile_pattern.py.

#include <algorithm>
#include <cmath>
#include <utility>

#include "scan_pattern.hpp"

namespace lidar {
namespace {

using LEVEL::MIN_RANGE_M;
using LEVEL::SAME_SHOT;

constexpr Index MAX_MOVES = 16;  // for each return of a line, one by one; beyond, NumPy sorts it

// Returns whether a return comes before another one: by phase, then range, then position.
bool is_before(const OrderedLines& lines, View<const double> phase, Index a, Index b) {
    if (phase[a] != phase[b]) {
        return phase[a] < phase[b];
    }
    const Index i = lines.order[a], j = lines.order[b];
    if (lines.distance[i] != lines.distance[j]) {
        return lines.distance[i] < lines.distance[j];
    }
    for (int axis = 0; axis < 3; ++axis) {
        if (lines.xyz(i, axis) != lines.xyz(j, axis)) {
            return lines.xyz(i, axis) < lines.xyz(j, axis);
        }
    }
    return false;
}

bool same_place(View<const double, 2> xyz, Index i, Index j) {
    return xyz(i, 0) == xyz(j, 0) && xyz(i, 1) == xyz(j, 1) && xyz(i, 2) == xyz(j, 2);
}

}  // namespace

// Sorts lines by insertion; returns those in which too many returns would have to move.
Owned<Index> sort_nearly(OrderedLines lines, Index begin, Index end, View<double> phase,
                         View<double> up) {
    check_lines(lines, begin, end, {phase, up});
    std::vector<Index> unsorted;
    for (Index line = begin; line < end; ++line) {
        const Index low = lines.first[line], high = lines.first[line + 1];
        Index left = MAX_MOVES * (high - low);
        for (Index k = low + 1; k < high; ++k) {
            if (phase[k] > phase[k - 1]) {
                continue;
            }
            Index m = k;
            for (; m > low && is_before(lines, phase, m, m - 1); --m) {
                std::swap(phase[m], phase[m - 1]);
                std::swap(lines.order[m], lines.order[m - 1]);
                std::swap(up[m], up[m - 1]);
            }
            left -= k - m;
            if (left < 0) {
                unsorted.push_back(line);
                break;
            }
        }
    }
    return Owned<Index>(std::move(unsorted));
}

// Gives all returns of a shot the phase of the first; sorts them by range and position.
void join_shots(OrderedLines lines, Index begin, Index end, View<double> phase, View<double> up) {
    check_lines(lines, begin, end, {phase, up});
    for (Index line = begin; line < end; ++line) {
        Index start = lines.first[line];
        for (Index k = start + 1; k < lines.first[line + 1]; ++k) {
            if (phase[k] - phase[start] >= SAME_SHOT) {
                start = k;
                continue;
            }
            phase[k] = phase[start];
            for (Index m = k; m > start && is_before(lines, phase, m, m - 1); --m) {
                std::swap(lines.order[m], lines.order[m - 1]);
                std::swap(up[m], up[m - 1]);
            }
        }
    }
}

// Writes which return each sorted one is a copy of, or its own index; returns the copies' number.
//
// Of several at one place the brightest is the original, so that the order given does not matter;
// one of unknown intensity only where all are unknown. Without `intensity` (0,) all are.
Index find_line_copies(OrderedLines lines, View<const double> phase, View<const float> intensity,
                       View<Index> original) {
    const Index number = lines.first.size() - 1;
    check_lines(lines, 0, number, {phase});
    check(original.size() == lines.order.size(), "originals must be as many as points in order");
    check(intensity.size() == 0 || intensity.size() == lines.xyz.size(),
          "intensities must be as many as points, or none");
    Index count = 0;
    for (Index line = 0; line < number; ++line) {
        Index begin = lines.first[line];
        for (Index k = begin; k < lines.first[line + 1]; ++k) {
            const Index i = lines.order[k];
            original[k] = i;
            if (!(k > begin && phase[k] == phase[begin] &&
                  same_place(lines.xyz, i, lines.order[begin]))) {
                begin = k;
                continue;
            }
            ++count;
            Index best = original[begin];
            if (intensity.size() > 0 && !std::isnan(intensity[i])) {
                best = intensity[best] >= intensity[i] ? best : i;
            }
            std::fill(original.data + begin, original.data + k + 1, best);
        }
    }
    return count;
}

// Writes a range of the lines into their cells; `rank` is the line of each, from the lowest on.
void place_lines(OrderedLines lines, View<const double> phase, View<const Index> rank, Index begin,
                 Index end, Cells cells) {
    const Index number = lines.first.size() - 1, count = cells.order.size();
    check_range(begin, end, rank.size());
    check(lines.first.size() > 0 && lines.order.size() > 0 && phase.size() == lines.order.size() &&
              lines.distance.size() == lines.xyz.size(),
          "points must have positions and phases");
    check(lines.xyz.shape[1] == 3 && 0 <= lines.order[0] && lines.order[0] < lines.xyz.size() &&
              0 <= lines.first[0] && lines.first[0] < lines.order.size(),
          "there must be a first point");
    check(cells.x.size() == count && cells.y.size() == count && cells.z.size() == count &&
              cells.range.size() == count && cells.phase.size() == count,
          "cells must be as many");
    check(cells.first.size() == rank.size() && cells.last.size() == rank.size(),
          "ranks must be as many as lines of cells");
    check_indices(View<const Index>{rank.data + begin, {end - begin}}, number);
    // The sorted points do not depend on the order given, and neither does the first of them.
    const double* const some = lines.xyz.row(lines.order[0]);
    const double origin[] = {std::floor(some[0]), std::floor(some[1]), std::floor(some[2])};
    const double start = phase[lines.first[0]];
    for (Index line = begin; line < end; ++line) {
        const Index source = lines.first[rank[line]], target = cells.first[line];
        const Index size = cells.last[line] - target;
        check(size <= 0 || (0 <= target && cells.last[line] <= count), "lines must have cells");
        if (size <= 0) {
            continue;
        }
        check_points(lines.xyz, lines.order, source, source + size);
        for (Index k = 0; k < size; ++k) {
            const Index i = lines.order[source + k], to = target + k;
            cells.order[to] = i;
            cells.x[to] = static_cast<float>(lines.xyz(i, 0) - origin[0]);
            cells.y[to] = static_cast<float>(lines.xyz(i, 1) - origin[1]);
            cells.z[to] = static_cast<float>(lines.xyz(i, 2) - origin[2]);
            cells.range[to] = static_cast<float>(lines.distance[i]);
            cells.phase[to] = phase[source + k] - start;
        }
    }
}

// Writes the distance (N,) of each point, as given, from where the profile scanner was, metres.
//
// `position` (L, 3) is that of each line, `moved` (N, 3) how far from there each point in order was
// measured.
void write_ranges(View<const double, 2> xyz, View<const Index> order, View<const Index> first,
                  View<const double, 2> position, View<const double, 2> moved,
                  View<double> distance) {
    const Index lines = position.size();
    check_starts(first, 0, lines, order.size());
    check_points(xyz, order, first[0], first[lines]);
    check(position.shape[1] == 3 && moved.shape[1] == 3 && moved.size() == order.size() &&
              distance.size() == xyz.size(),
          "positions must be (L, 3), and of each point (N, 3) and (N,)");
    for (Index line = 0; line < lines; ++line) {
        for (Index k = first[line]; k < first[line + 1]; ++k) {
            const Index i = order[k];
            double square = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const double off = xyz(i, axis) - position(line, axis) - moved(k, axis);
                square += off * off;
            }
            distance[i] = std::max(std::sqrt(square), MIN_RANGE_M);
        }
    }
}

}  // namespace lidar
