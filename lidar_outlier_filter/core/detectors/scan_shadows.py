# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Mixed pixels by their shadow angle along each scan line: laser_filters' ScanShadowsFilter in 3-D.

The shadow angle at a point is that between its beam and the straight line to a point beside it.
Where it is small, that line runs along the beam: a surface ends there, and what is measured behind
its edge may float between two surfaces.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.builtin import ScanShadows
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import Lines
from lidar_outlier_filter.core.scan_pattern.placed_pattern import SAME_SHOT
from lidar_outlier_filter.parameters.filter import FilterParameters


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input, line by line."""
    own = parameters.of(ScanShadows)
    return seen.along_lines(lambda points, lines: Scores(detect(points, lines, own)))


def detect(points: Points, lines: Lines, parameters: ScanShadows) -> Floats:
    """Score the points behind those whose shadow angle is small.

    Returns of one shot are not compared with each other.

    Parameters
    ----------
    points : N points, sorted by line and time, all of them valid
    lines : their lines and segments
    parameters : see :class:`~.builtin.ScanShadows`

    Returns
    -------
    (N,) float64
        ``min_angle`` ÷ the smallest shadow angle at any nearer point within ``neighbors``; 0 if
        there is none. NaN for a point that is alone in its segment.

    References
    ----------
    .. [1] ScanShadowsFilter, https://github.com/ros-perception/laser_filters: its ``max_angle`` is
       180° - ``min_angle`` here.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import scan_shadows
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.core.points.scan_lines import find_lines
    >>> from lidar_outlier_filter.core.detectors.builtin import ScanShadows
    >>> azimuth, reach = np.radians(np.arange(7.0)), np.array([4.0, 4, 4, 6, 9, 9, 9])
    >>> xyz = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), 0 * reach])
    >>> points = Points(xyz, np.arange(7), np.zeros(7, np.int64), np.ones(7, np.bool_))
    >>> score = scan_shadows.detect(points, find_lines(points, gap_factor=1.5), ScanShadows())
    >>> np.flatnonzero(score > 1).tolist()
    [3, 4]

    """
    segment: Ints = np.cumsum(lines.before < 0)
    sharp = parameters.min_angle / _smallest_angles(points, segment, parameters.window)
    # As in laser_filters: coordinates are rounded, and so are the ranges that are compared.
    reach, result = points.range.astype(np.float32), np.zeros(len(points))
    for step in range(1, parameters.neighbors + 1):
        one, other = slice(None, -step), slice(step, None)
        together = segment[one] == segment[other]
        for near, far in ((one, other), (other, one)):
            behind = together & (reach[near] < reach[far])
            np.maximum(result[far], sharp[near], out=result[far], where=behind)
    result[(lines.before < 0) & (lines.after < 0)] = np.nan
    return result


def _smallest_angles(points: Points, segment: Ints, window: int) -> Floats:
    """Return the smallest shadow angle at each point within its window, degrees; inf for none."""
    xyz, reach = points.in_own_frame.xyz, points.range
    squared = reach * reach
    tangent = np.full(len(points), np.inf)
    for step in range(1, window + 1):
        one, other = slice(None, -step), slice(step, None)
        together = segment[one] == segment[other]
        product = np.einsum('ij,ij->i', xyz[one], xyz[other])
        # Both triangles have the same height, seen from the sensor: |one × other|.
        height = np.sqrt(np.maximum(squared[one] * squared[other] - product * product, 0.0))
        beside = together & (height > SAME_SHOT * reach[one] * reach[other])
        for here in (one, other):
            with np.errstate(divide='ignore', invalid='ignore'):
                found = height / np.abs(squared[here] - product)
            np.minimum(tangent[here], found, out=tangent[here], where=beside)
    angles: Floats = np.degrees(np.arctan(tangent))
    return angles
