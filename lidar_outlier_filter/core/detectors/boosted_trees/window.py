# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The window of a spinning sensor's point, the returns around it in the scan pattern; its features.

These are the five returns before and after it in its ring, and seven around its azimuth in each of
the 2 rings above and 2 below. Returns that are too far in angle do not count.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Index, Singles
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern, lines_at_once

OTHER = 3  # returns on either side in other rings: no window begins before the first position
RINGS = 2  # rings above, and below


class Prepared(NamedTuple):
    """A pattern of M positions, and what its windows share.

    Attributes
    ----------
    pattern : of the points
    rough : (M,) float32
        How much each range differs from what its neighbours in the ring predict: |1 - range ×
        predicted inverse range| ÷ step; 0 at the ends. On a plane the inverse range varies evenly
        along a ring.
    near : (4, M) int32
        The place nearest in azimuth on the second ring below, the one below, the one above, and
        the second above; a place of no point where there is no such ring.
    of_block : (B, M) float32
        Of a profile scanner, features that all lines together give each place: of its free group,
        and its height. B is 0 for other sensors.

    """

    pattern: Pattern
    rough: Singles
    near: Index
    of_block: Singles


def prepare(pattern: Pattern, threads: int = 0) -> Prepared:
    """Compute what all windows share, in at most so many threads at once; 0 for all cores."""
    positions, lines = len(pattern.order), len(pattern.first)
    rough, near = np.zeros(positions, np.float32), np.full((2 * RINGS, positions), OTHER, np.int32)

    def work(begin: int, end: int) -> None:
        _kernels.write_roughness(pattern, begin, end, rough)
        _kernels.find_beside(pattern, begin, end, near)

    pool.run(work, lines, lines_at_once(lines, positions), threads)
    return Prepared(pattern, rough, near, np.empty((0, positions), np.float32))
