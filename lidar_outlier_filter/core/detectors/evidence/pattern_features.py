# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the scan pattern says of a spinning sensor's points: features, one number each.

The window of a point are the five returns before and after it in its ring, and seven around its
azimuth in each of the two rings above and below; those that are too far in angle do not count.
Lengths are divided by what the beams are apart there: range × step along the ring, or × the angle
to the next ring.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels import kernel
from lidar_outlier_filter.core.lanes import LANES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.neighbours.scan_pattern import Pattern

    Singles = NDArray[np.float32]
    Places = NDArray[np.int32]
    Number = np.float32

OWN, OTHER = 5, 3  # returns on either side: in the point's ring, and in those beside it
RINGS = 2  # rings above, and below
AROUND = 2 * OTHER + 1
SIZE = 2 * OWN + 2 * RINGS * AROUND  # returns of a window
FEATURES = (
    'step',  # distance to the nearer return of the ring, beside it
    'leap',  # to the farther
    'along',  # least difference of the range from three predictions along the ring
    'along_m',  # the same, metres
    'between',  # difference from the prediction between both neighbours
    'beside',  # distance to the nearest return of other rings
    'across',  # least difference of the range from three predictions across the rings
    'near3',  # mean distance to the three nearest of the window
    'near5',
    'near5_m',  # the same, metres
    'before_own',  # share of the ring's returns that are nearer to the sensor
    'behind_own',
    'before_other',
    'behind_other',
    'level_own',  # share of all places, that are at the same range
    'level_other',
    'there_own',  # share of the places that have a return
    'there_other',
    'rough_own',  # how much ranges differ from predictions along the ring, around the point
    'rough_other',
    'range',
    'glare',  # range² ÷ range of the background: what a particle must outshine
    'depth',  # range ÷ that of the background
    'dense',  # share of the window within 2 beams
    'sparse',  # within 6 beams
)
COUNT = len(FEATURES)
AGAIN = (
    'first',  # score of the first look, -4 to 4
    'first_own',  # mean of those of the ring's returns
    'first_other',  # of other rings'
    'first_close',  # of all, the closer the more weight
    'first_level',  # of those at the same range; -5 for none
    'first_behind',  # of those farther from the sensor; -5 for none
    'first_before',
    'wide_own',  # share of a longer stretch of the ring whose score is above 0
    'wide_other',  # the same of other rings
    'share',  # of all points seen together
    'share_range',  # of those of them that are as far from the sensor
)
COUNT_AGAIN = COUNT + len(AGAIN)
CLIP = np.float32(4.0)
UNKNOWN = np.float32(-5.0)
STRETCH = 24  # returns on either side, of the longer stretch
PLACES_WIDE = np.float32(2 * STRETCH + 1)
BINS = 8  # of range: up to 1, 2, 4, 8 ... m
NEAR = 5  # nearest distances that are kept in order
# Constants of single precision: a number of Python's would make doubles of all it meets.
F = np.float32
REACH_OWN, REACH_OTHER = F(10.0), F(6.0)  # steps from the azimuth up to which returns count
FAR = F(1e12)  # m²: nothing is there
MOST = F(1000.0)  # of a feature
SAME, SAME_M = F(1.5), F(0.06)  # beams apart, and metres: still at one range
NOISE_M = F(0.02)  # metres that are added to what beams are apart: no range is better
ZERO, HALF, ONE, TWO, THREE, FIVE = F(0.0), F(0.5), F(1.0), F(2.0), F(3.0), F(5.0)
DENSE, SPARSE = F(4.0), F(36.0)  # beams apart, squared
PLACES_OWN, PLACES_OTHER, PLACES = F(2 * OWN), F(SIZE - 2 * OWN), F(SIZE)


class WindowRoom(NamedTuple):
    """Room to work in, for ``LANES`` points side by side."""

    square: Singles  # squared distances to the returns of the window
    away: Singles  # their ranges, less the point's own
    mine: Singles  # x, y, z, range, phase
    near: Singles  # the same of returns of one ring
    best: Singles
    sums: Singles
    inverse: Singles


@kernel
def make_room() -> WindowRoom:
    """Make room for one thread."""
    return WindowRoom(
        np.empty((SIZE, LANES), np.float32),
        np.empty((SIZE, LANES), np.float32),
        np.empty((5, LANES), np.float32),
        np.empty((10 * OWN, LANES), np.float32),
        np.empty((NEAR, LANES), np.float32),
        np.empty((16, LANES), np.float32),
        np.empty((2 * RINGS, LANES), np.float32),
    )


@kernel
def roughness(pattern: Pattern, begin: int, end: int, rough: Singles) -> None:
    """Write how much ranges differ from what their neighbours in the ring predict.

    Of lines ``begin`` to ``end``: |1 - range × predicted inverse range| ÷ step, because of a plane
    the inverse range is even along a ring; 0 at the ends.
    """
    reach, phase = pattern.range, pattern.phase
    for line in range(begin, end):
        low, high = pattern.first[line], pattern.last[line]
        step = pattern.step[line]
        rough[low], rough[high - 1] = ZERO, ZERO
        for k in range(low + 1, high - 1):
            span = phase[k + 1] - phase[k - 1]
            part = (phase[k] - phase[k - 1]) / span if span > ZERO else HALF
            value = (ONE - part) / reach[k - 1] + part / reach[k + 1]
            rough[k] = min(abs(ONE - reach[k] * value) / (step + NOISE_M / reach[k]), MOST)


@kernel
def find_beside(pattern: Pattern, begin: int, end: int, near: Places) -> None:
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


@kernel
def measure(
    pattern: Pattern, rough: Singles, near: Places, begin: int, end: int, out: Singles
) -> None:
    """Write the features of all points of lines begin to end: (COUNT, M)."""
    room = make_room()
    values = np.empty((COUNT, LANES), np.float32)
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            look(pattern, rough, near, line, k, room, values)
            stop = min(pattern.last[line] - k, LANES)
            for f in range(COUNT):
                for lane in range(stop):
                    out[f, k + lane] = values[f, lane]


@kernel
def look(
    pattern: Pattern,
    rough: Singles,
    near: Places,
    line: int,
    k: int,
    room: WindowRoom,
    values: Singles,
) -> None:
    """Write the features of the points from place k on, those of other lines mean nothing."""
    step, gap = pattern.step[line], pattern.gap[line]
    _gather_own(pattern, rough, k, step, room)
    for ring in range(2 * RINGS):
        _gather_other(pattern, rough, near[ring], ring, k, max(step, gap), room)
    _count(pattern.range[k : k + LANES], gap, room)
    _along(pattern, k, step, values)
    _write(pattern.range[k : k + LANES], step, gap, room, values)


@kernel
def _gather_own(pattern: Pattern, rough: Singles, k: int, step: Number, room: WindowRoom) -> None:
    """Look at the returns before and after, which lie side by side in memory."""
    side, mine, sums = room.near, room.mine, room.sums
    sums[:] = ZERO
    _slide(pattern.x, k, 0, mine, side)
    _slide(pattern.y, k, 1, mine, side)
    _slide(pattern.z, k, 2, mine, side)
    _slide(pattern.range, k, 3, mine, side)
    _slide(pattern.phase, k, 4, mine, side)
    _compare(side, mine, REACH_OWN * step, room.square[: 2 * OWN], room.away[: 2 * OWN], sums[0])
    total, count = sums[8], sums[10]
    for slot in range(2 * OWN):
        # The roughness of those beside it is its own.
        if slot != OWN - 1 and slot != OWN:
            i = k + (slot - OWN if slot < OWN else slot - OWN + 1)
            us, square = rough[i : i + LANES], room.square[slot]
            for lane in range(len(square)):
                total[lane] += us[lane] if square[lane] < FAR else ZERO
                count[lane] += ONE if square[lane] < FAR else ZERO


@kernel
def _slide(values: Singles, k: int, row: int, mine: Singles, side: Singles) -> None:
    """Put what is before and after the places from k on beside each other."""
    target, some = mine[row], values[k : k + LANES]
    for lane in range(len(target)):
        target[lane] = some[lane]
    for slot in range(2 * OWN):
        i = k + (slot - OWN if slot < OWN else slot - OWN + 1)
        target, some = side[2 * OWN * row + slot], values[i : i + LANES]
        for lane in range(len(target)):
            target[lane] = some[lane]


@kernel
def _width(array: Singles) -> int:
    return int(array.shape[1])


@kernel
def _gather_other(
    pattern: Pattern,
    rough: Singles,
    near: Places,
    ring: int,
    k: int,
    unit: Number,
    room: WindowRoom,
) -> None:
    """Look at the returns around the azimuth in another ring: first put them side by side."""
    side, others = room.near, near[k : k + LANES]
    in_step = _is_in_step(others)
    _line_up(pattern.x, others, in_step, side[:AROUND])
    _line_up(pattern.y, others, in_step, side[AROUND : 2 * AROUND])
    _line_up(pattern.z, others, in_step, side[2 * AROUND : 3 * AROUND])
    _line_up(pattern.range, others, in_step, side[3 * AROUND : 4 * AROUND])
    _line_up(pattern.phase, others, in_step, side[4 * AROUND : 5 * AROUND])
    begin = 2 * OWN + ring * AROUND
    square, away = room.square[begin : begin + AROUND], room.away[begin : begin + AROUND]
    _compare(side, room.mine, REACH_OTHER * unit, square, away, room.sums[1])
    middle, inverse, nearest = square[OTHER], room.inverse[ring], side[3 * AROUND + OTHER]
    total, count = room.sums[9], room.sums[11]
    for lane in range(len(middle)):
        good = middle[lane] < FAR
        inverse[lane] = ONE / nearest[lane] if good else -ONE
        total[lane] += rough[others[lane]] if good else ZERO
        count[lane] += ONE if good else ZERO


@kernel
def _compare(
    side: Singles, mine: Singles, most: Number, square: Singles, away: Singles, there: Singles
) -> None:
    """Compare points with returns beside them: rows of x, then of y, z, range and phase."""
    x, y, z, r, p = mine[0], mine[1], mine[2], mine[3], mine[4]
    rows = len(square)
    for m in range(rows):
        xs, ys, zs = side[m], side[rows + m], side[2 * rows + m]
        rs, ps = side[3 * rows + m], side[4 * rows + m]
        sq, aw = square[m], away[m]
        for lane in range(len(sq)):
            good = abs(ps[lane] - p[lane]) <= most
            dx, dy, dz = xs[lane] - x[lane], ys[lane] - y[lane], zs[lane] - z[lane]
            d = dx * dx + dy * dy + dz * dz
            sq[lane] = d if good else FAR
            aw[lane] = rs[lane] - r[lane] if good else ZERO
            there[lane] += ONE if good else ZERO


@kernel
def _is_in_step(others: Places) -> bool:
    """Return whether returns of another ring follow each other as those of the ring itself do."""
    same = True
    for lane in range(len(others)):
        same &= others[lane] - others[0] == lane
    return same


@kernel
def _line_up(values: Singles, others: Places, in_step: bool, side: Singles) -> None:
    """Put what is around the places ``others`` beside each other, row by row."""
    for m in range(len(side)):
        row, off = side[m], np.int32(m - OTHER)
        if in_step:
            some = values[others[0] + off :]
            for lane in range(len(row)):
                row[lane] = some[lane]
        else:
            for lane in range(len(row)):
                row[lane] = values[others[lane] + off]


@kernel
def _count(reach: Singles, gap: Number, room: WindowRoom) -> None:
    """Count returns before, behind and at the same range, and find the nearest of all."""
    square, away, sums, best = room.square, room.away, room.sums, room.best
    best[:] = FAR
    for lane in range(_width(square)):
        sums[12, lane] = reach[lane]
        sums[13, lane] = FAR
    for slot in range(2 * OWN, SIZE):
        for lane in range(_width(square)):
            sums[13, lane] = min(sums[13, lane], square[slot, lane])
    for slot in range(SIZE):
        part = 0 if slot < 2 * OWN else 1
        for lane in range(_width(square)):
            mine, value, off = reach[lane], square[slot, lane], away[slot, lane]
            unit = mine * gap + NOISE_M
            same = SAME * unit + SAME_M
            sums[2 + part, lane] += ONE if off < -same else ZERO
            sums[4 + part, lane] += ONE if off > same else ZERO
            sums[6 + part, lane] += ONE if (abs(off) <= same) & (value < FAR) else ZERO
            sums[14, lane] += ONE if value <= DENSE * unit * unit else ZERO
            sums[15, lane] += ONE if value <= SPARSE * unit * unit else ZERO
            sums[12, lane] = max(sums[12, lane], mine + off)
        if slot == OWN - 1 or slot == OWN:
            for lane in range(_width(square)):
                away[slot, lane] = square[slot, lane]
        for lane in range(_width(square)):
            # One after the other finds its rank; what is larger goes on.
            value = square[slot, lane]
            a = best[0, lane]
            best[0, lane], value = min(a, value), max(a, value)
            a = best[1, lane]
            best[1, lane], value = min(a, value), max(a, value)
            a = best[2, lane]
            best[2, lane], value = min(a, value), max(a, value)
            a = best[3, lane]
            best[3, lane], value = min(a, value), max(a, value)
            best[4, lane] = min(best[4, lane], value)


@kernel
def _along(pattern: Pattern, k: int, step: Number, values: Singles) -> None:
    """Write what three predictions along the ring say of the range."""
    r0, p0 = pattern.range[k : k + LANES], pattern.phase[k : k + LANES]
    ra, pa = pattern.range[k - 1 : k - 1 + LANES], pattern.phase[k - 1 : k - 1 + LANES]
    rb, pb = pattern.range[k + 1 : k + 1 + LANES], pattern.phase[k + 1 : k + 1 + LANES]
    rc, pc = pattern.range[k - 2 : k - 2 + LANES], pattern.phase[k - 2 : k - 2 + LANES]
    rd, pd = pattern.range[k + 2 : k + 2 + LANES], pattern.phase[k + 2 : k + 2 + LANES]
    most = REACH_OWN * step
    for lane in range(_width(values)):
        r, p = r0[lane], p0[lane]
        middle = _off(r, p, ra[lane], pa[lane], rb[lane], pb[lane], most)
        before = _off(r, p, ra[lane], pa[lane], rc[lane], pc[lane], most)
        after = _off(r, p, rb[lane], pb[lane], rd[lane], pd[lane], most)
        least = min(middle, before, after)
        unit = step + NOISE_M / r
        values[2, lane] = min(least / unit, MOST)
        values[3, lane] = min(least * r, MOST)
        values[4, lane] = min(middle / unit, MOST)


@kernel
def _off(
    r: Number, p: Number, ra: Number, pa: Number, rb: Number, pb: Number, most: Number
) -> Number:
    """Return how far a range is from the straight line through two others, as a part of it."""
    span = pb - pa
    good = (abs(pa - p) <= most) & (abs(pb - p) <= most) & (span != ZERO)
    part = (p - pa) / (span if good else ONE)
    value = (ONE - part) / ra + part / rb
    # What the noise of both adds is taken off.
    size = np.sqrt(ONE + (ONE - part) * (ONE - part) + part * part)
    off = min(abs(ONE - r * value) / size, MOST)
    return off if good else MOST


@kernel
def _write(reach: Singles, step: Number, gap: Number, room: WindowRoom, values: Singles) -> None:
    sums, best, inverse, away = room.sums, room.best, room.inverse, room.away
    for lane in range(_width(values)):
        mine = reach[lane]
        own_unit, unit = mine * step + NOISE_M, mine * gap + NOISE_M
        a, b = np.sqrt(away[OWN - 1, lane]), np.sqrt(away[OWN, lane])
        values[0, lane] = min(min(a, b) / own_unit, MOST)
        values[1, lane] = min(max(a, b) / own_unit, MOST)
        values[5, lane] = min(np.sqrt(sums[13, lane]) / unit, MOST)
        three = np.sqrt(best[0, lane]) + np.sqrt(best[1, lane]) + np.sqrt(best[2, lane])
        five = three + np.sqrt(best[3, lane]) + np.sqrt(best[4, lane])
        values[7, lane] = min(three / (THREE * unit), MOST)
        values[8, lane] = min(five / (FIVE * unit), MOST)
        values[9, lane] = min(five / FIVE, MOST)
    for lane in range(_width(values)):
        own, others = max(sums[0, lane], ONE), max(sums[1, lane], ONE)
        values[10, lane] = sums[2, lane] / own
        values[11, lane] = sums[4, lane] / own
        values[12, lane] = sums[3, lane] / others
        values[13, lane] = sums[5, lane] / others
        values[14, lane] = sums[6, lane] / PLACES_OWN
        values[15, lane] = sums[7, lane] / PLACES_OTHER
        values[16, lane] = sums[0, lane] / PLACES_OWN
        values[17, lane] = sums[1, lane] / PLACES_OTHER
        values[18, lane] = sums[8, lane] / max(sums[10, lane], ONE)
        values[19, lane] = sums[9, lane] / max(sums[11, lane], ONE)
    for lane in range(_width(values)):
        mine, farthest = reach[lane], sums[12, lane]
        values[20, lane] = mine
        values[21, lane] = mine * mine / farthest
        values[22, lane] = mine / farthest
        values[23, lane] = sums[14, lane] / PLACES
        values[24, lane] = sums[15, lane] / PLACES
        # Rings are taken as evenly spaced; an inverse below 0 is unknown.
        a, b, c, d = inverse[0, lane], inverse[1, lane], inverse[2, lane], inverse[3, lane]
        between = abs(ONE - mine * HALF * (b + c)) if (b > ZERO) & (c > ZERO) else MOST
        below = abs(ONE - mine * (TWO * b - a)) * HALF if (a > ZERO) & (b > ZERO) else MOST
        above = abs(ONE - mine * (TWO * c - d)) * HALF if (c > ZERO) & (d > ZERO) else MOST
        values[6, lane] = min(min(between, below, above) / (gap + NOISE_M / mine), MOST)


@kernel
def measure_again(
    pattern: Pattern,
    rough: Singles,
    near: Places,
    score: Singles,
    crowd: Crowd,
    begin: int,
    end: int,
    out: Singles,
) -> None:
    """Write the features of all points of lines begin to end, with their neighbours' scores."""
    room = make_room()
    values = np.empty((COUNT_AGAIN, LANES), np.float32)
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            look_again(pattern, rough, near, score, crowd, line, k, room, values)
            stop = min(pattern.last[line] - k, LANES)
            for f in range(COUNT_AGAIN):
                for lane in range(stop):
                    out[f, k + lane] = values[f, lane]


@kernel
def look_again(
    pattern: Pattern,
    rough: Singles,
    near: Places,
    score: Singles,
    crowd: Crowd,
    line: int,
    k: int,
    room: WindowRoom,
    values: Singles,
) -> None:
    """Write the features of the points from place k on, with what was said of their neighbours."""
    step, gap = pattern.step[line], pattern.gap[line]
    _gather_own(pattern, rough, k, step, room)
    for ring in range(2 * RINGS):
        _gather_other(pattern, rough, near[ring], ring, k, max(step, gap), room)
    _of_neighbours(pattern, near, score, k, gap, room, values)
    _of_crowd(near, crowd, k, values)
    _count(pattern.range[k : k + LANES], gap, room)
    _along(pattern, k, step, values)
    _write(pattern.range[k : k + LANES], step, gap, room, values)


@kernel
def _of_neighbours(
    pattern: Pattern,
    near: Places,
    score: Singles,
    k: int,
    gap: Number,
    room: WindowRoom,
    values: Singles,
) -> None:
    reach = pattern.range[k : k + LANES]
    square, away, side = room.square, room.away, room.near
    total = side[:12]
    total[:] = ZERO
    scores = side[12]
    for slot in range(SIZE):
        if slot < 2 * OWN:
            j = k + (slot - OWN if slot < OWN else slot - OWN + 1)
            for lane in range(_width(square)):
                scores[lane] = score[j + lane]
        else:
            ring, m = (slot - 2 * OWN) // AROUND, (slot - 2 * OWN) % AROUND - OTHER
            others = near[ring, k : k + LANES]
            for lane in range(_width(square)):
                scores[lane] = score[others[lane] + m]
        part = 0 if slot < 2 * OWN else 1
        for lane in range(_width(square)):
            value, off = square[slot, lane], away[slot, lane]
            unit = reach[lane] * gap + NOISE_M
            good = value < FAR
            same = SAME * unit + SAME_M
            c = min(max(scores[lane], -CLIP), CLIP)
            one = ONE if good else ZERO
            weight = unit * unit / (unit * unit + value) if good else ZERO
            level = ONE if good & (abs(off) <= same) else ZERO
            behind, before = ONE if off > same else ZERO, ONE if off < -same else ZERO
            total[part, lane] += one * c
            total[2 + part, lane] += one
            total[4, lane] += weight * c
            total[5, lane] += weight
            total[6, lane] += level * c
            total[7, lane] += level
            total[8, lane] += behind * c
            total[9, lane] += behind
            total[10, lane] += before * c
            total[11, lane] += before
    for lane in range(_width(square)):
        values[COUNT, lane] = min(max(score[k + lane], -CLIP), CLIP)
        values[COUNT + 1, lane] = _mean(total[0, lane], total[2, lane])
        values[COUNT + 2, lane] = _mean(total[1, lane], total[3, lane])
        values[COUNT + 3, lane] = _mean(total[4, lane], total[5, lane])
        values[COUNT + 4, lane] = _mean(total[6, lane], total[7, lane])
        values[COUNT + 5, lane] = _mean(total[8, lane], total[9, lane])
        values[COUNT + 6, lane] = _mean(total[10, lane], total[11, lane])


@kernel
def _mean(total: Number, count: Number) -> Number:
    return total / count if count > ZERO else UNKNOWN


class Crowd(NamedTuple):
    """How many points have a score above 0.

    Attributes
    ----------
    before : (M + 1,) int32
        Up to each place.
    share : (M,) float32
        Of all points as far as each.
    whole : float32
        Of all points.

    """

    before: Places
    share: Singles
    whole: np.float32


@kernel
def find_crowd(pattern: Pattern, score: Singles) -> Crowd:
    """Count the points with a score above 0."""
    places = len(score)
    before, share = np.zeros(places + 1, np.int32), np.zeros(places, np.float32)
    count, above = np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
    of = np.zeros(places, np.int8)
    for k in range(places):
        there = pattern.order[k] >= 0
        mine, edge, b = pattern.range[k], ONE, 0
        while b < BINS - 1 and mine > edge:
            b, edge = b + 1, edge * TWO
        flag = there and score[k] > ZERO
        before[k + 1] = before[k] + flag
        count[b] += there
        above[b] += flag
        of[k] = b
    for k in range(places):
        share[k] = above[of[k]] / max(count[of[k]], 1)
    return Crowd(before, share, np.float32(above.sum() / max(count.sum(), 1)))


@kernel
def _of_crowd(near: Places, crowd: Crowd, k: int, values: Singles) -> None:
    low, high = crowd.before[k - STRETCH :], crowd.before[k + STRETCH + 1 :]
    share, first = crowd.share[k : k + LANES], COUNT + 7
    for lane in range(_width(values)):
        values[first, lane] = np.float32(high[lane] - low[lane]) / PLACES_WIDE
        values[first + 1, lane] = ZERO
        values[first + 2, lane] = crowd.whole
        values[first + 3, lane] = share[lane]
    for ring in range(2 * RINGS):
        others = near[ring, k : k + LANES]
        for lane in range(len(others)):
            j = max(others[lane], STRETCH)
            some = crowd.before[j + STRETCH + 1] - crowd.before[j - STRETCH]
            values[first + 1, lane] += np.float32(some) / (PLACES_WIDE * np.float32(2 * RINGS))
