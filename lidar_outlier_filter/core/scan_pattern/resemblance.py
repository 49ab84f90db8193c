# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a scan pattern that was found is one: lines beside each other resemble each other.

Lines of an airborne strip may pass for rings of a head that turns, seen from any place: then the
points beside a point in the pattern are anywhere. In a scan pattern they are near, compared with
the nearest of all points of other lines; and the scanner is as near as trees have learned it.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

SAMPLE_POINTS = 256  # points that show it
MAX_TYPICAL_RANGE_M = 150.0  # m: median; of sensors on the ground it is 100 m at most
FAR_TIMES = 8.0  # times as far as the nearest point of all other lines: not beside it
# And times as far as the nearest of its own line: lines may lie on each other.
MIN_RATIO_TO_OWN = 4.0
# Share of the points that are beside nothing. Of recordings it was 0.14 and less, of small
# simulated roads 0.25, in whose own frame lines lie on each other; of strips, and of turns seen
# from elsewhere than the sensor, 0.52 and more, but for some that are too far.
MAX_APART_SHARE = 0.4
MAX_COMPARED = 1 << 12  # points to either side along an axis that are compared: no others are near
MIN_DISTANCE_M = 1e-3  # m: no coordinate is finer


def is_plausible(pattern: Pattern) -> bool:
    """Return whether the points of a pattern lie as its scanner would see them."""
    reach = pattern.range[pattern.order >= 0]
    if not len(reach):
        return True
    return bool(np.median(reach) <= MAX_TYPICAL_RANGE_M) and apart_share(pattern) <= MAX_APART_SHARE


def apart_share(pattern: Pattern) -> float:
    """Return the share of points that have no point of the lines beside them near by.

    The lines beside a point have a return before and one after it in phase. The nearer of these is
    compared with the nearest point of all other lines, and of its own, within half a turn.
    """
    cells = np.flatnonzero(pattern.order >= 0)
    xyz = np.stack([pattern.x, pattern.y, pattern.z], axis=1)[cells].astype(np.float64)
    phase, size = pattern.phase[cells], pattern.last - pattern.first
    line, first = np.repeat(np.arange(len(size)), size), np.append(0, np.cumsum(size))
    some = np.unique(np.arange(SAMPLE_POINTS) * len(cells) // SAMPLE_POINTS)
    beside = _nearest_beside(xyz, phase, line, first, some)
    axis = int(np.ptp(xyz, axis=0).argmax())
    by_axis = np.argsort(xyz[:, axis], kind='stable')
    at, away = xyz[by_axis, axis], np.minimum(beside, np.finfo(np.float64).max) / MIN_RATIO_TO_OWN
    middle = np.searchsorted(at, xyz[some, axis])
    begin = np.maximum(np.searchsorted(at, xyz[some, axis] - away), middle - MAX_COMPARED)
    end = np.searchsorted(at, xyz[some, axis] + away, side='right')
    end = np.minimum(end, middle + MAX_COMPARED)
    apart = 0
    for k, i in enumerate(some):
        near = by_axis[begin[k] : end[k]]
        near = near[(near != i) & (np.abs(phase[near] - phase[i]) < np.pi)]
        distance = np.sqrt(((xyz[near] - xyz[i]) ** 2).sum(axis=1)) + MIN_DISTANCE_M
        same = line[near] == line[i]
        if np.isinf(beside[k]) or (
            (FAR_TIMES * distance[~same] < beside[k]).any()
            and (MIN_RATIO_TO_OWN * distance[same] < beside[k]).any()
        ):
            apart += 1
    return apart / max(len(some), 1)


def _nearest_beside(xyz: Floats, phase: Floats, line: Ints, first: Ints, some: Ints) -> Floats:
    """Return how far the nearest is of those at the phase of some points in the lines beside.

    Infinite where there is none within half a turn.
    """
    nearest = np.full(len(some), np.inf)
    for k, i in enumerate(some):
        for other in (line[i] - 1, line[i] + 1):
            if not 0 <= other < len(first) - 1:
                continue
            begin, end = first[other], first[other + 1]
            at = begin + np.searchsorted(phase[begin:end], phase[i])
            for m in range(max(at - 1, begin), min(at + 1, end)):
                if abs(phase[m] - phase[i]) < np.pi:
                    nearest[k] = min(nearest[k], float(np.sqrt(((xyz[m] - xyz[i]) ** 2).sum())))
    return nearest
