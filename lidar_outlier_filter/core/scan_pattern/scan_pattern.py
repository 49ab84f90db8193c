# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a spinning sensor: a point's neighbours by ring and azimuth.

A point's neighbours are those before and after it in its ring, and those at its azimuth in the two
rings above and the two below. All rings are sorted by azimuth, so that one walk finds them.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints, Singles
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.points.columns import telling
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import is_interleaved, line_starts, order_by_line
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    SAME_SHOT,
    OrderedLines,
    Pattern,
    lines_at_once,
    make_pattern,
    place,
    sort_lines,
)

# Brightness is intensity ÷ the median of the same points at about the same range, because makers
# give intensities in units of their own, with or without the range taken out. Particles return less
# than surfaces: the rank of intensity × range² shows it in any unit.
SAMPLED_EVERY = 4  # the part of the cells that shows what is usual
MIN_CELLS = 30  # of them at about one range; fewer show nothing
RANKS = 64  # a power of two


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
    some, far = order[::SAMPLED_EVERY].copy(), reach[::SAMPLED_EVERY].copy()
    usual = _kernels.usual_brightness(some, far, intensity, MIN_CELLS)
    limits = _find_ranks(some, far, intensity)
    pool.run(
        lambda i, j: _kernels.compare_brightness(
            order, reach, intensity, usual, limits, i, j, bright
        ),
        *(len(order), POINTS_AT_ONCE, threads),
    )
    return bright


def _find_ranks(order: Ints, reach: Singles, intensity: Singles) -> Floats:
    """Return where the ranks of intensity × range² begin; nothing where too few cells show it."""
    known = (order >= 0) & (intensity[order] >= 0)
    power: Floats = np.sort(intensity[order[known]] * reach[known].astype(np.float64) ** 2)
    ranks = RANKS if len(power) >= MIN_CELLS else 1
    return power[np.arange(1, ranks) * len(power) // RANKS]


TURN = 2.0 * np.pi
BESIDE_EACH = 2  # rings beside each, below and above
MIN_RING_RETURNS = 2 * _kernels.TURNING_LAG  # returns of a ring that show how fast the head turns
MIN_STEADY_SHARE = 0.9  # of the steps along rings go the way the head turns, or there is no pattern
MAX_BEHIND_RAD = 0.1  # in rows of a range image: the returns of a packet may come in any order
POINTS_AT_ONCE = 1 << 14  # points that a thread takes
MIN_GAP_RAD = 1e-4  # rad between rings
MIN_COSINE = 1e-3  # of an elevation: a beam straight up has no azimuth
MAX_UNEVEN = 10.0  # times that the farther ring beside is as far as the nearer
NOISE_M = 0.02  # metres that are added to what beams are apart: no range is better
LEVEL_M = 0.06  # metres that ranges may differ by, and still be the same


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
    lines = OrderedLines(np.ascontiguousarray(points.xyz), points.range, order, first)
    turned = _turn(lines, t, in_rows, threads)
    if turned is None:
        return None
    lines, turned, copies = leave_out_copies(lines, turned, points.intensity)
    first = lines.first
    elevation, step = np.empty(len(first) - 1), np.empty(len(first) - 1)
    _kernels.typical_of_lines(turned.up, turned.phase, first, elevation, step)
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
        bright = brightness(placed.order, placed.range, np.ascontiguousarray(intensity), threads)
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
    pool.run(
        lambda i, j: _kernels.write_directions(lines, i, j, azimuth, up),
        count,
        POINTS_AT_ONCE,
        threads,
    )
    rate = _kernels.turning_rate(azimuth, t, lines.first)
    if not abs(rate) > 0.0:
        return None
    steady, at_once = np.zeros(number, np.int64), lines_at_once(number, count)
    pool.run(
        lambda i, j: _kernels.unwrap_turns(azimuth, t, lines.first, rate, i, j, phase, steady),
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
        _kernels.join_shots(lines, begin, end, phase, up)

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
    known = np.empty(0, np.float32) if intensity is None else np.ascontiguousarray(intensity)
    original = np.empty(len(lines.order), np.int64)
    if _kernels.find_line_copies(lines, turned.phase, known, original) == 0:
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
