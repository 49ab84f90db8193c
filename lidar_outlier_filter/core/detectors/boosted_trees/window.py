# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The window of a spinning sensor's point, the returns around it in the scan pattern; its features.

These are the five returns before and after it in its ring, and seven around its azimuth in each of
the 2 rings above and 2 below. Returns that are too far in angle do not count.
"""

from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Index, Ints, Single, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import WINDOW, rows
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, rows_of_singles
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    follow,
    least,
    load,
    most,
    no_counts,
    repeat,
    root,
    select,
    single,
    store,
    take,
)
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern, lines_at_once

OWN, OTHER = 5, 3  # returns on either side: in the point's ring, and in those beside it
RINGS = 2  # rings above, and below
AROUND = 2 * OTHER + 1
SIZE = 2 * OWN + 2 * RINGS * AROUND  # returns of a window
RANGE = 3  # its row, behind x, y and z
OWN_RANGES, OWN_PHASES = 0, 2 * OWN  # the first rows of the own ring's returns
SCORES = 12  # sums of the second pass
KEPT_NEAREST = 5  # nearest distances that are kept in order
# Rows of the sums; of the pairs, one of the own ring and one of the others.
_PAIRS = ('there', 'before', 'behind', 'level', 'rough', 'rough_count')
_SUMS = (
    *(f'{name}_{part}' for name in _PAIRS for part in ('own', 'other')),
    *('farthest', 'nearest_other', 'dense', 'sparse'),
)
SUM = rows(_SUMS)
# Constants of single precision: a number of Python's would make doubles of all it meets.
F = np.float32
REACH_OWN, REACH_OTHER = F(10.0), F(6.0)  # steps from the azimuth up to which returns count
FAR = F(1e12)  # m²: no return
MAX_VALUE = F(1000.0)  # of a feature
ZERO, HALF, ONE, TWO = F(0.0), F(0.5), F(1.0), F(2.0)
COUNT, ROW = len(WINDOW), rows(WINDOW)
SAME = F(1.5)  # beams apart: still at one range
THREE, FIVE = F(3.0), F(5.0)
DENSE_SQUARE, SPARSE_SQUARE = F(4.0), F(36.0)  # beams apart, squared
PLACES_OWN, PLACES_OTHER, POSITIONS = F(2 * OWN), F(SIZE - 2 * OWN), F(SIZE)


class Prepared(NamedTuple):
    """A pattern of M positions, and what its windows share.

    Attributes
    ----------
    pattern : of the points
    rough : (M,) float32
        How much each range differs from what its neighbours in the ring predict; see
        :func:`write_roughness`.
    near : (4, M) int32
        The place nearest in azimuth on each ring beside; see :func:`find_beside`.
    groups : (G, M) float32
        Of a profile scanner, the features of the free group of each; G is 0 for other sensors.

    """

    pattern: Pattern
    rough: Singles
    near: Index
    groups: Singles

    @property
    def profile(self) -> bool | None:
        """True of a profile scanner; otherwise None, which numba compiles nothing of these for."""
        return True if len(self.groups) > 0 else None


class PatternWindow(NamedTuple):
    """The windows of ``LANES`` points side by side, and room to work in.

    Attributes
    ----------
    square, away : (SIZE, LANES) float32
        Squared distances to the returns, m²; and their ranges, less the point's own, m.
    mine : (RANGE + 1, LANES) float32
        x, y, z and range of the points.
    bright : (2, LANES) float32
        How bright the points are, in both ways.
    own : (4 * OWN, LANES) float32
        Ranges of the returns of the points' own ring, and their phases less those of the points.
    scores : (SCORES, LANES) float32
        Room for the second pass.
    best : (KEPT_NEAREST, LANES) float32
        The least squared distances, ascending, m².
    sums : (SUMS, LANES) float32
    inverse : (2 * RINGS, LANES) float32
        1 ÷ range of the nearest return on each ring beside, 1/m; below 0 for none.
    positions : (LANES,) int64
        Where the points are in the pattern: all in one line, in any order.
    others : (2 * RINGS, LANES) int32
        The place nearest to each in azimuth on each ring beside.

    """

    square: Singles
    away: Singles
    mine: Singles
    bright: Singles
    own: Singles
    scores: Singles
    best: Singles
    sums: Singles
    inverse: Singles
    positions: Ints
    others: Index


@inlined_kernel
def make_window() -> PatternWindow:
    """Make room for one thread."""
    return PatternWindow(
        rows_of_singles(SIZE),
        rows_of_singles(SIZE),
        rows_of_singles(RANGE + 1),
        rows_of_singles(2),
        rows_of_singles(4 * OWN),
        rows_of_singles(SCORES),
        rows_of_singles(KEPT_NEAREST),
        rows_of_singles(len(_SUMS)),
        rows_of_singles(2 * RINGS),
        np.empty(LANES, np.int64),
        np.empty((2 * RINGS, LANES), np.int32),
    )


def prepare(pattern: Pattern, threads: int = 0) -> Prepared:
    """Compute what all windows share, in at most so many threads at once; 0 for all cores."""
    positions, lines = len(pattern.order), len(pattern.first)
    rough, near = np.zeros(positions, np.float32), np.full((2 * RINGS, positions), OTHER, np.int32)

    def work(begin: int, end: int) -> None:
        write_roughness(pattern, begin, end, rough)
        find_beside(pattern, begin, end, near)

    pool.run(work, lines, lines_at_once(lines, positions), threads)
    return Prepared(pattern, rough, near, np.empty((0, positions), np.float32))


@kernel
def write_roughness(pattern: Pattern, begin: int, end: int, rough: Singles) -> None:
    """Write how much ranges differ from what their neighbours in the ring predict.

    For lines ``begin`` to ``end``: |1 - range × predicted inverse range| ÷ step; 0 at the ends. On
    a plane the inverse range varies evenly along a ring.
    """
    reach, phase = pattern.range, pattern.phase
    for line in range(begin, end):
        low, high = pattern.first[line], pattern.last[line]
        step, noise = pattern.step[line], pattern.noise[line]
        rough[low], rough[high - 1] = ZERO, ZERO
        for k in range(low + 1, high - 1):
            before, span = F(phase[k] - phase[k - 1]), F(phase[k + 1] - phase[k - 1])
            part = before / span if span > ZERO else HALF
            value = (ONE - part) / reach[k - 1] + part / reach[k + 1]
            rough[k] = min(abs(ONE - reach[k] * value) / (step + noise / reach[k]), MAX_VALUE)


@kernel
def find_beside(pattern: Pattern, begin: int, end: int, near: Index) -> None:
    """Write the position of the nearest return in azimuth on each ring beside, for some lines.

    ``near`` (4, M): on the second below, the one below, the one above, the second above; a place of
    no point where there is no such ring. Of two equally near, the first. Entries without a
    point must be valid positions, too.
    """
    lines = len(pattern.first)
    phase = pattern.phase
    for line in range(begin, end):
        low, high = pattern.first[line], pattern.last[line]
        for m in range(2 * RINGS):
            other = line + (m - RINGS if m < RINGS else m - RINGS + 1)
            if other < 0 or other >= lines:
                for k in range(low, high):
                    near[m, k] = OTHER
                continue
            j, stop = pattern.first[other], pattern.last[other] - 1
            for k in range(low, high):
                mine = phase[k]
                while j < stop and phase[j + 1] <= mine:
                    j += 1
                # Behind the last one is a place that is far away.
                near[m, k] = j + 1 if phase[j + 1] - mine < mine - phase[j] else j


@inlined_kernel
def gather(prepared: Prepared, line: int, window: PatternWindow) -> None:
    """Write the windows of the points of a line that are at the window's positions.

    Distances, ranges, inverse ranges, and sums of the returns and their roughness.
    """
    # Once, because every time that an array is taken from a tuple its references are counted.
    pattern, rough, near, _ = prepared
    rows, phase = (pattern.x, pattern.y, pattern.z, pattern.range), pattern.phase
    step, turn = pattern.step[line], pattern.turn[line]
    unit = max(step, pattern.gap[line]) * turn
    for lane in range(0, LANES, WIDTH):
        _gather_own(rows, phase, pattern.bright, rough, REACH_OWN * (step * turn), lane, window)
        _gather_others(rows, phase, rough, near, REACH_OTHER * unit, lane, window)


@inlined_kernel
def offset_of(slot: int) -> int:
    """Return the offset from the point to a slot of its own ring: before it, then after it."""
    return slot - OWN if slot < OWN else slot - OWN + 1


@noalias_kernel
def _gather_own(
    rows: tuple[Singles, ...],
    phase: Floats,
    bright: Singles,
    rough: Singles,
    most: Single,
    lane: int,
    window: PatternWindow,
) -> None:
    """Gather points from a lane on, and the returns before and after them up to an angle."""
    positions, own, sums, mine = window.positions, window.own, window.sums, window.mine
    in_step = follow(load(positions, lane))
    for row in range(2):
        store(window.bright[row], lane, take(bright[row], positions, lane, 0, in_step))
    origin = take(phase, positions, lane, 0, in_step)
    x, y = take(rows[0], positions, lane, 0, in_step), take(rows[1], positions, lane, 0, in_step)
    z = take(rows[2], positions, lane, 0, in_step)
    r = take(rows[RANGE], positions, lane, 0, in_step)
    store(mine, lane, x)
    store(mine, LANES + lane, y)
    store(mine, 2 * LANES + lane, z)
    store(mine, RANGE * LANES + lane, r)
    there, rough_count, total = no_counts(), no_counts(), repeat(ZERO)
    for slot in range(2 * OWN):
        off = offset_of(slot)
        at = slot * LANES + lane
        p = single(take(phase, positions, lane, off, in_step) - origin)
        reach = take(rows[RANGE], positions, lane, off, in_step)
        dx = take(rows[0], positions, lane, off, in_step) - x
        dy = take(rows[1], positions, lane, off, in_step) - y
        dz = take(rows[2], positions, lane, off, in_step) - z
        good = abs(p) <= most
        d = select(good, dx * dx + dy * dy + dz * dz, FAR)
        store(own, OWN_RANGES * LANES + at, reach)
        store(own, OWN_PHASES * LANES + at, p)
        store(window.square, at, d)
        store(window.away, at, select(good, reach - r, ZERO))
        there = count(there, good)
        # The roughness of those beside it is its own.
        if slot != OWN - 1 and slot != OWN:
            known = d < FAR
            total = total + select(known, take(rough, positions, lane, off, in_step), ZERO)
            rough_count = count(rough_count, known)
    store(sums, SUM.there_own * LANES + lane, single(there))
    store(sums, SUM.rough_own * LANES + lane, total)
    store(sums, SUM.rough_count_own * LANES + lane, single(rough_count))


@noalias_kernel
def _gather_others(
    rows: tuple[Singles, ...],
    phase: Floats,
    rough: Singles,
    near: Index,
    most: Single,
    lane: int,
    window: PatternWindow,
) -> None:
    """Gather the returns around the azimuth in the other rings."""
    positions, mine, sums = window.positions, window.mine, window.sums
    own_in_step = follow(load(positions, lane))
    x, y = load(mine, lane), load(mine, LANES + lane)
    z, r = load(mine, 2 * LANES + lane), load(mine, RANGE * LANES + lane)
    origin = take(phase, positions, lane, 0, own_in_step)
    there, rough_count, total = no_counts(), no_counts(), repeat(ZERO)
    for ring in range(2 * RINGS):
        others = window.others[ring]
        store(others, lane, take(near[ring], positions, lane, 0, own_in_step))
        in_step = follow(load(others, lane))
        for m in range(AROUND):
            off = m - OTHER
            at = (2 * OWN + ring * AROUND + m) * LANES + lane
            p = single(take(phase, others, lane, off, in_step) - origin)
            good = abs(p) <= most
            dx = take(rows[0], others, lane, off, in_step) - x
            dy = take(rows[1], others, lane, off, in_step) - y
            dz = take(rows[2], others, lane, off, in_step) - z
            away = take(rows[RANGE], others, lane, off, in_step) - r
            store(window.square, at, select(good, dx * dx + dy * dy + dz * dz, FAR))
            store(window.away, at, select(good, away, ZERO))
            there = count(there, good)
        known = load(window.square, (2 * OWN + ring * AROUND + OTHER) * LANES + lane) < FAR
        inverse = ONE / take(rows[RANGE], others, lane, 0, in_step)
        store(window.inverse, ring * LANES + lane, select(known, inverse, -ONE))
        total = total + select(known, take(rough, others, lane, 0, in_step), ZERO)
        rough_count = count(rough_count, known)
    store(sums, SUM.there_other * LANES + lane, single(there))
    store(sums, SUM.rough_other * LANES + lane, total)
    store(sums, SUM.rough_count_other * LANES + lane, single(rough_count))


# The features, see features.py --------------------------------------------------------------------
#
# Lengths are divided by the spacing of the beams: range × step along the ring, or × the angle to
# the next ring.


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
    store(values[ROW.bright], lane, load(window.bright[0], lane))
    store(values[ROW.rank], lane, load(window.bright[1], lane))
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
