// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What may have mirrored a point: a plane through nearer returns around it that its beam passes.
// Naive twin: pane() in test/naive/scan_pattern.py.

#include <algorithm>
#include <cmath>

#include "pattern_trees.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr int COLUMNS = 8, TRIPLES = 8;  // returns on either side of a line; planes that are tried
constexpr int ALONG = 2 * COLUMNS + 1, MOST = static_cast<int>(2 * RINGS + 1) * ALONG;
constexpr float REACH = 1.6F * COLUMNS;               // steps up to which returns count
constexpr float NEARER = 0.98F, NEARER_M = 0.15F;     // a nearer range: share of its own, less m
constexpr float OFF_M = 0.03F, OFF_SHARE = 0.004F;    // off a plane: metres, and of the range
constexpr float BEHIND_M = 0.2F, MIN_COSINE = 0.15F;  // behind it; between its beam and the normal
constexpr float MIN_NEARER = 0.5F, MIN_ON = 0.7F;     // shares of returns: nearer; of these, on it
constexpr float MAX_HOLE = 2, HOLE_M = 0.02F;         // spacings of beams; metres added to one
constexpr int LEAST = 6;                              // returns of a plane

// The nearer returns around a point, metres along its beam, along its ring, and across the rings;
// and a plane: all x with m · x = 1, so that the beam meets it at 1 ÷ m[0].
struct Pane {
    float x[MOST], y[MOST], z[MOST], most_off[MOST];
    float m[3], length;     // of m
    int count = 0, on = 0;  // returns, and those on the plane

    void add(const Pattern& pattern, Index line, Index place, Index centre, float up, float most) {
        const float reach = REACH * pattern.step[line], turn = pattern.turn[line];
        for (Index k = centre - COLUMNS; k <= centre + COLUMNS; ++k) {
            const float along = static_cast<float>(pattern.phase[k] - pattern.phase[place]) / turn;
            const float range = pattern.range[k];
            if (range < most && std::abs(along) <= reach) {
                x[count] = range * (1 - 0.5F * (along * along + up * up));
                y[count] = range * along;
                z[count] = range * up;
                most_off[count++] = OFF_M + OFF_SHARE * range;
            }
        }
    }
    float off(int k) const {
        return m[0] * x[k] + m[1] * y[k] + m[2] * z[k] - 1;
    }
    bool has(int k) const {
        return std::abs(off(k)) < most_off[k] * length;
    }
    // Puts the plane through three returns; returns whether the point, at a range, is behind it.
    bool put(int i, int j, int k, float range) {
        const float a[] = {x[j] - x[i], y[j] - y[i], z[j] - z[i]};
        const float b[] = {x[k] - x[i], y[k] - y[i], z[k] - z[i]};
        const float normal[] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                                a[0] * b[1] - a[1] * b[0]};
        const float from = normal[0] * x[i] + normal[1] * y[i] + normal[2] * z[i];
        for (int n = 0; n < 3; ++n) {
            m[n] = normal[n] / from;
        }
        length = std::sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
        return m[0] > MIN_COSINE * length && range * m[0] - 1 > BEHIND_M * length;
    }
    // Tries planes through returns that are a third of all apart, up to one with most returns.
    bool find(float range) {
        const int third = count / 3;
        for (int n = 0; n < TRIPLES && count >= LEAST; ++n) {
            const int i = n * third / TRIPLES;
            if (!put(i, i + third, i + 2 * third, range)) {
                continue;
            }
            on = 0;
            for (int k = 0; k < count; ++k) {
                on += has(k) ? 1 : 0;
            }
            if (static_cast<float>(on) >= MIN_ON * static_cast<float>(count)) {
                return true;
            }
        }
        return false;
    }
    // Writes the features; `share` of the returns around the point are nearer.
    void write(float share, float range, float spacing, Index column, View<float, 2> out) const {
        const float hit = 1 / m[0], some = static_cast<float>(on);
        float square = 0, hole = INFINITY;
        for (int k = 0; k < count; ++k) {
            if (has(k)) {
                const float away = off(k) / length, before = x[k] - hit;
                square += away * away;
                hole = std::min(hole, before * before + y[k] * y[k] + z[k] * z[k]);
            }
        }
        hole = std::sqrt(hole) / (hit * spacing + HOLE_M);
        const float values[PANE_FEATURES] = {share,
                                             some / static_cast<float>(count),
                                             std::sqrt(square / some),
                                             std::abs(m[2]) / length,
                                             (range * m[0] - 1) / length,
                                             m[0] / length,
                                             hole};
        for (Index row = 0; row < PANE_FEATURES && hole <= MAX_HOLE; ++row) {
            out(row, column) = values[row];
        }
    }
};

}  // namespace

void find_panes(Prepared prepared, View<const Index> places, Index begin, Index end,
                View<float, 2> out) {
    const Pattern& pattern = prepared.pattern;
    const Index lines = pattern.first.size(), size = pattern.order.size();
    check_pattern(pattern, 0, lines);
    check_range(begin, end, places.size());
    check(out.size() == PANE_FEATURES && out.shape[1] == places.size() &&
              prepared.near.size() == 2 * RINGS && prepared.near.shape[1] == size,
          "features must be of all places, and places beside (4, M)");
    Index line = 0;
    for (Index n = begin; n < end; ++n) {
        const Index place = places[n];
        while (line < lines && place >= pattern.last[line]) {
            ++line;
        }
        check(line < lines && place >= pattern.first[line], "places must be of points, ascending");
        const float range = pattern.range[place], most = NEARER * range - NEARER_M;
        Index there = 0, nearer = 0, centres[2 * RINGS + 1] = {place};
        float ups[2 * RINGS + 1] = {};
        for (Index ring = 0; ring < 2 * RINGS; ++ring) {
            centres[ring + 1] = prepared.near(ring, place);
            ups[ring + 1] = pattern.beside(ring, line) * (ring < RINGS ? -1.0F : 1.0F);
        }
        for (const Index centre : centres) {
            check(centre < size - COLUMNS, "places beside must lie within the pattern");
            there += centre >= PAD ? ALONG : 0;  // otherwise there is no such ring
            for (Index k = centre - COLUMNS; k <= centre + COLUMNS && centre >= PAD; ++k) {
                nearer += (pattern.order[k] >= 0) & (pattern.range[k] < most) ? 1 : 0;
            }
        }
        const float share = static_cast<float>(nearer) / static_cast<float>(there);
        if (share < MIN_NEARER) {
            continue;
        }
        Pane pane;
        for (Index ring = 0; ring <= 2 * RINGS; ++ring) {
            if (centres[ring] >= PAD) {
                pane.add(pattern, line, place, centres[ring], ups[ring], most);
            }
        }
        if (pane.find(range)) {
            const float spacing = std::sqrt(pattern.step[line] * pattern.gap[line]);
            pane.write(share, range, spacing, n, out);
        }
    }
}

}  // namespace LEVEL
}  // namespace lidar
