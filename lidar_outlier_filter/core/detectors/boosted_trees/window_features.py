# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of a window in the scan pattern, see :mod:`.features`.

Lengths are divided by the spacing of the beams: range × step along the ring, or × the angle to the
next ring. :mod:`.window` defines windows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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
    single,
    store,
)

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Single, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.window import PatternWindow
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
    _along(pattern, line, window, values)
    _distances(pattern, line, window, values)
    _shares(window, values)
    _ranges(pattern, line, window, values)


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
def _along(pattern: Pattern, line: int, window: PatternWindow, values: Singles) -> None:
    """Write how far the range is from three predictions along the ring."""
    step, noise = pattern.step[line], pattern.noise[line]
    r0, reach, phase = window.mine[RANGE], window.own[OWN_RANGES:], window.own[OWN_PHASES:]
    ra, pa, rc, pc = reach[OWN - 1], phase[OWN - 1], reach[OWN - 2], phase[OWN - 2]
    rb, pb, rd, pd = reach[OWN], phase[OWN], reach[OWN + 1], phase[OWN + 1]
    most = REACH_OWN * step * pattern.turn[line]
    for lane in range(width(values)):
        r, a, b = r0[lane], pa[lane], pb[lane]
        middle = _off(r, ra[lane], a, rb[lane], b, most)
        before = _off(r, ra[lane], a, rc[lane], pc[lane], most)
        after = _off(r, rb[lane], b, rd[lane], pd[lane], most)
        least = min(middle, before, after)
        unit = step + noise / r
        values[ROW.along, lane] = min(least / unit, MAX_VALUE)
        values[ROW.along_m, lane] = min(least * r, MAX_VALUE)
        values[ROW.between, lane] = min(middle / unit, MAX_VALUE)


@noalias_kernel
def _off(r: Single, ra: Single, pa: Single, rb: Single, pb: Single, most: Single) -> Single:
    """Return how far a range is from the straight line through two others, as a part of it.

    ``pa`` and ``pb`` are their phases, less that of the range.
    """
    span = pb - pa
    good = (abs(pa) <= most) & (abs(pb) <= most) & (span != ZERO)
    part = -pa / (span if good else ONE)
    value = (ONE - part) / ra + part / rb
    # What the noise of both adds is taken off.
    size = np.sqrt(ONE + (ONE - part) * (ONE - part) + part * part)
    off = min(abs(ONE - r * value) / size, MAX_VALUE)
    return off if good else MAX_VALUE


@noalias_kernel
def _distances(pattern: Pattern, line: int, window: PatternWindow, values: Singles) -> None:
    """Write how far the nearest returns are: in the ring, in other rings, and of all."""
    reach, step, gap = window.mine[RANGE], pattern.step[line], pattern.gap[line]
    noise, apart = pattern.noise[line], pattern.apart[line]
    square, sums, best = window.square, window.sums, window.best
    for lane in range(width(values)):
        mine = reach[lane]
        own_unit, unit = mine * step + noise, mine * gap + apart
        a, b = np.sqrt(square[OWN - 1, lane]), np.sqrt(square[OWN, lane])
        values[ROW.step, lane] = min(min(a, b) / own_unit, MAX_VALUE)
        values[ROW.leap, lane] = min(max(a, b) / own_unit, MAX_VALUE)
        values[ROW.beside, lane] = min(np.sqrt(sums[SUM.nearest_other, lane]) / unit, MAX_VALUE)
        three = np.sqrt(best[0, lane]) + np.sqrt(best[1, lane]) + np.sqrt(best[2, lane])
        five = three + np.sqrt(best[3, lane]) + np.sqrt(best[4, lane])
        values[ROW.near3, lane] = min(three / (THREE * unit), MAX_VALUE)
        values[ROW.near5, lane] = min(five / (FIVE * unit), MAX_VALUE)
        values[ROW.near5_m, lane] = min(five / FIVE, MAX_VALUE)


@noalias_kernel
def _shares(window: PatternWindow, values: Singles) -> None:
    """Write shares of the window, and how rough it is."""
    sums = window.sums
    for lane in range(width(values)):
        own, others = max(sums[SUM.there_own, lane], ONE), max(sums[SUM.there_other, lane], ONE)
        values[ROW.before_own, lane] = sums[SUM.before_own, lane] / own
        values[ROW.behind_own, lane] = sums[SUM.behind_own, lane] / own
        values[ROW.before_other, lane] = sums[SUM.before_other, lane] / others
        values[ROW.behind_other, lane] = sums[SUM.behind_other, lane] / others
        values[ROW.level_own, lane] = sums[SUM.level_own, lane] / PLACES_OWN
        values[ROW.level_other, lane] = sums[SUM.level_other, lane] / PLACES_OTHER
        values[ROW.there_own, lane] = sums[SUM.there_own, lane] / PLACES_OWN
        values[ROW.there_other, lane] = sums[SUM.there_other, lane] / PLACES_OTHER
        for part in range(2):
            count = max(sums[SUM.rough_count_own + part, lane], ONE)
            values[ROW.rough_own + part, lane] = sums[SUM.rough_own + part, lane] / count
        values[ROW.dense, lane] = sums[SUM.dense, lane] / POSITIONS
        values[ROW.sparse, lane] = sums[SUM.sparse, lane] / POSITIONS


@noalias_kernel
def _ranges(pattern: Pattern, line: int, window: PatternWindow, values: Singles) -> None:
    """Write range and brightness, the background's range, and predictions across the rings."""
    reach, gap, noise = window.mine[RANGE], pattern.gap[line], pattern.noise[line]
    bright, uneven = window.bright, pattern.uneven[line]
    sums, inverse, beside = window.sums, window.inverse, pattern.beside[:, line]
    part = beside[1] / (beside[1] + beside[2])
    low, high = beside[1] / (beside[0] - beside[1]), beside[2] / (beside[3] - beside[2])
    for lane in range(width(values)):
        mine, farthest = reach[lane], sums[SUM.farthest, lane]
        values[ROW.range, lane] = mine
        values[ROW.range_ratio_glare, lane] = mine * mine / farthest
        values[ROW.depth, lane] = mine / farthest
        values[ROW.bright, lane] = bright[lane]
        values[ROW.uneven, lane] = uneven
        # Of a plane, the inverse range is straight across the rings; below 0 it is unknown.
        a, b, c, d = inverse[0, lane], inverse[1, lane], inverse[2, lane], inverse[3, lane]
        between = abs(ONE - mine * ((ONE - part) * b + part * c))
        between = between if (b > ZERO) & (c > ZERO) else MAX_VALUE
        below = abs(ONE - mine * ((ONE + low) * b - low * a)) / (ONE + low)
        below = below if (a > ZERO) & (b > ZERO) else MAX_VALUE
        above = abs(ONE - mine * ((ONE + high) * c - high * d)) / (ONE + high)
        above = above if (c > ZERO) & (d > ZERO) else MAX_VALUE
        values[ROW.across, lane] = min(min(between, below, above) / (gap + noise / mine), MAX_VALUE)
