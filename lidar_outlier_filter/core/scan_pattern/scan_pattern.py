# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a spinning sensor: a point's neighbours by ring and azimuth.

A point's neighbours are those before and after it in its ring, and those at its azimuth in the two
rings above and the two below. All rings are sorted by azimuth, so that one walk finds them.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints, Singles
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, median
from lidar_outlier_filter.core.points.columns import telling
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import is_interleaved, line_starts, order_by_line
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    SAME_SHOT,
    UNKNOWN,
    OrderedLines,
    Pattern,
    find_copies,
    join_shots,
    lines_at_once,
    make_pattern,
    place,
    sort_lines,
)

# Brightness is intensity ÷ the median of the same points at about the same range, because makers
# give intensities in units of their own, with or without the range taken out. Particles return less
# than surfaces: the rank of intensity × range² shows it in any unit.
# Metres. Two to an octave, which single precision holds exactly.
EDGES = np.array([s * 2.0**k for k in range(-1, 8) for s in (1.0, 1.5)], np.float32)
SAMPLED_EVERY = 4  # the part of the cells that shows what is usual
MIN_CELLS = 30  # of them between two edges; fewer show nothing
BRIGHTEST = np.float32(8.0)
RANKS = 64


def brightness(order: Ints, reach: Singles, intensity: Singles, threads: int = 0) -> Singles:
    """Return the brightness (2, M) of each cell, see :class:`~.placed_pattern.Pattern`.

    Parameters
    ----------
    order : (M,) which of the N points is at each cell; -1 for none
    reach : (M,) metres
    intensity : (N,) of the points; NaN and less than 0 are unknown
    threads : maximum number of threads; 0: all cores

    """
    bright = np.empty((2, len(order)), np.float32)
    usual, limits = _usual(order, reach, intensity), _find_ranks(order, reach, intensity)
    pool.run(
        lambda i, j: _compare(order, reach, intensity, usual, limits, i, j, bright),
        *(len(order), AT_ONCE, threads),
    )
    return bright


@kernel
def _usual(order: Ints, reach: Singles, intensity: Singles) -> Singles:
    """Return the median intensity from each edge to the next; 0 where too few cells show it."""
    usual = np.zeros(len(EDGES) + 1, np.float32)
    value = np.empty(len(order) // SAMPLED_EVERY + 1)
    between, some, shown = np.empty(len(value), np.int64), np.empty(len(value) + 1), 0
    for k in range(0, len(order), SAMPLED_EVERY):
        i = order[k]
        if i >= 0 and intensity[i] >= 0:
            value[shown], between[shown] = intensity[i], np.searchsorted(EDGES, reach[k])
            shown += 1
    for b in range(len(usual)):
        count = 0
        for m in range(shown):
            some[count] = value[m]
            count += between[m] == b
        if count >= MIN_CELLS:
            usual[b] = median(some, count)
    return usual


def _find_ranks(order: Ints, reach: Singles, intensity: Singles) -> Floats:
    """Return where the ranks of intensity × range² begin; nothing where too few cells show it."""
    some, far = order[::SAMPLED_EVERY], reach[::SAMPLED_EVERY].astype(np.float64)
    known = (some >= 0) & (intensity[some] >= 0)
    power: Floats = np.sort(intensity[some[known]] * far[known] ** 2)
    ranks = RANKS if len(power) >= MIN_CELLS else 1
    return power[np.arange(1, ranks) * len(power) // RANKS]


@device_function
def _rank(limits: Floats, power: float) -> int:
    """Count the limits below a power: a binary search without branches."""
    below, step = 0, RANKS // 2
    while step > 0:
        below += step * (limits[below + step - 1] < power)
        step //= 2
    return below


@kernel
def _compare(
    order: Ints,
    reach: Singles,
    intensity: Singles,
    usual: Singles,
    limits: Floats,
    begin: int,
    end: int,
    bright: Singles,
) -> None:
    """Divide intensities by what is usual, and rank them without the range."""
    b = 0
    for k in range(begin, end):
        i = order[k]
        # Ranges change little from one return to the next.
        while b < len(EDGES) and EDGES[b] < reach[k]:
            b += 1
        while b > 0 and not EDGES[b - 1] < reach[k]:
            b -= 1
        known = i >= 0 and intensity[i] >= 0
        shown = known and usual[b] > 0
        bright[0, k] = min(intensity[i] / usual[b], BRIGHTEST) if shown else UNKNOWN
        shown, power = known and len(limits) > 0, intensity[i] * np.float64(reach[k]) ** 2
        bright[1, k] = _rank(limits, power) / RANKS if shown else UNKNOWN


TURN = 2.0 * np.pi
BESIDE_EACH = 2  # rings beside each, below and above
LAG = 8  # returns of a ring, to measure how fast the head turns
SAMPLES = 64  # returns of a ring that show its elevation, its step and how fast the head turns
MIN_RING_RETURNS = 2 * LAG  # returns of a ring that show how fast the head turns
MIN_STEADY_SHARE = 0.9  # of the steps along rings go the way the head turns, or there is no pattern
MAX_BEHIND_RAD = 0.1  # in rows of a range image: the returns of a packet may come in any order
AT_ONCE = 1 << 14  # points that a thread takes
MIN_GAP_RAD = 1e-4  # rad between rings
MIN_COSINE = 1e-3  # of an elevation: a beam straight up has no azimuth
MAX_UNEVEN = 10.0  # times that the farther ring beside is as far as the nearer
NOISE_M = 0.02  # metres that are added to what beams are apart: no range is better
LEVEL_M = 0.06  # metres that ranges may differ by, and still be the same
# Parts of a rad that phases are rounded to, and a turn in them: so differences of phases are exact
# for half a million turns, and a turn is judged alike whenever it is.
PHASE_PARTS = 2.0**30
WHOLE_TURN = float(np.rint(TURN * PHASE_PARTS) / PHASE_PARTS)
# atan(x) ÷ x in x², up to 1, within 1e-9. No processor's own function: their results differ.
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


def find_pattern(
    points: Points,
    threads: int = 0,
    order: Ints | None = None,
    *,
    spins: bool = False,
    in_rows: bool = False,
) -> Pattern | None:
    """Sort points by ring and azimuth.

    Parameters
    ----------
    points : valid ones, in the sensor's own frame
    threads : maximum number of threads; 0: all cores
    order : that of :func:`.order_by_line`, where it is known; a pattern that is found changes it
    spins : the sensor is known to spin; else it must measure several lines at once
    in_rows : rings may be rows of a range image, in whose packets returns come in any order

    Returns
    -------
    Pattern or None
        None where the points have no such pattern: lines are measured one after the other, rings
        are too short, or their azimuths do not go steadily one way.

    """
    if len(points) < MIN_RING_RETURNS:
        return None
    order = order_by_line(points) if order is None else order
    t, first = points.t[order], line_starts(points.line[order])
    if not spins and not is_interleaved(t, first):
        return None
    lines = OrderedLines(points.xyz, points.range, order, first)
    turned = _turn(lines, t, in_rows, threads)
    if turned is None:
        return None
    lines, turned, copies = leave_out_copies(lines, turned, points.intensity)
    first = lines.first
    elevation, step = np.empty(len(first) - 1), np.empty(len(first) - 1)
    _typical(turned.up, turned.phase, first, elevation, step)
    rank = np.argsort(elevation, kind='stable')
    noise = np.full(len(rank), NOISE_M, np.float32)
    placed = make_pattern(
        np.diff(first)[rank],
        copies,
        **_space_out(elevation[rank], step[rank]),
        noise=noise,
        apart=noise,
        level=np.full(len(rank), LEVEL_M, np.float32),
    )
    pool.run(
        lambda i, j: place(lines, turned.phase, rank, i, j, placed),
        *(len(rank), lines_at_once(len(rank), len(points)), threads),
    )
    if (intensity := telling(points.intensity)) is not None:
        bright = brightness(placed.order, placed.range, intensity, threads)
        return placed._replace(bright=bright)
    return placed


class Turned(NamedTuple):
    """Of each point in the order of its ring: the angle turned, rad, and the sine of elevation."""

    phase: Floats
    up: Floats


def _turn(lines: OrderedLines, t: Ints, in_rows: bool, threads: int) -> Turned | None:
    """Sort each ring by the angle turned; None where the head does not turn steadily."""
    count, number = len(t), len(lines.first) - 1
    azimuth, up, phase = np.empty(count), np.empty(count), np.empty(count)
    pool.run(lambda i, j: _write_directions(lines, i, j, azimuth, up), count, AT_ONCE, threads)
    rate = turning_rate(azimuth, t, lines.first)
    if not abs(rate) > 0.0:
        return None
    steady, at_once = np.zeros(number, np.int64), lines_at_once(number, count)
    pool.run(
        lambda i, j: _unwrap(azimuth, t, lines.first, rate, i, j, phase, steady),
        number,
        at_once,
        threads,
    )
    if not (advances(phase, lines.first) if in_rows else steady.sum() >= MIN_STEADY_SHARE * count):
        return None
    begins = lines.first[:-1]
    turned = np.maximum.reduceat(phase, begins) - np.minimum.reduceat(phase, begins)
    if turned.sum() <= SAME_SHOT * count:  # seen from far away, nothing turns
        return None

    def sort(begin: int, end: int) -> None:
        sort_lines(lines, begin, end, phase, up)
        join_shots(lines, begin, end, phase, up)

    pool.run(sort, number, at_once, threads)
    return Turned(phase, up)


def advances(phase: Floats, first: Ints) -> bool:
    """Return whether few returns are far behind the farthest that their line has turned before."""
    apart = 2.0 * np.ptp(phase)
    lifted = phase + apart * np.repeat(np.arange(len(first) - 1), np.diff(first))
    behind = np.maximum.accumulate(lifted) - lifted
    return bool((behind <= MAX_BEHIND_RAD).mean() >= MIN_STEADY_SHARE)


def leave_out_copies(
    lines: OrderedLines, turned: Turned, intensity: Singles | None
) -> tuple[OrderedLines, Turned, Ints]:
    """Leave out returns at the very position of another one of their shot; list them, too.

    Sensors that publish two returns of each shot publish most of them twice.
    """
    known = np.empty(0, np.float32) if intensity is None else intensity
    original = np.empty(len(lines.order), np.int64)
    if find_copies(lines, turned.phase, known, original) == 0:
        return lines, turned, np.empty((0, 2), np.int64)
    kept = original == lines.order
    copies = np.stack([lines.order, original], axis=1)[~kept]
    first = np.concatenate([[0], np.cumsum(kept)])[lines.first]
    left = lines._replace(order=lines.order[kept], first=first)
    return left, Turned(turned.phase[kept], turned.up[kept]), copies


def _space_out(sine: Floats, step: Floats) -> dict[str, Singles]:
    """Return the angles between rings and shots, of sines of elevations in ascending order."""
    cosine = np.sqrt(np.maximum(1.0 - sine**2, MIN_COSINE**2))
    # Straight up and down, where the cosine is 0, all rings are one.
    middle = np.sqrt(np.maximum(1.0 - ((sine[1:] + sine[:-1]) / 2.0) ** 2, np.finfo(float).tiny))
    between = np.maximum(np.diff(sine) / middle, MIN_GAP_RAD)
    below, above = np.append(np.nan, between), np.append(between, np.nan)
    beside = np.ones((2 * BESIDE_EACH, len(sine)))
    beside[1, 1:], beside[2, :-1] = between, between
    beside[0], beside[3] = 2.0 * beside[1], 2.0 * beside[2]
    second = between[1:] + between[:-1]
    beside[0, 2:], beside[3, :-2] = second, second
    if len(sine) == 1:
        gap, far = np.ones(1), np.full(1, np.nan)
    else:
        gap, far = np.fmin(below, above), np.maximum(below, above)
    uneven = np.where(np.isnan(far), MAX_UNEVEN, np.minimum(far / gap, MAX_UNEVEN))
    values = {'step': step * cosine, 'gap': gap, 'turn': 1.0 / cosine}
    values.update(beside=beside, uneven=uneven)
    return {name: value.astype(np.float32) for name, value in values.items()}


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
def _write_directions(
    lines: OrderedLines, begin: int, end: int, azimuth: Floats, up: Floats
) -> None:
    xyz, distance, order, _ = lines
    for k in range(begin, end):
        i = order[k]
        azimuth[k] = arctangent(xyz[i, 1], xyz[i, 0])
        up[k] = xyz[i, 2] / distance[i] if distance[i] > 0 else np.nan


@kernel
def turning_rate(azimuth: Floats, t: Ints, first: Ints) -> float:
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


@device_function
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
            mine = np.rint(sign * azimuth[k] * PHASE_PARTS) / PHASE_PARTS
            phase[k] = mine + WHOLE_TURN * np.rint((expected - mine) / TURN)
            # Two returns of a shot differ by what their coordinates are rounded by.
            steady[line] += k == first[line] or phase[k] >= phase[k - 1] - SAME_SHOT
            expected, last = phase[k], t[k]


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
