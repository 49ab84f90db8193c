// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// How the head of a spinning sensor turns, see scan_pattern.py.
//
// Textbook twin: test/naive/scan_pattern.py.

#include <algorithm>
#include <cmath>
#include <limits>

#include "../kernels/select.hpp"
#include "arctangent.hpp"
#include "scan_pattern.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr Index SAMPLES = 64;  // returns of a ring that show its elevation, its step and its rate
// Parts of a rad that phases are rounded to, and a turn in them: so differences of phases are exact
// for half a million turns, and a turn is judged alike whenever it is.
constexpr double PHASE_PARTS = 1U << 30U;
constexpr double WHOLE_TURN = 6746518852.0 / PHASE_PARTS;  // the nearest to TURN

double wrap(double angle) {
    return angle - TURN * std::rint(angle / TURN);
}

}  // namespace

// Writes the azimuth of each point in order, rad, and the sine of its elevation; NaN without range.
void write_directions(OrderedLines lines, Index begin, Index end, View<double> azimuth,
                      View<double> up) {
    check_points(lines.xyz, lines.order, begin, end);
    check(lines.distance.size() == lines.xyz.size() && azimuth.size() == lines.order.size() &&
              up.size() == lines.order.size(),
          "ranges must be as many as points, and directions as many as in order");
    const double *const xyz = lines.xyz.data, *const distance = lines.distance.data;
    const Index* const order = lines.order.data;
    for (Index k = begin; k < end; ++k) {
        const Index i = order[k];
        const double far = distance[i];
        azimuth[k] = arctangent(xyz[3 * i + 1], xyz[3 * i]);
        up[k] = far > 0 ? xyz[3 * i + 2] / far : std::numeric_limits<double>::quiet_NaN();
    }
}

// Returns how fast the head turns, rad/ns: the median over some stretches of all rings; 0 of none.
//
// `azimuth` and `t` (N,) are in the order of lines: rad, ns.
double turning_rate(View<const double> azimuth, View<const Index> t, View<const Index> first) {
    const Index lines = first.size() - 1;
    check_starts(first, 0, lines, t.size());
    check(azimuth.size() == t.size(), "azimuths must be as many as times");
    std::vector<double> rates;
    rates.reserve(static_cast<std::size_t>(lines * SAMPLES));
    for (Index line = 0; line < lines; ++line) {
        const Index begin = first[line], end = first[line + 1];
        const Index stride = std::max((end - begin) / SAMPLES, LAG);
        Index taken = 0;
        for (Index k = begin; k < end - LAG && taken < SAMPLES; k += stride) {
            const Index span = t[k + LAG] - t[k];
            if (span <= 0) {
                continue;
            }
            double turned = 0;
            for (Index m = k; m < k + LAG; ++m) {
                turned += wrap(azimuth[m + 1] - azimuth[m]);
            }
            rates.push_back(turned / static_cast<double>(span));
            ++taken;
        }
    }
    return rates.empty() ? 0.0 : median(rates.data(), static_cast<Index>(rates.size()));
}

// Writes the angle turned, from the first return of all on; counts the steps not back.
//
// `phase` (N,) in rad, `steady` (L,) is added to; `rate` in rad/ns.
void unwrap_turns(View<const double> azimuth, View<const Index> t, View<const Index> first,
                  double rate, Index begin, Index end, View<double> phase, View<Index> steady) {
    check_starts(first, begin, end, t.size());
    check(
        azimuth.size() == t.size() && phase.size() == t.size() && steady.size() == first.size() - 1,
        "azimuths and phases must be as many as times");
    check(0 <= first[0] && (begin == end || first[0] < t.size()), "there must be a first return");
    if (begin == end) {
        return;
    }
    const double sign = rate > 0 ? 1.0 : -1.0, pace = std::abs(rate);
    const Index start = t[first[0]];
    const double base = sign * azimuth[first[0]];
    for (Index line = begin; line < end; ++line) {
        const Index from = first[line];
        if (from == first[line + 1]) {
            continue;
        }
        Index last = t[from];
        double expected = base + pace * static_cast<double>(last - start);
        for (Index k = from; k < first[line + 1]; ++k) {
            expected += pace * static_cast<double>(t[k] - last);
            const double mine = std::rint(sign * azimuth[k] * PHASE_PARTS) / PHASE_PARTS;
            phase[k] = mine + WHOLE_TURN * std::rint((expected - mine) / TURN);
            // Two returns of a shot differ by what their coordinates are rounded by.
            steady[line] += k == from || phase[k] >= phase[k - 1] - SAME_SHOT ? 1 : 0;
            expected = phase[k];
            last = t[k];
        }
    }
}

// Writes the median elevation (its sine) and the median step of each line, rad.
void typical_of_lines(View<const double> up, View<const double> phase, View<const Index> first,
                      View<double> elevation, View<double> step) {
    const Index lines = first.size() - 1;
    check_starts(first, 0, lines, phase.size());
    check(up.size() == phase.size() && elevation.size() == lines && step.size() == lines,
          "elevations must be as many as phases, and results as lines");
    double some[SAMPLES];
    for (Index line = 0; line < lines; ++line) {
        const Index begin = first[line], end = first[line + 1];
        const Index stride = std::max<Index>((end - begin) / SAMPLES, 1);
        Index count = 0;
        for (Index k = begin; k < end && count < SAMPLES; k += stride) {
            // Nearer than what squares to more than 0, a return has no elevation.
            if (!std::isnan(up[k])) {
                some[count++] = up[k];
            }
        }
        elevation[line] = count > 0 ? median(some, count) : 0.0;
        count = 0;
        for (Index k = begin + 1; k < end && count < SAMPLES; k += stride) {
            if (phase[k] > phase[k - 1]) {
                some[count++] = phase[k] - phase[k - 1];
            }
        }
        step[line] = count > 0 ? median(some, count) : 1.0;
    }
}

}  // namespace LEVEL
}  // namespace lidar
