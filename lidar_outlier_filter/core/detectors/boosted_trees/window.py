# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The window of a spinning sensor's point: the returns around it in the scan pattern.

These are the five returns before and after it in its ring, and seven around its azimuth in each of
the two rings above and below. Returns that are too far in angle do not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.features import rows
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, rows_of_singles
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern, lines_at_once

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats, Index, Ints, Single, Singles

OWN, OTHER = 5, 3  # returns on either side: in the point's ring, and in those beside it
RINGS = 2  # rings above, and below
AROUND = 2 * OTHER + 1
SIZE = 2 * OWN + 2 * RINGS * AROUND  # returns of a window
QUANTITIES = 5  # of a return: x, y, z, range, phase
RANGE, PHASE = 3, 4  # the rows of ranges and phases among them
OWN_RANGES, OWN_PHASES = 2 * OWN * RANGE, 2 * OWN * PHASE  # the same of the own ring's returns
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
    mine : (PHASE, LANES) float32
        x, y, z and range of the points.
    bright : (LANES,) float32
        How bright the points are.
    own, side : (10 * OWN, LANES), (5 * AROUND, LANES) float32
        x, y, z and range of the returns of the points' own ring, and of those of one other ring,
        and their phases less those of the points.
    best : (KEPT_NEAREST, LANES) float32
        The least squared distances, ascending, m².
    sums : (SUMS, LANES) float32
    inverse : (2 * RINGS, LANES) float32
        1 ÷ range of the nearest return on each ring beside, 1/m; below 0 for none.
    origin : (LANES,) float64
        The phase of each point, which is taken off those of its window, rad.
    places : (LANES,) int64
        Where the points are in the pattern: all in one line, in any order.
    others : (2 * RINGS, LANES) int64
        The place nearest to each in azimuth on each ring beside.

    """

    square: Singles
    away: Singles
    mine: Singles
    bright: Singles
    own: Singles
    side: Singles
    best: Singles
    sums: Singles
    inverse: Singles
    origin: Floats
    places: Ints
    others: Ints


@inlined_kernel
def make_window() -> PatternWindow:
    """Make room for one thread."""
    return PatternWindow(
        rows_of_singles(SIZE),
        rows_of_singles(SIZE),
        rows_of_singles(PHASE),
        np.empty(LANES, np.float32),
        rows_of_singles(2 * OWN * QUANTITIES),
        rows_of_singles(AROUND * QUANTITIES),
        rows_of_singles(KEPT_NEAREST),
        rows_of_singles(len(_SUMS)),
        rows_of_singles(2 * RINGS),
        np.empty(LANES),
        np.empty(LANES, np.int64),
        np.empty((2 * RINGS, LANES), np.int64),
    )


def prepare(pattern: Pattern, threads: int = 0) -> Prepared:
    """Compute what all windows share, in at most so many threads at once; 0 for all cores."""
    places, lines = len(pattern.order), len(pattern.first)
    rough, near = np.zeros(places, np.float32), np.full((2 * RINGS, places), OTHER, np.int32)

    def work(begin: int, end: int) -> None:
        write_roughness(pattern, begin, end, rough)
        find_beside(pattern, begin, end, near)

    pool.run(work, lines, lines_at_once(lines, places), threads)
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
            rough[k] = min(abs(ONE - reach[k] * value) / (step + noise / reach[k]), MAX_VALUE)


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
def gather(prepared: Prepared, line: int, window: PatternWindow) -> None:
    """Write the windows of the points of a line that are at the window's places.

    Distances, ranges, inverse ranges, and sums of the returns and their roughness.
    """
    # Once, because every time that an array is taken from a tuple its references are counted.
    pattern, rough, near, _ = prepared
    rows, phase = (pattern.x, pattern.y, pattern.z, pattern.range), pattern.phase
    step, turn = pattern.step[line], pattern.turn[line]
    unit = max(step, pattern.gap[line]) * turn
    _pick(near, window)
    _gather_own(rows, phase, pattern.bright, rough, step * turn, window)
    for ring in range(2 * RINGS):
        _gather_other(rows, phase, rough, ring, unit, window)


@inlined_kernel
def offset_of(slot: int) -> int:
    """Return how many places behind the point a slot of its own ring is: before it, then after."""
    return slot - OWN if slot < OWN else slot - OWN + 1


@noalias_kernel
def _pick(near: Index, window: PatternWindow) -> None:
    """Look up the places on the rings beside."""
    places, others = window.places, window.others
    for ring in range(len(others)):
        for lane in range(len(places)):
            others[ring, lane] = near[ring, places[lane]]


@noalias_kernel
def _gather_own(
    rows: tuple[Singles, ...],
    phase: Floats,
    bright: Singles,
    rough: Singles,
    step: Single,
    window: PatternWindow,
) -> None:
    """Gather the points, and the returns before and after them."""
    square, mine, own, sums = window.square, window.mine, window.own, window.sums
    origin, places, side = window.origin, window.places, window.side
    in_step = _is_in_step(places)
    sums[:] = ZERO
    for lane in range(len(origin)):
        origin[lane] = phase[places[lane]]
    _copy(bright, places, in_step, 0, window.bright)
    for q in range(PHASE):
        _copy(rows[q], places, in_step, 0, mine[q])
        _copy_beside(rows[q], places, in_step, own[2 * OWN * q :])
    _copy_phases(phase, places, in_step, -OWN, origin, own[OWN_PHASES : OWN_PHASES + OWN])
    _copy_phases(phase, places, in_step, 1, origin, own[OWN_PHASES + OWN :])
    _compare(window, own, REACH_OWN * step, 0, 2 * OWN, sums[SUM.there_own])
    _copy_beside(rough, places, in_step, side)
    total, count = sums[SUM.rough_own], sums[SUM.rough_count_own]
    for slot in range(2 * OWN):
        # The roughness of those beside it is its own.
        if slot != OWN - 1 and slot != OWN:
            row, us = square[slot], side[slot]
            for lane in range(len(row)):
                total[lane] += us[lane] if row[lane] < FAR else ZERO
                count[lane] += ONE if row[lane] < FAR else ZERO


@noalias_kernel
def _gather_other(
    rows: tuple[Singles, ...],
    phase: Floats,
    rough: Singles,
    ring: int,
    unit: Single,
    window: PatternWindow,
) -> None:
    """Gather the returns around the azimuth in another ring."""
    side, others = window.side, window.others[ring]
    in_step = _is_in_step(others)
    begin, most, there = 2 * OWN + ring * AROUND, REACH_OTHER * unit, window.sums[SUM.there_other]
    phases, nearest = side[PHASE * AROUND : QUANTITIES * AROUND], side[0]
    _copy_phases(phase, others, in_step, -OTHER, window.origin, phases)
    if in_step:
        # They are read where they are: to copy them takes as long as to compare them.
        start = others[0] - OTHER
        xs, ys, zs, rs = rows[0][start:], rows[1][start:], rows[2][start:], rows[RANGE][start:]
        for m in range(AROUND):
            square, away = window.square[begin + m], window.away[begin + m]
            returns = xs[m:], ys[m:], zs[m:], rs[m:], phases[m]
            _compare_row(window.mine, returns, most, square, away, there)
    else:
        for q in range(PHASE):
            _copy_rows(rows[q], others, in_step, -OTHER, side[q * AROUND : (q + 1) * AROUND])
        _compare(window, side, most, begin, AROUND, there)
    _copy(rows[RANGE], others, in_step, 0, nearest)
    middle, inverse = window.square[begin + OTHER], window.inverse[ring]
    total, count = window.sums[SUM.rough_other], window.sums[SUM.rough_count_other]
    for lane in range(len(middle)):
        good = middle[lane] < FAR
        inverse[lane] = ONE / nearest[lane] if good else -ONE
        total[lane] += rough[others[lane]] if good else ZERO
        count[lane] += ONE if good else ZERO


@noalias_kernel
def _is_in_step(places: Ints) -> bool:
    """Return whether places follow each other."""
    same = True
    for lane in range(len(places)):
        same &= places[lane] - places[0] == lane
    return same


@noalias_kernel
def _copy(values: Singles, places: Ints, in_step: bool, off: int, row: Singles) -> None:
    """Write the values so many places behind some."""
    if in_step:
        some = values[places[0] + off :]
        for lane in range(len(row)):
            row[lane] = some[lane]
    else:
        for lane in range(len(row)):
            row[lane] = values[places[lane] + off]


@inlined_kernel
def _copy_beside(values: Singles, places: Ints, in_step: bool, rows: Singles) -> None:
    """Write the values of the returns before some places, and then of those after them."""
    _copy_rows(values, places, in_step, -OWN, rows[:OWN])
    _copy_rows(values, places, in_step, 1, rows[OWN : 2 * OWN])


@noalias_kernel
def _copy_rows(values: Singles, places: Ints, in_step: bool, off: int, rows: Singles) -> None:
    """Write the values so many places behind some, into each next row those one place on."""
    # A call for each row would take several times as long as what it copies.
    if in_step:
        some = values[places[0] + off :]
        for m in range(len(rows)):
            for lane in range(rows.shape[1]):
                rows[m, lane] = some[m + lane]
    else:
        # One place after the other: a processor reads single ones slowly from all over an array.
        for lane in range(rows.shape[1]):
            k = places[lane] + off
            for m in range(len(rows)):
                rows[m, lane] = values[k + m]


@noalias_kernel
def _copy_phases(
    phase: Floats, places: Ints, in_step: bool, off: int, origin: Floats, rows: Singles
) -> None:
    """Do so with phases, less that of each lane's point."""
    if in_step:
        some = phase[places[0] + off :]
        for m in range(len(rows)):
            for lane in range(rows.shape[1]):
                rows[m, lane] = some[m + lane] - origin[lane]
    else:
        # One place after the other: a processor reads single ones slowly from all over an array.
        for lane in range(rows.shape[1]):
            k = places[lane] + off
            for m in range(len(rows)):
                rows[m, lane] = phase[k + m] - origin[lane]


@noalias_kernel
def _compare(
    window: PatternWindow, side: Singles, most: Single, begin: int, rows: int, there: Singles
) -> None:
    """Compare points with the returns beside them: slots of the window from ``begin`` on.

    ``side`` has so many rows of x, then of y, z, range and phase.
    """
    squares, ranges = window.square, window.away
    for m in range(rows):
        xs, ys, zs = side[m], side[rows + m], side[2 * rows + m]
        returns = xs, ys, zs, side[3 * rows + m], side[4 * rows + m]
        _compare_row(window.mine, returns, most, squares[begin + m], ranges[begin + m], there)


@noalias_kernel
def _compare_row(
    mine: Singles,
    returns: tuple[Singles, ...],
    most: Single,
    square: Singles,
    away: Singles,
    there: Singles,
) -> None:
    """Compare points with one return of each: its x, y, z and range, and its phase less theirs."""
    x, y, z, r = mine[0], mine[1], mine[2], mine[3]
    xs, ys, zs, rs, ps = returns
    for lane in range(len(square)):
        good = abs(ps[lane]) <= most
        dx, dy, dz = xs[lane] - x[lane], ys[lane] - y[lane], zs[lane] - z[lane]
        d = dx * dx + dy * dy + dz * dz
        square[lane] = d if good else FAR
        away[lane] = rs[lane] - r[lane] if good else ZERO
        there[lane] += ONE if good else ZERO
