# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a profile scanner, whose lines are revolutions of its mirror.

The lines stand for a spinning sensor's rings, and the angle of the mirror for the
azimuth. Points may be in any frame: the scanner's position, and the angle of its mirror, are
estimated from them.

"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import is_interleaved, line_starts, order_by_line
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    OrderedLines,
    Pattern,
    lines_at_once,
    make_pattern,
    place,
    sort_lines,
)
from lidar_outlier_filter.core.scan_pattern.profile_scanner import (
    MAD_TO_SIGMA,
    MIN_RANGE_M,
    MIN_RETURNS,
    SAMPLES,
    TimedLines,
    find_scanner,
    median_of,
)
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

MIN_LINES = 2
# Of a step, in which angles are measured: no return is exactly as far as windows reach.
STEP_MARGIN = 1.01
SIGMA_FLOOR = 0.002  # metres
NOISE, LEVEL = 2.0, 4.0  # standard deviations of ranges


def find_profile_pattern(
    points: Points, threads: int = 0, order: Ints | None = None
) -> Pattern | None:
    """Sort points by line and mirror angle.

    Parameters
    ----------
    points : valid ones, in any frame
    threads : maximum number of threads; 0: all cores
    order : that of :func:`.order_by_line`, where it is known

    Returns
    -------
    Pattern or None
        None where the points have no such pattern: there are too few lines, several are measured
        at once, or the points do not lie where a mirror that turns or swings sees them.

    """
    order = order_by_line(points) if order is None else order
    first = line_starts(points.line[order])
    t = points.t[order]
    lines = len(first) - 1
    if lines < MIN_LINES or is_interleaved(t, first):
        return None
    # Lines in order of time, whatever their numbers.
    rank = np.argsort(t[first[:-1]], kind='stable')
    scanner = find_scanner(TimedLines(points.xyz, t, order, first, rank), threads)
    if scanner is None:
        return None
    phase = scanner.turned
    distance = _ranges(points.xyz, scanner.position, scanner.moved, order, first)
    ordered, nothing = OrderedLines(points.xyz, distance, order, first), np.zeros_like(phase)
    at_once = lines_at_once(lines, len(points))
    pool.run(lambda i, j: sort_lines(ordered, i, j, phase, nothing), *(lines, at_once, threads))
    steps = phase[1:] - phase[:-1]
    steps = steps[steps > 0.0]
    step = np.full(lines, STEP_MARGIN * median_of(steps) if len(steps) else TURN, np.float32)
    noise = np.full(lines, NOISE * _sigma(distance, order, phase, first), np.float32)
    found = make_pattern(
        np.diff(first)[rank],
        # Lines are taken to be as far apart as shots.
        step=step,
        gap=step,
        turn=np.ones_like(step),
        beside=np.stack([2 * step, step, step, 2 * step]),
        uneven=np.ones_like(step),
        noise=noise,
        apart=noise + _moved(scanner.position[rank]).astype(np.float32),
        level=noise * np.float32(LEVEL / NOISE),
    )
    pool.run(lambda i, j: place(ordered, phase, rank, i, j, found), lines, at_once, threads)
    return found


@kernel
def _ranges(xyz: Floats, position: Floats, moved: Floats, order: Ints, first: Ints) -> Floats:
    """Return the distance (N,) of each point, as given, from where the scanner was, metres."""
    distance = np.empty(len(order))
    for line in range(len(position)):
        for k in range(first[line], first[line + 1]):
            i, square = order[k], 0.0
            for axis in range(3):
                square += (xyz[i, axis] - position[line, axis] - moved[k, axis]) ** 2
            distance[i] = max(np.sqrt(square), MIN_RANGE_M)
    return distance


def _moved(where: Floats) -> Floats:
    """Return how far the scanner moved to the nearer of the lines before and after, metres."""
    away = np.sqrt(((where[1:] - where[:-1]) ** 2).sum(axis=1))
    nearer: Floats = np.minimum(np.append(away, np.inf), np.append(np.inf, away))
    return nearer


def _sigma(distance: Floats, order: Ints, phase: Floats, first: Ints) -> float:
    """Return the standard deviation of ranges, metres, typical of all lines.

    By the differences from what the neighbours in the line predict, of some returns.
    """
    sizes = np.diff(first)
    inner = first[:-1, None] + 1 + np.arange(SAMPLES) * (sizes[:, None] - 2) // SAMPLES
    some = inner[sizes >= MIN_RETURNS].ravel()
    span = phase[some + 1] - phase[some - 1]
    part = (phase[some] - phase[some - 1]) / np.where(span > 0.0, span, 1.0)
    reach = distance[order[some]]
    before, after = distance[order[some - 1]], distance[order[some + 1]]
    value = (1.0 - part) / before + part / after
    # Of a plane, the inverse range is a sine: between two others it is more than a line.
    curved = part * (1.0 - part) * span**2 / 2.0
    size = np.sqrt(1.0 + (1.0 - part) ** 2 + part**2)
    off = np.abs(reach * (1.0 - reach * value - curved)) / size
    return max(MAD_TO_SIGMA * median_of(off), SIGMA_FLOOR)
