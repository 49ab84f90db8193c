# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Short walks along each ring: Autoware's ring_outlier_filter as it is meant.

A walk is a stretch of a ring without a jump in range. Few points in a short walk are outliers. In
Autoware's code the last point of a ring is in neither cloud, its end is not joined with its start,
and a gap of one degree was 3283 degrees: here rings are closed, and every point is judged.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.builtin import RingOutlier
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.ring_neighbours import are_near, following, jumps
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.filter import FilterParameters


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input, ring by ring."""
    own = parameters.of(RingOutlier)
    return seen.along_lines(lambda points, lines: Scores(detect(points, lines.first, own)))


def detect(points: Points, first: Ints, parameters: RingOutlier) -> Floats:
    """Score all points of a walk alike.

    Parameters
    ----------
    points : N points, sorted by ring and time, all of them valid
    first : (L + 1,) where each ring begins; the last entry is N
    parameters : see :class:`~.builtin.RingOutlier`

    Returns
    -------
    (N,) float64
        ``object_length_threshold`` ÷ the distance between the ends of the walk, inf for a single
        point; 0 in walks of more than ``num_points_threshold`` points.

    References
    ----------
    .. [1] ring_outlier_filter of autoware_pointcloud_preprocessor,
       https://github.com/autowarefoundation/autoware_universe

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import ring_outlier
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.core.detectors.builtin import RingOutlier
    >>> azimuth, reach = np.radians(0.4 * np.arange(9)), np.full(9, 8.0)
    >>> reach[3] = 5.0  # a drop of rain
    >>> xyz = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), 0 * reach])
    >>> points = Points(xyz, np.arange(9), np.zeros(9, np.int64), np.ones(9, np.bool_))
    >>> score = ring_outlier.detect(points, np.array([0, 9]), RingOutlier())
    >>> np.flatnonzero(score > 1).tolist()
    [3]

    """
    xyz = points.in_own_frame.xyz
    heads, tails = first[:-1], first[1:] - 1
    after = following(first)
    joined = are_near(xyz, after) & (jumps(points.range, after) < parameters.distance_ratio)
    ends = ~joined
    ends[tails] = True
    walk: Ints = np.cumsum(ends) - ends
    end = np.flatnonzero(ends)
    begin = np.append(0, end[:-1] + 1)
    size = end - begin + 1
    # The last walk of a ring goes on in its first one.
    closed = joined[tails] & (walk[heads] != walk[tails])
    one, last = walk[heads[closed]], walk[tails[closed]]
    begin[one], end[last] = begin[last], end[one]
    size[one] = size[last] = size[one] + size[last]
    length = np.linalg.norm(xyz[begin] - xyz[end], axis=1)
    with np.errstate(divide='ignore'):
        found = parameters.object_length_threshold / length
    found[size > parameters.num_points_threshold] = 0.0
    scores: Floats = found[walk]
    return scores
