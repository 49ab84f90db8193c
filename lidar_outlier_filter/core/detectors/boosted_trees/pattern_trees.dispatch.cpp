// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Both passes of the trees over a scan pattern: the only place that gathers windows, writes
// features and adds trees up.

#include <algorithm>
#include <cstring>

#include "pattern_trees.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr int VECTORS = 2, POINTS = VECTORS * WIDTH;  // side by side
constexpr int EVERY_FEATURE = WINDOW_FEATURES + PROFILE_FEATURES + SECOND_FEATURES;

struct Judged {
    bool profile, second;
    const Prepared& prepared;
    const FirstPass& first;
    View<const bool> asked;
    const Trees& trees;
    View<const Index> column;
    View<float> odds;
    View<float, 2> values;
};

// Points of a line that are asked for; spare places are of any points near by.
struct Asked {
    std::int32_t places[POINTS];
    int count = 0;
    bool in_step = false;

    // Finds the next ones from k on; returns where those behind them begin.
    Index find(const bool* asked, Index k, Index end) {
        count = 0;
        while (k < end && !asked[k]) {
            ++k;
        }
        while (k < end && count < POINTS) {
            places[count] = static_cast<std::int32_t>(k);
            count += asked[k] ? 1 : 0;
            ++k;
        }
        in_step = count > 0 && places[count - 1] - places[0] == count - 1;
        for (int lane = count; lane < POINTS && count > 0; ++lane) {
            places[lane] = in_step ? places[0] + lane : places[count - 1];
        }
        return k;
    }
};

// Writes the features of a vector of points, those of the second pass behind those of the first.
//
// PLAIN: of the first pass of a spinning sensor, which takes longest, all points are near. Others
// share one function: each takes seconds to compile.
template <bool PLAIN>
void write_features(const Judged& judged, const Rows& rows, const Line& line,
                    const std::int32_t* at, Features<POINTS> to) {
    const Places points(load(at));
    const Points mine(rows, line, points);
    Returns returns;
    write_window(line, gather<PLAIN, !PLAIN>(rows, line, points, mine, PLAIN ? nullptr : &returns),
                 mine, to);
    const View<const float, 2> bright = judged.prepared.pattern.bright;
    to.set(BRIGHT, points.of(bright.row(0)));
    to.set(RANK, points.of(bright.row(1)));
    if constexpr (PLAIN) {
        return;
    }
    Features<POINTS> more{to.values + WINDOW_FEATURES};
    if (judged.profile) {
        write_profile(line, judged.prepared, points, mine.range, returns, more);
        more.values += PROFILE_FEATURES;
    }
    if (judged.second) {
        write_means(line, judged.first.score.data, points, mine, returns, more);
        write_suspects(judged.first, points, returns, more);
    }
}

template <bool PLAIN>
void judge_line(const Judged& judged, const Rows& rows, Index number) {
    const Pattern& pattern = judged.prepared.pattern;
    const Line line(pattern, number);
    float found[EVERY_FEATURE][POINTS], total[POINTS];
    Asked some;
    for (Index k = pattern.first[number]; k < pattern.last[number];) {
        k = some.find(judged.asked.data, k, pattern.last[number]);
        // Each lane gets what it would get alone.
        const Index vectors = (some.count + WIDTH - 1) / WIDTH;
        for (Index n = 0; n < vectors; ++n) {
            const auto to = reinterpret_cast<float(*)[POINTS]>(&found[0][n * WIDTH]);
            write_features<PLAIN>(judged, rows, line, some.places + n * WIDTH, {to});
        }
        if (vectors == VECTORS) {
            add_vectors<VECTORS>(judged.trees, found, total);
        } else if (vectors > 0) {
            add_vectors<1>(judged.trees, found, total);
        }
        for (int lane = 0; lane < some.count; ++lane) {
            judged.odds[some.places[lane]] = total[lane];
        }
        for (int lane = 0; lane < some.count && judged.values.size() > 0; ++lane) {
            const Index column = judged.column[some.places[lane]];
            for (Index f = 0; f < judged.values.size(); ++f) {
                judged.values(f, column) = found[f][lane];
            }
        }
    }
}

// Returns whether all points of the windows of a line are near: see Line::plain.
bool are_plain(const Pattern& pattern, const Rows& rows, Index line) {
    bool plain = Line(pattern, line).plain;
    const Index low = std::max<Index>(line - RINGS, 0);
    const Index high = std::min<Index>(line + RINGS, pattern.first.size() - 1);
    for (Index beside = low; beside <= high; ++beside) {
        plain = plain && is_plain(rows, pattern.first[beside] - OWN, pattern.last[beside] + OWN);
    }
    return plain;
}

void judge_lines(const Judged& judged, Index begin, Index end) {
    const Rows rows(judged.prepared);
    for (Index line = begin; line < end; ++line) {
        if (!judged.profile && !judged.second && are_plain(judged.prepared.pattern, rows, line)) {
            judge_line<true>(judged, rows, line);
        } else {
            judge_line<false>(judged, rows, line);
        }
    }
}

void check_judged(const Judged& judged, Index begin, Index end) {
    const Index size = judged.prepared.pattern.order.size();
    const Index of_block = judged.prepared.of_block.size();
    check(judged.asked.size() == size && judged.odds.size() == size,
          "what is asked, and log-odds, must be (M,)");
    check(judged.prepared.rough.size() == size && judged.prepared.of_block.shape[1] == size &&
              (of_block == 0 || of_block == BLOCK_FEATURES),
          "roughness must be (M,), features of the block (0, M) or (6, M)");
    if (judged.second) {
        check(judged.first.score.size() == size && judged.first.share.size() == size &&
                  judged.first.before.size() == size + 1,
              "scores and shares of the first pass must be (M,), counts (M + 1,)");
    }
    const Index features = WINDOW_FEATURES + (of_block > 0 ? PROFILE_FEATURES : 0) +
                           (judged.second ? SECOND_FEATURES : 0);
    check_trees(judged.trees, features);
    const View<float, 2> values = judged.values;
    if (values.size() > 0) {
        check(values.size() <= features && judged.column.size() == size,
              "features must be known ones, and columns (M,)");
        const Pattern& pattern = judged.prepared.pattern;
        bool fits = true;
        for (Index line = begin; line < end; ++line) {
            for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
                const Index column = judged.column[k];
                fits &= !judged.asked[k] || (0 <= column && column < values.shape[1]);
            }
        }
        check(fits, "columns must lie within the features");
    }
}

}  // namespace

void judge_pattern(Prepared prepared, FirstPass first, bool second, View<const bool> asked,
                   Trees trees, View<const Index> column, Index begin, Index end, View<float> odds,
                   View<float, 2> values) {
    const Pattern& pattern = prepared.pattern;
    check_pattern(pattern, begin, end);
    check_beside(pattern, prepared.near, begin, end);
    const bool profile = prepared.of_block.size() > 0;
    const Judged judged{profile, second, prepared, first, asked, trees, column, odds, values};
    check_judged(judged, begin, end);
    judge_lines(judged, begin, end);
}

}  // namespace LEVEL
}  // namespace lidar
