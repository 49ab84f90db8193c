# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The typical distance of positions to their eighth neighbour.

It is measured at a sample of them, chosen by coordinates alone: neither the order of the points nor
tiles matter. Coincident points, as in clouds that were rounded or merged, count as one: distances
of 0 would make every other distance seem large.
"""

from collections.abc import Callable

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.threads import Result
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

K = 8  # neighbours
MIN_SCALE_M = 1e-6  # metres that are added to scales, which may be 0
SAMPLE_POINTS = 20_000  # points, about
POINTS_AT_ONCE = 500_000  # points examined
EVERY = 1 << 32


def in_parts(
    work: Callable[[Floats], Result], xyz: Floats, where: Ints, threads: int
) -> list[Result]:
    """Do work on the selected points (M,) of N, in parts that fit into memory."""
    return pool.run(
        lambda i, j: work(np.take(xyz, where[i:j], axis=0)), len(where), POINTS_AT_ONCE, threads
    )


def typical_scale(xyz: Floats, where: Ints, threads: int = 0) -> float:
    """Return the typical distance to the eighth neighbour, metres.

    Parameters
    ----------
    xyz : (N, 3) float64, metres
    where : (M,) int64
        Indices of the points to use; they are finite.
    threads : maximum number of threads; 0: all cores

    """
    limit = EVERY if len(where) <= SAMPLE_POINTS else EVERY * SAMPLE_POINTS // len(where)
    some = in_parts(lambda part: part[_kernels.numbers(part) < limit], xyz, where, threads)
    few = np.concatenate([np.empty((0, 3)), *some])
    alone, _, _ = Neighbourhood(few, K, threads).distinct()
    if len(alone) <= K:
        return MIN_SCALE_M
    distance = np.median(np.sqrt(alone.squared_distances(K)))
    # On a surface, distances are as the square root of the area that each point has.
    return float(distance * np.sqrt(len(few) / len(where))) + MIN_SCALE_M
