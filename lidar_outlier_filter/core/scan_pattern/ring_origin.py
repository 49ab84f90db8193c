# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the beams of a spinning sensor leave it, seen in the points alone.

Lenses sit beside the axis, and frames begin below them. So near points of a ring are not at its
elevation. From the right position they are: then elevations lie closest together.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.scan_pattern.scan_pattern import arctangent

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats

FARTHEST = 6  # steps of the first search, each way
STEP = 0.02  # metres
FINEST = 0.0005
MOVES = 4  # with each step
SOME, MORE = 1 << 12, 1 << 14  # points of the first search, and of the others
ON = 4  # positions on in the order of elevations: copies lie at the same one
LEAST = 2e-5  # rad that is added to a distance: copies have none
BETTER = 0.02  # halvings of the distance, less than which the origin is as good


class Origin(NamedTuple):
    """Metres above the origin of the frame, and from its axis outwards."""

    up: float
    out: float


def find_origin(flat: Floats, z: Floats) -> Origin:
    """Find where beams leave from.

    Parameters
    ----------
    flat, z : (N,) float64
        Distance from the axis, and height, metres, in an order that the points alone give.

    """
    best, least = Origin(0.0, 0.0), math.inf
    few = slice(None, None, max(1, len(z) // SOME))
    for i in range(-FARTHEST, FARTHEST + 1):
        for j in range(-FARTHEST, FARTHEST + 1):
            tried = Origin(STEP * i, STEP * j)
            value = spread(flat[few], z[few], *tried)
            if value < least:
                best, least = tried, value
    many = slice(None, None, max(1, len(z) // MORE))
    flat, z = flat[many], z[many]
    least, step = spread(flat, z, *best), STEP / 2
    while step >= FINEST:
        for _ in range(MOVES):
            around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
            near = [Origin(best.up + step * i, best.out + step * j) for i, j in around]
            values = [spread(flat, z, *one) for one in near]
            if min(values) >= least:
                break
            least = min(values)
            best = near[values.index(least)]
        step /= 2
    return best if spread(flat, z, 0.0, 0.0) > least + BETTER else Origin(0.0, 0.0)


@kernel
def spread(flat: Floats, z: Floats, up: float, out: float) -> float:
    """Return how far apart elevations are, seen from a position: mean logarithm to the base 2."""
    count = len(z)
    elevation = np.empty(count)
    for i in range(count):
        elevation[i] = arctangent(z[i] - up, flat[i] - out)
    elevation.sort()
    total = 0.0
    for i in range(count - ON):
        # Straight lines between powers of two: no processor's own logarithm.
        part, power = math.frexp(elevation[i + ON] - elevation[i] + LEAST)
        total += power + 2.0 * (part - 1.0)
    return total / max(count - ON, 1)
