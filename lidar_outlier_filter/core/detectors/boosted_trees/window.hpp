// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The window of a point, the returns around it in the scan pattern: the five before and after it in
// its ring, and seven around its azimuth in each of the 2 rings above and 2 below. Returns farther
// in azimuth than REACH_OWN or REACH_OTHER steps do not count. WIDTH points side by side; what is
// summed up of their windows stays in registers. Naive twin: window() in
// test/naive/scan_pattern.py.
#pragma once

#include <cstdint>
#include <type_traits>

#include "../../kernels/array_view.hpp"
#include "../../kernels/levels.hpp"
#include "../../kernels/vectors.hpp"
#include "../../scan_pattern/pattern.hpp"

namespace lidar {

// A pattern of M positions, and what its windows share.
struct Prepared {
    Pattern pattern;
    View<const float> rough;           // (M,), see write_roughness()
    View<const std::int32_t, 2> near;  // (4, M), see find_beside()
    View<const float, 2> of_block;     // (6, M) of profile scanners, (0, M) of others
};

inline constexpr int OWN = 5, OTHER = 3;  // returns on either side: in its ring, in those beside it
inline constexpr Index RINGS = 2;         // rings above, and below
inline constexpr int AROUND = 2 * OTHER + 1;
inline constexpr int SIZE = 2 * OWN + static_cast<int>(2 * RINGS) * AROUND;  // returns of a window
inline constexpr int STRETCH = 24;  // positions on either side: the reach of windows along a line
inline constexpr int PAD = 32 + STRETCH;  // positions without a point around each line
inline constexpr float REACH_OWN = 10, REACH_OTHER = 6;  // steps up to which returns count
inline constexpr float FAR = 1e12F;                      // m²: no return
inline constexpr float MAX_VALUE = 1000;                 // of a feature

// Refuses a pattern whose arrays do not fit together, or whose lines begin to end are not apart.
void check_pattern(const Pattern& pattern, Index begin, Index end);
// Refuses places beside the positions of lines begin to end that no window may be around.
void check_beside(const Pattern& pattern, View<const std::int32_t, 2> near, Index begin, Index end);

namespace LEVEL {

// The rows of positions that windows are gathered from.
struct Rows {
    const float *x, *y, *z, *range, *rough;
    const double* phase;
    const std::int32_t* near;
    Index size;  // positions

    explicit Rows(const Prepared& of)
        : x(of.pattern.x.data),
          y(of.pattern.y.data),
          z(of.pattern.z.data),
          range(of.pattern.range.data),
          rough(of.rough.data),
          phase(of.pattern.phase.data),
          near(of.near.data),
          size(of.pattern.order.size()) {}
};

// The numbers of a line. Single precision, in the order of operations written.
struct Line {
    float step, gap, noise, apart, level, uneven;
    float beside[2 * RINGS];
    float reach_own, reach_other, reach_along;  // rad
    bool plain;  // all points of its windows are near, so that no square is as large as FAR

    Line(const Pattern& pattern, Index line)
        : step(pattern.step[line]),
          gap(pattern.gap[line]),
          noise(pattern.noise[line]),
          apart(pattern.apart[line]),
          level(pattern.level[line]),
          uneven(pattern.uneven[line]) {
        const float turn = pattern.turn[line];
        for (int n = 0; n < 2 * RINGS; ++n) {
            beside[n] = pattern.beside(n, line);
        }
        reach_own = REACH_OWN * (step * turn);
        reach_other = REACH_OTHER * ((gap > step ? gap : step) * turn);
        reach_along = REACH_OWN * step * turn;
        plain = 0 <= gap && gap < MAX_PLAIN && 0 <= apart && apart < MAX_PLAIN && 0 <= level &&
                level < MAX_PLAIN;
    }

    static constexpr float MAX_PLAIN = 2.5e5F;  // metres: 3 × (2 × that)² is less than FAR
};

// Positions that follow each other.
struct Steps {
    Index first;

    [[gnu::always_inline]] Singles of(const float* row, Index off = 0) const {
        return load(row + first + off);
    }
    [[gnu::always_inline]] DoublePair of(const double* row, Index off = 0) const {
        return load_pair(row + first + off);
    }
};

// Positions anywhere.
struct Scattered {
    Counts at;

    [[gnu::always_inline]] Singles of(const float* row, Index off = 0) const {
        return take(row + off, at);
    }
    [[gnu::always_inline]] DoublePair of(const double* row, Index off = 0) const {
        return take(row + off, at);
    }
};

// Positions of a vector of points, or returns.
struct Places {
    Counts at;
    bool in_step;  // each is the one behind the one before

    explicit Places(Counts places) : at(places), in_step(all(places == follow(places[0]))) {}

    template <typename T>
    [[gnu::always_inline]] auto of(const T* row, Index off = 0) const {
        return in_step ? Steps{at[0]}.of(row, off) : Scattered{at}.of(row, off);
    }
    [[gnu::always_inline]] Counts of(const std::int32_t* row) const {
        return in_step ? load(row + at[0]) : take(row, at);
    }
};

// The returns of windows, for those features that look at each of them.
struct Returns {
    Singles square[SIZE];                    // of the distance, m²; FAR for none
    Singles away[SIZE];                      // range less the point's own, m; 0 for none
    Singles range[2 * OWN], phase[2 * OWN];  // in the own ring; phases less those of the points
    Counts others[2 * RINGS];                // the place nearest in azimuth on each ring beside
};

// What is summed up of windows. Named one by one where a register is to hold it.
struct Sums {
    struct Part {  // of the own ring, or of the others
        Singles there = repeat(0.0F), before = there, behind = there, level = there;
        Singles rough = there, rough_count = there;
    };
    Part own, other;
    Singles dense = repeat(0.0F), sparse = dense, farthest, nearest_other = repeat(FAR);
    Singles best0 = repeat(FAR), best1 = best0, best2 = best0, best3 = best0, best4 = best0;
    Singles square_before, square_behind;  // to the returns before and after, m²
    Singles range[4], phase[4];  // of the two before and the two after, in order of position
    Singles inverse[2 * RINGS];  // 1 ÷ range nearest in each ring beside, 1/m; -1 for none
};

// Points in lanes, and what their windows are measured by.
struct Points {
    Singles x, y, z, range;
    DoublePair phase;
    Singles same, closer;  // the largest difference of range that is none, metres; less that
    Singles dense_square, sparse_square;

    Points(const Rows& rows, const Line& line, const Places& places)
        : x(places.of(rows.x)),
          y(places.of(rows.y)),
          z(places.of(rows.z)),
          range(places.of(rows.range)),
          phase(places.of(rows.phase)) {
        const Singles unit = range * line.gap + line.apart;
        same = 1.5F * unit + line.level;
        closer = repeat(0.0F) - same;
        dense_square = 4.0F * unit * unit;
        sparse_square = 36.0F * unit * unit;
    }
};

// Returns whether the positions lo to hi are those of near points: see Line::plain.
inline bool is_plain(const Rows& rows, Index low, Index high) {
    const Singles most_far = repeat(Line::MAX_PLAIN);
    Counts good = follow(0) >= 0;
    for (Index k = low; k < high; k += WIDTH) {
        const Index at = k + WIDTH <= high ? k : high - WIDTH;
        good &= (size_of(load(rows.x + at)) < most_far) & (size_of(load(rows.y + at)) < most_far) &
                (size_of(load(rows.z + at)) < most_far) & (load(rows.range + at) < most_far) &
                (load(rows.range + at) >= repeat(0.0F));
    }
    return all(good);
}

// Calls a function with the numbers 0 to COUNT as constants.
template <int COUNT, int FROM = 0, typename Function>
[[gnu::always_inline]] inline void unroll(const Function& function) {
    if constexpr (FROM < COUNT) {
        function(std::integral_constant<int, FROM>{});
        unroll<COUNT, FROM + 1>(function);
    }
}

// Sums up windows, return by return.
//
// Of PLAIN ones all returns are near and finite. Those parts of which all returns are within reach
// need no mask (ALL): what is neither before nor behind is level.
template <bool PLAIN, bool KEEP>
struct Gatherer {
    const Rows& rows;
    const Line& line;
    const Points& mine;
    Sums& sums;
    Returns* returns;

    template <typename Where>
    [[gnu::always_inline]] Singles phase(Where places, Index off) const {
        return single(places.of(rows.phase, off) - mine.phase);
    }

    // Returns whether the first and the last of some returns are within reach: so are all between,
    // because phases never fall along a ring.
    template <typename Where>
    [[gnu::always_inline]] bool are_all(Where places, int off, float reach) const {
        return PLAIN && all((size_of(phase(places, -off)) <= repeat(reach)) &
                            (size_of(phase(places, off)) <= repeat(reach)));
    }

    // One after the other finds its rank; what is larger goes on.
    [[gnu::always_inline]] void rank(Singles value) const {
        const auto keep = [&](Singles & best) __attribute__((always_inline)) {
            const Singles before = best;
            best = least(before, value);
            value = most(before, value);
        };
        keep(sums.best0);
        keep(sums.best1);
        keep(sums.best2);
        keep(sums.best3);
        keep(sums.best4);
    }

    // Adds a return at an offset from places; gives its squared distance.
    template <bool ALL, typename Where>
    [[gnu::always_inline]] Singles add(Sums::Part& part, Where places, Index off, int slot,
                                       Counts good) const {
        const Singles one = repeat(1.0F), zero = repeat(0.0F);
        const Singles dx = places.of(rows.x, off) - mine.x, dy = places.of(rows.y, off) - mine.y;
        const Singles dz = places.of(rows.z, off) - mine.z;
        Singles square = dx * dx + dy * dy + dz * dz;
        Singles away = places.of(rows.range, off) - mine.range;
        if constexpr (!ALL) {
            square = choose(good, square, repeat(FAR));
            away = choose(good, away, zero);
            part.there += choose(good, one, zero);
            const Counts same = (size_of(away) <= mine.same) & (square < FAR);
            part.level += choose(same, one, zero);
        }
        part.before += choose(away < mine.closer, one, zero);
        part.behind += choose(away > mine.same, one, zero);
        sums.dense += choose(square <= mine.dense_square, one, zero);
        sums.sparse += choose(square <= mine.sparse_square, one, zero);
        sums.farthest = most(sums.farthest, mine.range + away);
        rank(square);
        if constexpr (KEEP) {
            returns->square[slot] = square;
            returns->away[slot] = away;
        }
        return square;
    }

    // Adds the point's own ring, without the point.
    template <bool ALL, typename Where>
    [[gnu::always_inline]] void add_own(Where places) const {
        const Singles one = repeat(1.0F), zero = repeat(0.0F);
        unroll<2 * OWN>([&](auto slot) __attribute__((always_inline)) {
            constexpr int SLOT = slot, OFF = SLOT < OWN ? SLOT - OWN : SLOT - OWN + 1;
            Counts good{};
            if constexpr (!ALL || KEEP) {
                const Singles turned = phase(places, OFF);
                good = size_of(turned) <= repeat(line.reach_own);
                if constexpr (KEEP) {
                    returns->phase[SLOT] = turned;
                    returns->range[SLOT] = places.of(rows.range, OFF);
                }
            }
            const Singles square = add<ALL>(sums.own, places, OFF, SLOT, good);
            // That of those at ±1 is left out: it is computed from this very point.
            if constexpr (OFF == -1) {
                sums.square_before = square;
            } else if constexpr (OFF == 1) {
                sums.square_behind = square;
            } else {
                const Counts known = square < FAR;
                const Singles rough = places.of(rows.rough, OFF);
                sums.own.rough += ALL ? rough : choose(known, rough, zero);
                sums.own.rough_count += ALL ? one : choose(known, one, zero);
            }
        });
        if constexpr (ALL) {
            sums.own.there = repeat(2.0F * OWN);
            sums.own.level = sums.own.there - sums.own.before - sums.own.behind;
        }
    }

    template <typename Where>
    [[gnu::always_inline]] void own(Where places) const {
        unroll<4>([&](auto n) __attribute__((always_inline)) {
            constexpr int OFF = n < 2 ? n - 2 : n - 1;
            sums.range[n] = places.of(rows.range, OFF);
            sums.phase[n] = phase(places, OFF);
        });
        if (are_all(places, OWN, line.reach_own)) {
            add_own<true>(places);
        } else {
            add_own<false>(places);
        }
    }

    // Adds the returns around the azimuth in another ring.
    template <bool ALL, typename Where>
    [[gnu::always_inline]] void add_other(Where places, int ring) const {
        const Singles one = repeat(1.0F), zero = repeat(0.0F);
        const Singles before = sums.other.before, behind = sums.other.behind;
        Counts known{};
        unroll<AROUND>([&](auto m) __attribute__((always_inline)) {
            constexpr int OFF = m - OTHER;
            Counts good{};
            if constexpr (!ALL) {
                good = size_of(phase(places, OFF)) <= repeat(line.reach_other);
            }
            const int slot = 2 * OWN + ring * AROUND + m;
            const Singles square = add<ALL>(sums.other, places, OFF, slot, good);
            sums.nearest_other = least(sums.nearest_other, square);
            if constexpr (OFF == 0) {
                known = square < FAR;
            }
        });
        const Singles inverse = one / places.of(rows.range), rough = places.of(rows.rough);
        sums.inverse[ring] = ALL ? inverse : choose(known, inverse, -one);
        sums.other.rough += ALL ? rough : choose(known, rough, zero);
        sums.other.rough_count += ALL ? one : choose(known, one, zero);
        if constexpr (ALL) {
            const Singles every = repeat(1.0F * AROUND);
            sums.other.there += every;
            sums.other.level += every - (sums.other.before - before) - (sums.other.behind - behind);
        }
    }

    template <typename Where>
    [[gnu::always_inline]] void other(Where places, int ring) const {
        if (are_all(places, OTHER, line.reach_other)) {
            add_other<true>(places, ring);
        } else {
            add_other<false>(places, ring);
        }
    }
};

// Gathers the windows of points at these places, which are all in one line.
template <bool PLAIN, bool KEEP>
[[gnu::always_inline]] inline Sums gather(const Rows& rows, const Line& line, const Places& points,
                                          const Points& mine, Returns* returns) {
    Sums sums;
    sums.farthest = mine.range;
    const Gatherer<PLAIN, KEEP> gatherer{rows, line, mine, sums, returns};
    if (points.in_step) {
        gatherer.own(Steps{points.at[0]});
    } else {
        gatherer.own(Scattered{points.at});
    }
    for (int ring = 0; ring < 2 * RINGS; ++ring) {
        const Places places(points.of(rows.near + ring * rows.size));
        if constexpr (KEEP) {
            returns->others[ring] = places.at;
        }
        if (places.in_step) {
            gatherer.other(Steps{places.at[0]}, ring);
        } else {
            gatherer.other(Scattered{places.at}, ring);
        }
    }
    return sums;
}

}  // namespace LEVEL
}  // namespace lidar
