# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of a window in the scan pattern, see :mod:`.features`.

Lengths are divided by the spacing of the beams: range × step along the ring, or × the angle to the
next ring. :mod:`.window` defines windows.
"""

from __future__ import annotations

from typing import Any

from lidar_outlier_filter.core.annotations import Single, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import WINDOW, rows
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    FAR,
    MAX_VALUE,
    ONE,
    OWN,
    OWN_PHASES,
    OWN_RANGES,
    RANGE,
    REACH_OWN,
    SIZE,
    SUM,
    ZERO,
    F,
    PatternWindow,
)
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    least,
    load,
    most,
    no_counts,
    repeat,
    root,
    select,
    single,
    store,
)
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

COUNT, ROW = len(WINDOW), rows(WINDOW)
SAME = F(1.5)  # beams apart: still at one range
THREE, FIVE = F(3.0), F(5.0)
DENSE_SQUARE, SPARSE_SQUARE = F(4.0), F(36.0)  # beams apart, squared
PLACES_OWN, PLACES_OTHER, POSITIONS = F(2 * OWN), F(SIZE - 2 * OWN), F(SIZE)


@inlined_kernel
def write_features(pattern: Pattern, line: int, window: PatternWindow, values: Singles) -> None:
    """Write the features of the points of gathered windows."""
    for lane in range(0, LANES, WIDTH):
        _count(pattern, line, lane, window)
        _find_nearest(lane, window)
        _along(pattern, line, lane, window, values)
        _distances(pattern, line, lane, window, values)
        _shares(lane, window, values)
        _ranges(pattern, line, lane, window, values)


@inlined_kernel
def level_within(unit: Single, level: Single) -> Single:
    """Return how far apart ranges are that still are the same, of what beams are apart, m."""
    return SAME * unit + level


@inlined_kernel
def width(array: Singles) -> int:
    """Return the number of lanes of an array."""
    return int(array.shape[1])


@noalias_kernel
def _count(pattern: Pattern, line: int, lane: int, window: PatternWindow) -> None:
    """Count returns before, behind and at the same range, from a lane on."""
    reach, square, away, sums = window.mine[RANGE], window.square, window.away, window.sums
    r = load(reach, lane)
    unit = r * pattern.gap[line] + pattern.apart[line]
    same = level_within(unit, pattern.level[line])
    near, nearest, wide = ZERO - same, DENSE_SQUARE * unit * unit, SPARSE_SQUARE * unit * unit
    dense, sparse, farthest = no_counts(), no_counts(), r
    for part in range(2):
        before, behind, level = no_counts(), no_counts(), no_counts()
        for slot in range(2 * OWN * part, 2 * OWN if part == 0 else SIZE):
            d, off = load(square, slot * LANES + lane), load(away, slot * LANES + lane)
            before, behind = count(before, off < near), count(behind, off > same)
            level = count(level, (abs(off) <= same) & (d < FAR))
            dense, sparse = count(dense, d <= nearest), count(sparse, d <= wide)
            farthest = most(farthest, r + off)
        store(sums, (SUM.before_own + part) * LANES + lane, single(before))
        store(sums, (SUM.behind_own + part) * LANES + lane, single(behind))
        store(sums, (SUM.level_own + part) * LANES + lane, single(level))
    store(sums, SUM.dense * LANES + lane, single(dense))
    store(sums, SUM.sparse * LANES + lane, single(sparse))
    store(sums, SUM.farthest * LANES + lane, farthest)


@noalias_kernel
def _find_nearest(lane: int, window: PatternWindow) -> None:
    """Find the nearest returns from a lane on: of all, in order, and of other rings."""
    square, best = window.square, window.best
    a = b = c = d = e = nearest = repeat(FAR)
    for slot in range(SIZE):
        value = load(square, slot * LANES + lane)
        if slot >= 2 * OWN:
            nearest = least(nearest, value)
        # One after the other finds its rank; what is larger goes on.
        a, value = least(a, value), most(a, value)
        b, value = least(b, value), most(b, value)
        c, value = least(c, value), most(c, value)
        d, value = least(d, value), most(d, value)
        e = least(e, value)
    store(best, lane, a)
    store(best, LANES + lane, b)
    store(best, 2 * LANES + lane, c)
    store(best, 3 * LANES + lane, d)
    store(best, 4 * LANES + lane, e)
    store(window.sums, SUM.nearest_other * LANES + lane, nearest)


@noalias_kernel
def _along(pattern: Pattern, line: int, lane: int, window: PatternWindow, values: Singles) -> None:
    """Write how far the range is from three predictions along the ring, from a lane on."""
    r, own = load(window.mine[RANGE], lane), window.own
    ra, a = load(own[OWN_RANGES + OWN - 1], lane), load(own[OWN_PHASES + OWN - 1], lane)
    rb, b = load(own[OWN_RANGES + OWN], lane), load(own[OWN_PHASES + OWN], lane)
    rc, c = load(own[OWN_RANGES + OWN - 2], lane), load(own[OWN_PHASES + OWN - 2], lane)
    rd, d = load(own[OWN_RANGES + OWN + 1], lane), load(own[OWN_PHASES + OWN + 1], lane)
    reach = REACH_OWN * pattern.step[line] * pattern.turn[line]
    middle = _off(r, ra, a, rb, b, reach)
    off = least(least(middle, _off(r, ra, a, rc, c, reach)), _off(r, rb, b, rd, d, reach))
    unit = pattern.step[line] + pattern.noise[line] / r
    store(values[ROW.along], lane, least(off / unit, MAX_VALUE))
    store(values[ROW.along_m], lane, least(off * r, MAX_VALUE))
    store(values[ROW.between], lane, least(middle / unit, MAX_VALUE))


@noalias_kernel
def _off(r: Any, ra: Any, pa: Any, rb: Any, pb: Any, reach: Single) -> Any:
    """Return how far ranges are from the straight line through two others, as a part of them.

    ``pa`` and ``pb`` are their phases, less those of the ranges.
    """
    span = pb - pa
    good = (abs(pa) <= reach) & (abs(pb) <= reach) & (abs(span) > ZERO)
    part = (ZERO - pa) / select(good, span, ONE)
    value = (ONE - part) / ra + part / rb
    # What the noise of both adds is taken off.
    size = root(ONE + (ONE - part) * (ONE - part) + part * part)
    return select(good, least(abs(ONE - r * value) / size, MAX_VALUE), MAX_VALUE)


@noalias_kernel
def _distances(
    pattern: Pattern, line: int, lane: int, window: PatternWindow, values: Singles
) -> None:
    """Write how far the nearest returns are: in the ring, in other rings, and of all."""
    mine, square, best = load(window.mine[RANGE], lane), window.square, window.best
    own_unit = mine * pattern.step[line] + pattern.noise[line]
    unit = mine * pattern.gap[line] + pattern.apart[line]
    a, b = root(load(square[OWN - 1], lane)), root(load(square[OWN], lane))
    store(values[ROW.step], lane, least(least(a, b) / own_unit, MAX_VALUE))
    store(values[ROW.leap], lane, least(most(a, b) / own_unit, MAX_VALUE))
    beside = root(load(window.sums[SUM.nearest_other], lane))
    store(values[ROW.beside], lane, least(beside / unit, MAX_VALUE))
    three = root(load(best[0], lane)) + root(load(best[1], lane)) + root(load(best[2], lane))
    five = three + root(load(best[3], lane)) + root(load(best[4], lane))
    store(values[ROW.near3], lane, least(three / (THREE * unit), MAX_VALUE))
    store(values[ROW.near5], lane, least(five / (FIVE * unit), MAX_VALUE))
    store(values[ROW.near5_m], lane, least(five / FIVE, MAX_VALUE))


@noalias_kernel
def _shares(lane: int, window: PatternWindow, values: Singles) -> None:
    """Write shares of the window, and how rough it is, from a lane on."""
    sums = window.sums
    there_own, there_other = load(sums[SUM.there_own], lane), load(sums[SUM.there_other], lane)
    own, others = most(there_own, ONE), most(there_other, ONE)
    store(values[ROW.before_own], lane, load(sums[SUM.before_own], lane) / own)
    store(values[ROW.behind_own], lane, load(sums[SUM.behind_own], lane) / own)
    store(values[ROW.before_other], lane, load(sums[SUM.before_other], lane) / others)
    store(values[ROW.behind_other], lane, load(sums[SUM.behind_other], lane) / others)
    store(values[ROW.level_own], lane, load(sums[SUM.level_own], lane) / PLACES_OWN)
    store(values[ROW.level_other], lane, load(sums[SUM.level_other], lane) / PLACES_OTHER)
    store(values[ROW.there_own], lane, there_own / PLACES_OWN)
    store(values[ROW.there_other], lane, there_other / PLACES_OTHER)
    for part in range(2):
        known = most(load(sums[SUM.rough_count_own + part], lane), ONE)
        store(values[ROW.rough_own + part], lane, load(sums[SUM.rough_own + part], lane) / known)
    store(values[ROW.dense], lane, load(sums[SUM.dense], lane) / POSITIONS)
    store(values[ROW.sparse], lane, load(sums[SUM.sparse], lane) / POSITIONS)


@noalias_kernel
def _ranges(pattern: Pattern, line: int, lane: int, window: PatternWindow, values: Singles) -> None:
    """Write range and brightness, the background's range, and predictions across the rings."""
    inverse, beside = window.inverse, pattern.beside[:, line]
    part = beside[1] / (beside[1] + beside[2])
    low, high = beside[1] / (beside[0] - beside[1]), beside[2] / (beside[3] - beside[2])
    mine, farthest = load(window.mine[RANGE], lane), load(window.sums[SUM.farthest], lane)
    store(values[ROW.range], lane, mine)
    store(values[ROW.range_ratio_glare], lane, mine * mine / farthest)
    store(values[ROW.depth], lane, mine / farthest)
    store(values[ROW.bright], lane, load(window.bright, lane))
    store(values[ROW.uneven], lane, repeat(pattern.uneven[line]))
    # Of a plane, the inverse range is straight across the rings; below 0 it is unknown.
    a, b = load(inverse[0], lane), load(inverse[1], lane)
    c, d = load(inverse[2], lane), load(inverse[3], lane)
    between = abs(ONE - mine * ((ONE - part) * b + part * c))
    between = select((b > ZERO) & (c > ZERO), between, MAX_VALUE)
    below = abs(ONE - mine * ((ONE + low) * b - low * a)) / (ONE + low)
    below = select((a > ZERO) & (b > ZERO), below, MAX_VALUE)
    above = abs(ONE - mine * ((ONE + high) * c - high * d)) / (ONE + high)
    above = select((c > ZERO) & (d > ZERO), above, MAX_VALUE)
    off = least(least(between, below), above)
    unit = pattern.gap[line] + pattern.noise[line] / mine
    store(values[ROW.across], lane, least(off / unit, MAX_VALUE))
