# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a spinning sensor: a point's neighbours by the way the head turns.

A point's neighbours are those before and after it in its ring, and those at its azimuth in the two
rings above and the two below. All rings are sorted by azimuth, so that one walk finds them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core import threads as pool
from lidar_outlier_filter.core.kernels import inlined_kernel, inner_kernel, kernel, median
from lidar_outlier_filter.core.lanes import LANES
from lidar_outlier_filter.core.neighbours.brightness import UNKNOWN, write_brightness
from lidar_outlier_filter.core.scan_lines import is_interleaved, line_starts, order_by_line

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points import Points

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Singles = NDArray[np.float32]

TURN = 2.0 * np.pi
BESIDE = 4  # rings beside each: two below and two above
LAG = 8  # returns of a ring, to measure how fast the head turns
SAMPLES = 64  # returns of a ring that show its elevation, its step and how fast the head turns
FEWEST = 2 * LAG  # returns of a ring that show how fast the head turns
# Spacings of rings ÷ their median: these are even, and so are those of two halves as 2 to 3. A ring
# without returns makes one that is not. Of a VLP-32C 55 % are even, of a Pandar64 76 %, of scanners
# with evenly spaced rings 93 % and more.
EVEN_FROM, EVEN_TO, EVEN = 0.5, 1.75, 0.8
STEADY = 0.9  # share of the steps along rings that go the way the head turns: less is no pattern
LINES_AT_ONCE, AT_ONCE = 4, 1 << 14  # lines, and points, that a thread takes
STRETCH = 24  # places on either side of a point: nothing looks farther along a line
PAD = LANES + STRETCH  # places: as many as are looked at side by side, and what these look at
LEAST_GAP = 1e-4  # rad between rings
MOST_MOVES = 16  # for each return of a line, one by one; beyond, the line is merged
NOISE_M = 0.02  # metres that are added to what beams are apart: no range is better
LEVEL_M = 0.06  # metres that ranges may differ by, and still be the same
NOWHERE = 1e9  # rad: the phase where there is no point
# rad. Phases are compared in single precision, less the nearest multiple of it: so they are as
# exact after a day of turns as in the first ones, from which nothing is taken.
MANY_TURNS = 40 * TURN
# atan(x) ÷ x in x², up to 1, within 1e-9. No processor's own function: their answers differ.
ATAN = np.array(
    [
        0.9999999995535,
        -0.3333332248889,
        0.1999955809988,
        -0.1427857601947,
        0.1105077124416,
        -0.08785043170557,
        0.06685281272741,
        -0.04392840736215,
        0.02191294303868,
        -0.007030668149872,
        0.001057607174682,
    ]
)


class Pattern(NamedTuple):
    """N points sorted by ring, from below, and azimuth, in M places.

    Around the rings are ``PAD`` places without a point: whatever looks a few places on finds a
    phase there that is far away.

    Attributes
    ----------
    order : (M,) int64
        The index, as given, of each; -1 for none.
    first, last : (L,) int64
        Where each ring begins, and the place behind its end.
    x, y, z, range : (M,) float32
        Metres, about a point near them.
    phase : (M,) float64
        Rad turned, never falling along a ring; :func:`origin_of` says how to compare them.
    bright : (M,) float32
        Intensity ÷ what is usual at the range; -1 where it is not known.
    step, gap : (L,) float32
        Angle between shots of the ring, and to the nearer ring beside it, rad.
    noise, apart : (L,) float32
        Metres that are added to range × step, and to range × gap: no range is better, and the
        sensor may have moved from one line to the next.
    level : (L,) float32
        Metres that ranges may differ by, and still be the same.

    """

    order: Ints
    first: Ints
    last: Ints
    x: Singles
    y: Singles
    z: Singles
    range: Singles
    phase: Floats
    bright: Singles
    step: Singles
    gap: Singles
    noise: Singles
    apart: Singles
    level: Singles


def find_pattern(
    points: Points, threads: int = 0, *, spins: bool = False, crowded: bool = False
) -> Pattern | None:
    """Sort points by ring and azimuth.

    Parameters
    ----------
    points : valid ones, in the sensor's own frame
    threads : at most so many at once; 0 for as many as there are cores
    spins : the sensor is known to spin; otherwise it does where lines are measured at once
    crowded : rings unevenly spaced in elevation are a pattern, too

    Returns
    -------
    Pattern or None
        None where the points have no such pattern: lines are measured one after the other, rings
        are too short, or their azimuths do not go steadily one way. None, too, where rings are
        unevenly spaced in elevation: what is measured across them says little there.

    """
    if len(points) < FEWEST:
        return None
    order = order_by_line(points)
    t, first = points.t[order], line_starts(points.line[order])
    if not spins and not is_interleaved(t, first):
        return None
    lines = OrderedLines(points.xyz, points.range, order, first)
    turned = _turn(lines, t, threads)
    if turned is None:
        return None
    elevation, step = np.empty(len(first) - 1), np.empty(len(first) - 1)
    _typical(turned.up, turned.phase, first, elevation, step)
    rank = np.argsort(elevation, kind='stable')
    between = _spacings(elevation[rank])
    if not (crowded or _is_even(between)):
        return None
    level = (step * np.sqrt(1.0 - elevation**2))[rank].astype(np.float32)
    noise = np.full(len(rank), NOISE_M, np.float32)
    same = np.full(len(rank), LEVEL_M, np.float32)
    placed = make_pattern(np.diff(first)[rank], level, _gaps(between), noise, noise, same)
    pool.run(
        lambda i, j: place(lines, turned.phase, rank, i, j, placed),
        len(rank),
        LINES_AT_ONCE,
        threads,
    )
    if points.intensity is not None:
        write_brightness(placed.order, placed.range, points.intensity, placed.bright)
    return placed


class OrderedLines(NamedTuple):
    """Points as given, and their order by line.

    Attributes
    ----------
    xyz, distance : (N, 3), (N,) float64
        As given, metres.
    order : (N,) int64
        The index, as given, of each point sorted by line.
    first : (L + 1,) int64
        Where each line begins in the order.

    """

    xyz: Floats
    distance: Floats
    order: Ints
    first: Ints


class _Turned(NamedTuple):
    """Of each point in the order of its ring: the angle turned, rad, and the sine of elevation."""

    phase: Floats
    up: Floats


def _turn(lines: OrderedLines, t: Ints, threads: int) -> _Turned | None:
    """Sort each ring by the angle turned; None where the head does not turn steadily."""
    count, number = len(t), len(lines.first) - 1
    azimuth, up, phase = np.empty(count), np.empty(count), np.empty(count)
    pool.run(lambda i, j: _look(lines, i, j, azimuth, up), count, AT_ONCE, threads)
    rate = _rate(azimuth, t, lines.first)
    if not abs(rate) > 0.0:
        return None
    steady = np.zeros(number, np.int64)
    pool.run(
        lambda i, j: _unwrap(azimuth, t, lines.first, rate, i, j, phase, steady),
        number,
        LINES_AT_ONCE,
        threads,
    )
    if steady.sum() < STEADY * count:
        return None
    pool.run(lambda i, j: sort_lines(lines, i, j, phase, up), number, LINES_AT_ONCE, threads)
    return _Turned(phase, up)


def make_pattern(sizes: Ints, *of_lines: Singles) -> Pattern:
    """Make a pattern of lines of so many points, whose places have no points yet.

    ``of_lines`` are the last attributes of a pattern: step, gap, noise, apart and level.
    """
    begins = PAD + np.concatenate([[0], np.cumsum(sizes + PAD)])[:-1]
    count = int(sizes.sum()) + (len(sizes) + 1) * PAD
    return Pattern(
        np.full(count, -1),
        begins,
        begins + sizes,
        np.zeros(count, np.float32),
        np.zeros(count, np.float32),
        np.zeros(count, np.float32),
        np.ones(count, np.float32),
        np.full(count, NOWHERE),
        np.full(count, UNKNOWN, np.float32),
        *of_lines,
    )


def _spacings(sine: Floats) -> Floats:
    """Return the angles between rings, of sines of elevations in ascending order, rad."""
    # Straight up and down, where the cosine is 0, all rings are one.
    cosine = np.sqrt(np.maximum(1.0 - ((sine[1:] + sine[:-1]) / 2.0) ** 2, np.finfo(float).tiny))
    spacings: Floats = np.diff(sine) / cosine
    return spacings


def _is_even(between: Floats) -> bool:
    """Return whether most angles between rings are near their median."""
    if len(between) == 0:
        return True
    middle = float(np.median(between))
    even = (between >= EVEN_FROM * middle) & (between <= EVEN_TO * middle)
    return bool(np.count_nonzero(even) >= EVEN * len(between))


def _gaps(between: Floats) -> Singles:
    """Return each ring's angle to the nearer one beside it, of the angles between rings."""
    if len(between) == 0:
        return np.full(1, 1.0, np.float32)
    nearer = np.minimum(np.append(between, np.inf), np.append(np.inf, between))
    gaps: Singles = np.maximum(nearer, LEAST_GAP).astype(np.float32)
    return gaps


@inlined_kernel
def origin_of(phase: float) -> float:
    """Return what to take off a phase, and off those near it, before they get single precision."""
    return float(MANY_TURNS * np.rint(phase / MANY_TURNS))


@kernel
def arctangent(y: float, x: float) -> float:
    """Return the angle of (x, y), -π to π, the same on every machine, within 1e-6."""
    a, b = abs(x), abs(y)
    high, low = max(a, b), min(a, b)
    share = low / high if high > 0 else 0.0
    square = share * share
    total = ATAN[-1]
    for m in range(len(ATAN) - 2, -1, -1):
        total = total * square + ATAN[m]
    angle = total * share
    if b > a:
        angle = np.pi / 2.0 - angle
    if x < 0:
        angle = np.pi - angle
    return float(-angle if y < 0 else angle)


@kernel
def _look(lines: OrderedLines, begin: int, end: int, azimuth: Floats, up: Floats) -> None:
    xyz, distance, order, _ = lines
    for k in range(begin, end):
        i = order[k]
        azimuth[k] = arctangent(xyz[i, 1], xyz[i, 0])
        up[k] = xyz[i, 2] / distance[i]


@kernel
def _rate(azimuth: Floats, t: Ints, first: Ints) -> float:
    """Return how fast the head turns, rad/ns: the median over some stretches of all rings."""
    most = (len(first) - 1) * SAMPLES
    rates = np.empty(most)
    count = 0
    for line in range(len(first) - 1):
        begin, end = first[line], first[line + 1]
        stride = max((end - begin) // SAMPLES, LAG)
        taken = 0
        for k in range(begin, end - LAG, stride):
            span = t[k + LAG] - t[k]
            if span <= 0 or taken == SAMPLES:
                continue
            turned = 0.0
            for m in range(k, k + LAG):
                turned += _wrap(azimuth[m + 1] - azimuth[m])
            rates[count] = turned / span
            count += 1
            taken += 1
    return median(rates, count) if count > 0 else 0.0


@inner_kernel
def _wrap(angle: float) -> float:
    return float(angle - TURN * np.rint(angle / TURN))


@kernel
def _unwrap(
    azimuth: Floats,
    t: Ints,
    first: Ints,
    rate: float,
    begin: int,
    end: int,
    phase: Floats,
    steady: Ints,
) -> None:
    """Write the angle turned, from the first return of all on; count the steps not back."""
    sign = 1.0 if rate > 0 else -1.0
    pace = abs(rate)
    start, base = t[first[0]], sign * azimuth[first[0]]
    for line in range(begin, end):
        last, expected = t[first[line]], 0.0
        expected = base + pace * (last - start)
        for k in range(first[line], first[line + 1]):
            expected += pace * (t[k] - last)
            mine = sign * azimuth[k]
            phase[k] = mine + TURN * np.rint((expected - mine) / TURN)
            steady[line] += k == first[line] or phase[k] >= phase[k - 1]
            expected, last = phase[k], t[k]


@kernel
def sort_lines(lines: OrderedLines, begin: int, end: int, phase: Floats, up: Floats) -> None:
    """Sort each line by phase; of one phase, by range and place, whatever the order given.

    Lines are nearly sorted, where the head turns steadily: then few returns move, and not far.
    """
    order, first = lines.order, lines.first
    for line in range(begin, end):
        low, high = first[line], first[line + 1]
        left = MOST_MOVES * (high - low)
        for k in range(low + 1, high):
            if phase[k] > phase[k - 1]:
                continue
            m = k
            while m > low and _is_before(lines, phase, m, m - 1):
                phase[m], phase[m - 1] = phase[m - 1], phase[m]
                order[m], order[m - 1] = order[m - 1], order[m]
                up[m], up[m - 1] = up[m - 1], up[m]
                m -= 1
            left -= k - m
            if left < 0:
                _merge(lines, low, high, phase, up)
                break


@inner_kernel
def _merge(lines: OrderedLines, low: int, high: int, phase: Floats, up: Floats) -> None:
    """Sort one line, whatever its order; what is equal stays in its order."""
    count, size = high - low, 1
    place, merged = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(count):
        place[k] = low + k
    while size < count:
        for begin in range(0, count, 2 * size):
            middle, end = min(begin + size, count), min(begin + 2 * size, count)
            i, j = begin, middle
            for k in range(begin, end):
                if j >= end or (i < middle and not _is_before(lines, phase, place[j], place[i])):
                    merged[k] = place[i]
                    i += 1
                else:
                    merged[k] = place[j]
                    j += 1
        place, merged = merged, place
        size *= 2
    turned, sine = np.empty(count), np.empty(count)
    for k in range(count):
        merged[k], turned[k], sine[k] = lines.order[place[k]], phase[place[k]], up[place[k]]
    for k in range(count):
        lines.order[low + k], phase[low + k], up[low + k] = merged[k], turned[k], sine[k]


@inner_kernel
def _is_before(lines: OrderedLines, phase: Floats, a: int, b: int) -> bool:
    if phase[a] != phase[b]:
        return bool(phase[a] < phase[b])
    xyz, distance, order, _ = lines
    i, j = order[a], order[b]
    if distance[i] != distance[j]:
        return bool(distance[i] < distance[j])
    for axis in range(3):
        if xyz[i, axis] != xyz[j, axis]:
            return bool(xyz[i, axis] < xyz[j, axis])
    return False


@kernel
def _typical(up: Floats, phase: Floats, first: Ints, elevation: Floats, step: Floats) -> None:
    """Write the median elevation (its sine) and the median step of each line."""
    some = np.empty(SAMPLES + 1)
    for line in range(len(first) - 1):
        begin, end = first[line], first[line + 1]
        stride = max((end - begin) // SAMPLES, 1)
        count = 0
        for k in range(begin, end, stride):
            # Nearer than what squares to more than 0, a return has no elevation.
            if count < SAMPLES and not np.isnan(up[k]):
                some[count] = up[k]
                count += 1
        elevation[line] = median(some, count) if count > 0 else 0.0
        count = 0
        for k in range(begin + 1, end, stride):
            if count < SAMPLES and phase[k] > phase[k - 1]:
                some[count] = phase[k] - phase[k - 1]
                count += 1
        step[line] = median(some, count) if count > 0 else 1.0


@kernel
def place(
    lines: OrderedLines, phase: Floats, rank: Ints, begin: int, end: int, placed: Pattern
) -> None:
    """Write the lines from the lowest on."""
    xyz, distance, order, first = lines
    # The sorted points do not depend on the order given, and neither does the first of them.
    origin, start = np.floor(xyz[order[0]]), phase[first[0]]
    x, y, z, reach = placed.x, placed.y, placed.z, placed.range
    turned, given = placed.phase, placed.order
    for line in range(begin, end):
        source, target = first[rank[line]], placed.first[line]
        for k in range(placed.last[line] - target):
            i = order[source + k]
            given[target + k] = i
            x[target + k] = xyz[i, 0] - origin[0]
            y[target + k] = xyz[i, 1] - origin[1]
            z[target + k] = xyz[i, 2] - origin[2]
            reach[target + k] = distance[i]
            turned[target + k] = phase[source + k] - start
