# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Times of a spinning sensor whose stamps jitter, so that its messages overlap in time.

The head turns steadily: its azimuth shows the time of each return within a turn, better than a
stamp. Nothing depends on which message a return came in.
"""

from dataclasses import replace

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import line_starts
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

MAX_BACK_SHARE = 0.005  # of returns that arrive after a later one of their ring
MAX_JUMP_RAD = 0.2  # by which a return may be off the azimuth that its time says
MAX_JUMP_SHARE = 0.01
BINS = 72  # of azimuths, to find what most returns have in common


def with_steady_times(points: Points, order: Ints) -> Points:
    """Give returns the times that their azimuths show, where messages overlap in time.

    Parameters
    ----------
    points : valid ones of a spinning sensor, in its own frame
    order : that of :func:`.order_by_line`

    Returns
    -------
    Points
        The same ones, unless times of one ring jump back and forth, and azimuths mend it.

    """
    line = points.line[order]
    same = line[1:] == line[:-1]
    if not ((np.diff(order) < 0) & same).mean() > MAX_BACK_SHARE:
        return points
    azimuth = np.arctan2(points.xyz[:, 1], points.xyz[:, 0])
    start = int(points.t[order[0]])
    rate = _kernels.turning_rate(azimuth[order], points.t[order], line_starts(line))
    if not abs(rate) > 0.0 or _jumps(azimuth, points.t, order, same, rate) <= MAX_JUMP_SHARE:
        return points
    behind = _wrapped(azimuth - rate * (points.t - start))
    count = np.bincount(((behind / TURN + 0.5) * BINS).astype(np.int64) % BINS, minlength=BINS)
    common = (int(np.argmax(count)) + 0.5) / BINS * TURN - TURN / 2.0
    t = points.t + np.rint(_wrapped(behind - common) / rate).astype(np.int64)
    by_time = np.lexsort((t, points.line))
    if _jumps(azimuth, t, by_time, same, rate) > MAX_JUMP_SHARE:
        return points
    return replace(points, t=t)


def _jumps(azimuth: Floats, t: Ints, order: Ints, same: Bools, rate: float) -> float:
    """Return the share of steps along rings that are off what the head turns in their time."""
    off = _wrapped(np.diff(azimuth[order]) - rate * np.diff(t[order]))
    return float((np.abs(off[same]) > MAX_JUMP_RAD).mean()) if same.any() else 0.0


def _wrapped(angle: Floats) -> Floats:
    wrapped: Floats = angle - TURN * np.rint(angle / TURN)
    return wrapped
