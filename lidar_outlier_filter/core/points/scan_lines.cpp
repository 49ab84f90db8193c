// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Scan lines and their segments, see scan_lines.py. Twins: test/naive/alpha_beta_gamma.py.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "../kernels/select.hpp"
#include "points.hpp"

namespace lidar {
namespace {

constexpr double PI = 3.141592653589793;

// Returns the shorter way round; half a turn keeps its sign.
double wrapped(double step) {
    if (step > PI) {
        return step - 2 * PI;
    }
    return step < -PI ? step + 2 * PI : step;
}

double sign(double value) {
    return value > 0 ? 1.0 : (value < 0 ? -1.0 : value);
}

// Refuses beginnings of lines, and where the last ends, that are not in order within the points.
void check_lines(View<const Index> first, Index points) {
    check(first.size() > 0, "first must say where the last line ends");
    bool fits = first[0] >= 0 && first[first.size() - 1] <= points;
    for (Index line = 1; line < first.size(); ++line) {
        fits &= first[line - 1] <= first[line];
    }
    check(fits, "lines must begin in order within the points");
}

}  // namespace

// Sorts points stably by line with a counting sort; returns which lines go back in time.
//
// Lines are numbered from `low`; line number k + low begins at first[k] of the order, and the last
// entry is N.
Owned<Index> sort_by_line(View<const Index> line, View<const Index> t, Index low, View<Index> order,
                          View<Index> first) {
    const Index points = line.size(), lines = first.size() - 1;
    check(t.size() == points && order.size() == points, "line, t and order must be as long");
    check(lines >= 0, "first must have an entry more than there are lines");
    std::fill(first.data, first.data + first.size(), 0);
    Index earliest = std::numeric_limits<Index>::max();
    for (Index i = 0; i < points; ++i) {
        // Without a sign, what is below `low` is far above all lines.
        const auto number = static_cast<std::uint64_t>(line[i]) - static_cast<std::uint64_t>(low);
        check(number < static_cast<std::uint64_t>(lines), "lines must be numbered from low on");
        first[static_cast<Index>(number) + 1] += 1;
        earliest = std::min(earliest, t[i]);
    }
    for (Index j = 0; j < lines; ++j) {
        first[j + 1] += first[j];
    }
    struct Progress {  // of a line: where its next point goes, and the time of the last
        Index rank, latest;
        bool back;
    };
    std::vector<Progress> of(static_cast<std::size_t>(lines));
    for (Index j = 0; j < lines; ++j) {
        of[static_cast<std::size_t>(j)] = {first[j], earliest, false};
    }
    for (Index i = 0; i < points; ++i) {
        Progress& one = of[static_cast<std::size_t>(line[i] - low)];
        order[one.rank++] = i;
        one.back |= t[i] < one.latest;
        one.latest = t[i];
    }
    std::vector<Index> back;
    for (Index j = 0; j < lines; ++j) {
        if (of[static_cast<std::size_t>(j)].back) {
            back.push_back(j);
        }
    }
    return Owned<Index>(std::move(back));
}

// Joins neighbours of one line unless a gap parts them: writes links, -1 where there is none.
//
// The shot interval of a line is the median of its positive time differences, 0 if it has none; a
// gap is longer than `gap_factor` times that.
void link_lines(View<const Index> t, View<const Index> first, double gap_factor,
                View<double> interval, View<Index> before, View<Index> after) {
    check_lines(first, t.size());
    const Index lines = first.size() - 1;
    check(interval.size() == lines, "interval must have an entry for each line");
    check(before.size() == t.size() && after.size() == t.size(), "links must be as many as points");
    std::fill(before.data, before.data + before.size(), -1);
    std::fill(after.data, after.data + after.size(), -1);
    std::vector<double> differences(static_cast<std::size_t>(t.size()));
    for (Index line = 0; line < lines; ++line) {
        const Index begin = first[line], end = first[line + 1];
        Index count = 0;
        for (Index i = begin + 1; i < end; ++i) {
            const Index difference = t[i] - t[i - 1];
            differences[static_cast<std::size_t>(count)] = static_cast<double>(difference);
            count += difference > 0 ? 1 : 0;
        }
        interval[line] = count > 0 ? LEVEL::median(differences.data(), count) : 0.0;
        const double longest = gap_factor * interval[line];
        for (Index i = begin + 1; i < end; ++i) {
            if (static_cast<double>(t[i] - t[i - 1]) <= longest) {
                after[i - 1] = i;
                before[i] = i - 1;
            }
        }
    }
}

// Numbers the lines by turns of the scan angle, radians, as LineCounter.by_angle says.
//
// Steps up to `noise` may be noise. Returns the number of the last line and the new Turn.
std::tuple<Index, double, double, double> count_turns(View<const double> angle,
                                                      View<const bool> valid, double noise,
                                                      Index line, Turn turn, View<Index> result) {
    check(valid.size() == angle.size() && result.size() == angle.size(),
          "angle, valid and result must be as long");
    for (Index i = 0; i < angle.size(); ++i) {
        if (valid[i] && std::isfinite(angle[i])) {
            // The first angle ever is no wrap: a comparison with NaN is false.
            const double step = wrapped(angle[i] - turn.before);
            const double sense = std::abs(turn.travel) < noise ? 0.0 : sign(turn.travel);
            const double ahead = sense * wrapped(angle[i] - turn.furthest);
            if (sense * step < -noise) {
                line += 1;
                turn.furthest = angle[i];
            } else if (sense == 0 || !(-noise <= ahead && ahead <= 0)) {
                line += std::abs(angle[i] - turn.furthest) > PI ? 1 : 0;
                turn.furthest = angle[i];
            }
            if (std::abs(step) <= noise) {
                turn.travel = std::min(std::max(turn.travel + step, -PI), PI);
            }
            turn.before = angle[i];
        }
        result[i] = line;
    }
    return {line, turn.before, turn.furthest, turn.travel};
}

}  // namespace lidar
