# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Early returns that stand alone, after the idea of Autoware's dual_return_outlier_filter.

A shot through rain, snow, dust or exhaust often has two returns: of a particle, and of the surface
behind it. At the edge of an object it has two, too, but then a shot beside it hits the object.
Autoware compares weak first returns with each other only, so that it loses most such edges. Points
do not carry the number of their return: returns in the same direction are of one shot.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.builtin import DualReturn
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.ring_neighbours import are_near, following, jumps
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.placed_pattern import SAME_SHOT
from lidar_outlier_filter.parameters.filter import FilterParameters

MAX_STEPS = 5  # between any returns of two shots beside each other, of up to three returns


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input, ring by ring."""
    own = parameters.of(DualReturn)
    return seen.along_lines(lambda points, lines: Scores(detect(points, lines.first, own)))


def detect(points: Points, first: Ints, parameters: DualReturn) -> Floats:
    """Score the returns that have another one behind them in the same shot.

    Parameters
    ----------
    points : N points, sorted by ring and time, all of them valid
    first : (L + 1,) where each ring begins; the last entry is N
    parameters : see :class:`~.builtin.DualReturn`

    Returns
    -------
    (N,) float64
        The smallest ratio of ranges to any return of the shots before and after it, within one
        degree of azimuth, ÷ ``distance_ratio``; inf if there is none. 0 for last returns.

    References
    ----------
    .. [1] dual_return_outlier_filter of autoware_pointcloud_preprocessor,
       https://github.com/autowarefoundation/autoware_universe

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import dual_return
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.core.detectors.builtin import DualReturn
    >>> azimuth, reach = np.radians([0.0, 0.4, 0.8, 1.2, 1.2, 1.6, 2.0, 2.4, 2.8]), np.full(9, 8.0)
    >>> reach[3] = 5.0  # a drop of rain, and what is behind it
    >>> xyz = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), 0 * reach])
    >>> points = Points(xyz, np.arange(9), np.zeros(9, np.int64), np.ones(9, np.bool_))
    >>> score = dual_return.detect(points, np.array([0, 9]), DualReturn())
    >>> np.flatnonzero(score > 1).tolist()
    [3]

    """
    xyz, reach = points.in_own_frame.xyz, points.range
    both, along = reach[1:] * reach[:-1], np.einsum('ij,ij->i', xyz[1:], xyz[:-1])
    across = both * both - along * along
    # Points in the direction of those before them are of one shot.
    begins = np.append(True, ~((along > 0) & (across <= (SAME_SHOT * both) ** 2)))
    begins[first[:-1]] = True
    starts, shot = np.flatnonzero(begins), np.cumsum(begins) - 1
    next_shot = following(np.searchsorted(starts, first))
    smallest = np.full(len(points), np.inf)
    after = other = following(first)
    for _ in range(MAX_STEPS):
        beside = (shot[other] == next_shot[shot]) & (shot[other] != shot) & are_near(xyz, other)
        ratio = np.where(beside, jumps(reach, other), np.inf)
        smallest = np.minimum(smallest, ratio)
        smallest[other] = np.minimum(smallest[other], ratio)
        other = after[other]
    is_last = reach >= np.maximum.reduceat(reach, starts)[shot]
    return np.where(is_last, 0.0, smallest / parameters.distance_ratio)
