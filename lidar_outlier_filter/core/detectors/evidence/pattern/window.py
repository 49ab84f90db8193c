# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The window of a spinning sensor's point: the returns around it in the scan pattern.

These are the five returns before and after it in its ring, and seven around its azimuth in each of
the two rings above and below. Returns that are too far in angle do not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import apart_kernel, inlined_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, rows_of_singles
from lidar_outlier_filter.core.neighbours.placed_pattern import LINES_AT_ONCE, Pattern

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Index, Single, Singles

OWN, OTHER = 5, 3  # returns on either side: in the point's ring, and in those beside it
RINGS = 2  # rings above, and below
AROUND = 2 * OTHER + 1
SIZE = 2 * OWN + 2 * RINGS * AROUND  # returns of a window
QUANTITIES = 5  # of a return: x, y, z, range, phase
RANGE, PHASE = 3, 4  # the rows of ranges and phases among them
NEAR = 5  # nearest distances that are kept in order
# Rows of the sums; of the first five, the next row is that of the other rings.
THERE, BEFORE, BEHIND, LEVEL, ROUGH, ROUGH_COUNT = 0, 2, 4, 6, 8, 10
FARTHEST, NEAREST_OTHER, DENSE, SPARSE = 12, 13, 14, 15
SUMS = 16
# Constants of single precision: a number of Python's would make doubles of all it meets.
F = np.float32
REACH_OWN, REACH_OTHER = F(10.0), F(6.0)  # steps from the azimuth up to which returns count
FAR = F(1e12)  # m²: nothing is there
MOST = F(1000.0)  # of a feature
ZERO, HALF, ONE, TWO = F(0.0), F(0.5), F(1.0), F(2.0)


class Prepared(NamedTuple):
    """A pattern of M places, and what its windows share.

    Attributes
    ----------
    pattern : of the points
    rough : (M,) float32
        How much each range differs from what its neighbours in the ring predict; see
        :func:`write_roughness`.
    near : (4, M) int32
        The place nearest in azimuth on each ring beside; see :func:`find_beside`.
    groups : (G, M) float32
        Of a profile scanner, what is said of the free group of each; G is 0 for other sensors.

    """

    pattern: Pattern
    rough: Singles
    near: Index
    groups: Singles


class PatternWindow(NamedTuple):
    """The windows of ``LANES`` points side by side, and room to work in.

    Attributes
    ----------
    square, away : (SIZE, LANES) float32
        Squared distances to the returns, m²; and their ranges, less the point's own, m.
    mine : (PHASE, LANES) float32
        x, y, z and range of the points.
    side : (10 * OWN, LANES) float32
        The same of returns of one ring, and their phases less those of the points.
    best : (NEAR, LANES) float32
        The least squared distances, ascending, m².
    sums : (SUMS, LANES) float32
    inverse : (2 * RINGS, LANES) float32
        1 ÷ range of the nearest return on each ring beside, 1/m; below 0 for none.
    origin : (LANES,) float64
        The phase of each point, which is taken off those of its window, rad.

    """

    square: Singles
    away: Singles
    mine: Singles
    side: Singles
    best: Singles
    sums: Singles
    inverse: Singles
    origin: Floats


@inlined_kernel
def make_window() -> PatternWindow:
    """Make room for one thread."""
    return PatternWindow(
        rows_of_singles(SIZE),
        rows_of_singles(SIZE),
        rows_of_singles(PHASE),
        rows_of_singles(2 * OWN * QUANTITIES),
        rows_of_singles(NEAR),
        rows_of_singles(SUMS),
        rows_of_singles(2 * RINGS),
        np.empty(LANES),
    )


def prepare(pattern: Pattern, threads: int = 0) -> Prepared:
    """Compute what all windows share, in at most so many threads at once; 0 for all cores."""
    places, lines = len(pattern.order), len(pattern.first)
    rough, near = np.zeros(places, np.float32), np.full((2 * RINGS, places), OTHER, np.int32)

    def work(begin: int, end: int) -> None:
        write_roughness(pattern, begin, end, rough)
        find_beside(pattern, begin, end, near)

    pool.run(work, lines, LINES_AT_ONCE, threads)
    return Prepared(pattern, rough, near, np.empty((0, places), np.float32))


@kernel
def write_roughness(pattern: Pattern, begin: int, end: int, rough: Singles) -> None:
    """Write how much ranges differ from what their neighbours in the ring predict.

    Of lines ``begin`` to ``end``: |1 - range × predicted inverse range| ÷ step, because of a plane
    the inverse range is even along a ring; 0 at the ends.
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
            rough[k] = min(abs(ONE - reach[k] * value) / (step + noise / reach[k]), MOST)


@kernel
def find_beside(pattern: Pattern, begin: int, end: int, near: Index) -> None:
    """Write the place of the return nearest in azimuth on each ring beside, of lines begin to end.

    ``near`` (4, M): on the second below, the one below, the one above, the second above; a place of
    no point where there is no such ring. Of two as near, the one before. What is written of other
    places than points must be places, too.
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
def gather(prepared: Prepared, line: int, k: int, window: PatternWindow) -> None:
    """Write the windows of the points of a line from place k on.

    Distances, ranges, inverse ranges and the sums of what is there, and how rough it is. Lanes
    behind the line's end mean nothing.
    """
    # Once, because every time that an array is taken from a tuple its references are counted.
    pattern, rough, near, _ = prepared
    rows, phase = (pattern.x, pattern.y, pattern.z, pattern.range), pattern.phase
    step, turn = pattern.step[line], pattern.turn[line]
    unit = max(step, pattern.gap[line]) * turn
    _gather_own(rows, phase, rough, k, step * turn, window)
    for ring in range(2 * RINGS):
        others = near[ring, k : k + LANES]
        _gather_other(rows, phase, rough, others, ring, unit, window)


@inlined_kernel
def place_of(k: int, slot: int) -> int:
    """Return the place of a slot of a window in the point's own ring: before it, then after."""
    return k + (slot - OWN if slot < OWN else slot - OWN + 1)


@apart_kernel
def _gather_own(
    rows: tuple[Singles, ...],
    phase: Floats,
    rough: Singles,
    k: int,
    step: Single,
    window: PatternWindow,
) -> None:
    """Look at the returns before and after, which lie side by side in memory."""
    square, mine, side, sums = window.square, window.mine, window.side, window.sums
    origin = window.origin
    sums[:] = ZERO
    for lane in range(len(origin)):
        origin[lane] = phase[k + lane]
    for slot in range(2 * OWN):
        _copy_phases(phase[place_of(k, slot) :], origin, side[2 * OWN * PHASE + slot])
    for q in range(PHASE):
        values = rows[q]
        _copy(values[k : k + LANES], mine[q])
        for slot in range(2 * OWN):
            _copy(values[place_of(k, slot) :], side[2 * OWN * q + slot])
    _compare(window, REACH_OWN * step, 0, 2 * OWN, sums[THERE])
    total, count = sums[ROUGH], sums[ROUGH_COUNT]
    for slot in range(2 * OWN):
        # The roughness of those beside it is its own.
        if slot != OWN - 1 and slot != OWN:
            i = place_of(k, slot)
            us, row = rough[i : i + LANES], square[slot]
            for lane in range(len(row)):
                total[lane] += us[lane] if row[lane] < FAR else ZERO
                count[lane] += ONE if row[lane] < FAR else ZERO


@apart_kernel
def _copy(values: Singles, row: Singles) -> None:
    for lane in range(len(row)):
        row[lane] = values[lane]


@apart_kernel
def _copy_phases(phase: Floats, origin: Floats, row: Singles) -> None:
    """Write phases less that of each lane's point."""
    for lane in range(len(row)):
        row[lane] = phase[lane] - origin[lane]


@apart_kernel
def _gather_other(
    rows: tuple[Singles, ...],
    phase: Floats,
    rough: Singles,
    others: Index,
    ring: int,
    unit: Single,
    window: PatternWindow,
) -> None:
    """Look at the returns around the azimuth in another ring: first put them side by side."""
    side, in_step = window.side, _is_in_step(others)
    for q in range(PHASE):
        _line_up(rows[q], others, in_step, side[q * AROUND : (q + 1) * AROUND])
    _line_up_phases(phase, others, in_step, window.origin, side[PHASE * AROUND :])
    begin = 2 * OWN + ring * AROUND
    _compare(window, REACH_OTHER * unit, begin, AROUND, window.sums[THERE + 1])
    middle, inverse = window.square[begin + OTHER], window.inverse[ring]
    nearest = side[RANGE * AROUND + OTHER]
    total, count = window.sums[ROUGH + 1], window.sums[ROUGH_COUNT + 1]
    for lane in range(len(middle)):
        good = middle[lane] < FAR
        inverse[lane] = ONE / nearest[lane] if good else -ONE
        total[lane] += rough[others[lane]] if good else ZERO
        count[lane] += ONE if good else ZERO


@apart_kernel
def _compare(window: PatternWindow, most: Single, begin: int, rows: int, there: Singles) -> None:
    """Compare points with the returns beside them: slots of the window from ``begin`` on.

    ``side`` has so many rows of x, then of y, z, range and phase.
    """
    side, mine, squares, ranges = window.side, window.mine, window.square, window.away
    x, y, z, r = mine[0], mine[1], mine[2], mine[3]
    for m in range(rows):
        xs, ys, zs = side[m], side[rows + m], side[2 * rows + m]
        rs, ps = side[3 * rows + m], side[4 * rows + m]
        square, away = squares[begin + m], ranges[begin + m]
        for lane in range(len(square)):
            good = abs(ps[lane]) <= most
            dx, dy, dz = xs[lane] - x[lane], ys[lane] - y[lane], zs[lane] - z[lane]
            d = dx * dx + dy * dy + dz * dz
            square[lane] = d if good else FAR
            away[lane] = rs[lane] - r[lane] if good else ZERO
            there[lane] += ONE if good else ZERO


@apart_kernel
def _is_in_step(others: Index) -> bool:
    """Return whether returns of another ring follow each other as those of the ring itself do."""
    same = True
    for lane in range(len(others)):
        same &= others[lane] - others[0] == lane
    return same


@apart_kernel
def _line_up(values: Singles, others: Index, in_step: bool, side: Singles) -> None:
    """Put what is around the places ``others`` beside each other, row by row."""
    for m in range(len(side)):
        row, off = side[m], np.int32(m - OTHER)
        if in_step:
            _copy(values[others[0] + off :], row)
        else:
            for lane in range(len(row)):
                row[lane] = values[others[lane] + off]


@apart_kernel
def _line_up_phases(
    phase: Floats, others: Index, in_step: bool, origin: Floats, side: Singles
) -> None:
    """Do so with phases."""
    for m in range(AROUND):
        row, off = side[m], np.int32(m - OTHER)
        if in_step:
            _copy_phases(phase[others[0] + off :], origin, row)
        else:
            for lane in range(len(row)):
                row[lane] = phase[others[lane] + off] - origin[lane]
