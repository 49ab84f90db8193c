# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the neighbours of several points say, side by side in lanes.

Where the neighbours are is (3, M, LANES): x, y or z from the point, neighbour, lane.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import inner_kernel
from lidar_outlier_filter.core.kernels.lanes import sort_signed
from lidar_outlier_filter.core.neighbours.places import LEAST

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats, Index, Ints, Singles

NARROW = 1e-6  # ratio of variances across and along, below which neighbours lie on a line
EVEN = 0.02  # of s: heights differ so much on any surface
OPPOSITE = -0.8  # cosine of the angle between neighbours, at most


@inner_kernel
def gather(
    xyz: Floats, radius: Floats, p: int, others: Index, lane: int, offset: Floats, radii: Floats
) -> None:
    """Write where the neighbours of p are, and their distances to their own eighth."""
    x, y, z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
    for m in range(len(others)):
        o = others[m]
        offset[0, m, lane] = xyz[o, 0] - x
        offset[1, m, lane] = xyz[o, 1] - y
        offset[2, m, lane] = xyz[o, 2] - z
        radii[m, lane] = radius[o]


@inner_kernel
def measure(offset: Floats, count: int, distance: Floats) -> None:
    """Write the distances (M, LANES) of the first ``count`` neighbours."""
    for m in range(count):
        for lane in range(distance.shape[1]):
            x, y, z = offset[0, m, lane], offset[1, m, lane], offset[2, m, lane]
            distance[m, lane] = np.sqrt((x * x + y * y) + z * z)


@inner_kernel
def copy_rows(rows: Floats, count: int, copied: Floats) -> None:
    """Copy so many rows; those behind them become inf."""
    for m in range(len(copied)):
        for lane in range(copied.shape[1]):
            copied[m, lane] = rows[m, lane] if m < count else np.inf


@inner_kernel
def add_moments(offset: Floats, count: int, moment: Floats, mean: Floats) -> None:
    """Write the mean of the first ``count`` neighbours, and their second moments around it."""
    mean[:], moment[:] = 0.0, 0.0
    for m in range(count):
        for lane in range(mean.shape[1]):
            mean[0, lane] += offset[0, m, lane]
            mean[1, lane] += offset[1, m, lane]
            mean[2, lane] += offset[2, m, lane]
    for lane in range(mean.shape[1]):
        mean[0, lane] = mean[0, lane] / count
        mean[1, lane] = mean[1, lane] / count
        mean[2, lane] = mean[2, lane] / count
    for m in range(count):
        for lane in range(mean.shape[1]):
            a = offset[0, m, lane] - mean[0, lane]
            b = offset[1, m, lane] - mean[1, lane]
            c = offset[2, m, lane] - mean[2, lane]
            moment[0, lane] += a * a
            moment[1, lane] += b * b
            moment[2, lane] += c * c
            moment[3, lane] += a * b
            moment[4, lane] += a * c
            moment[5, lane] += b * c
    for row in range(6):
        for lane in range(mean.shape[1]):
            moment[row, lane] = moment[row, lane] / count


@inner_kernel
def write_heights(
    z: Floats,
    count: int,
    pairs: Ints,
    scale: Floats,
    row: int,
    sunk: int,
    work: Floats,
    values: Singles,
) -> None:
    """Write how far points are below and above the first ``count`` neighbours, whose z these are.

    ``pairs`` sorts as many rows as ``work`` has.
    """
    copy_rows(z, count, work)
    sort_signed(work, pairs)
    quarter = count // 4
    for lane in range(len(scale)):
        low, high, s = work[0, lane], work[count - 1, lane], scale[lane]
        next_low, next_high = work[quarter, lane], work[count - 1 - quarter, lane]
        values[row, lane], values[row + 1, lane] = low / s, -high / s
        values[sunk, lane] = low / (next_low - low + EVEN * s)
        values[sunk + 1, lane] = -high / (high - next_high + EVEN * s)


@inner_kernel
def off_plane(mean: Floats, value: Floats, vector: Floats, lane: int) -> tuple[float, float]:
    """Return how far a point is from the plane, or line, and how far its neighbours are from it."""
    x, y, z = mean[0, lane], mean[1, lane], mean[2, lane]
    along = x * vector[0, lane] + y * vector[1, lane] + z * vector[2, lane]
    across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    thin, both = value[0, lane], value[0, lane] + value[1, lane]
    planar = value[1, lane] > NARROW * value[2, lane]
    return abs(along) if planar else across, np.sqrt(max(thin if planar else both, 0.0))


@inner_kernel
def aside(moment: Floats, mean: Floats, lane: int) -> float:
    """Return how far the mean of neighbours is from the point ÷ how far they are from that mean."""
    x, y, z = mean[0, lane], mean[1, lane], mean[2, lane]
    spread = np.sqrt(moment[0, lane] + moment[1, lane] + moment[2, lane])
    return float(np.sqrt(x * x + y * y + z * z) / (spread + LEAST))


@inner_kernel
def write_between(offset: Floats, count: int, work: Floats) -> None:
    """Write the lowest and highest z, from the point, between two opposite neighbours.

    They become the last but one and the last row of ``work``, inf and -inf without such neighbours.
    """
    opposite, low, high = OPPOSITE, len(work) - 2, len(work) - 1
    for lane in range(work.shape[1]):
        work[low, lane], work[high, lane] = np.inf, -np.inf
    for m in range(count):
        for lane in range(work.shape[1]):
            x, y = offset[0, m, lane], offset[1, m, lane]
            work[m, lane] = np.sqrt(x * x + y * y)
    for m in range(count):
        for n in range(m):
            for lane in range(work.shape[1]):
                across = (
                    offset[0, m, lane] * offset[0, n, lane]
                    + offset[1, m, lane] * offset[1, n, lane]
                )
                one, other = work[m, lane], work[n, lane]
                z = (offset[2, m, lane] * other + offset[2, n, lane] * one) / (one + other)
                found = across < opposite * (one * other)
                lower, higher = work[low, lane], work[high, lane]
                work[low, lane] = min(lower, z if found else lower)
                work[high, lane] = max(higher, z if found else higher)
