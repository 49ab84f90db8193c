# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Features of a point among its eight nearest neighbours, without scan lines.

All lengths are divided by the local scale s, the median distance of those neighbours to their own
eighth: so features have no unit, and follow the density. z is expected to point up.

``near1``, ``near3``, ``near8``
    Distance to the nearest neighbour, mean of the three nearest, distance to the eighth, ÷ s.
``denser``
    Distance to the eighth ÷ the least of the neighbours' distances to theirs.
``sparser``
    The greatest of the neighbours' distances to their eighth ÷ s.
``jump``, ``jump_at``
    Greatest ratio of the distances to a neighbour and to the one before; neighbours before it.
``listed``
    How many of the neighbours are at least as far from their own eighth as from the point.
``steps2``
    How many other points two steps reach, each to one of the eight nearest.
``off``, ``flat``, ``off_flat``
    Distance from the plane through the neighbours, and their standard deviation from it, ÷ s; the
    first ÷ the second and a hundredth of s.
``thin``
    Standard deviations of the neighbours across and along the plane's longest direction: a ratio.
``aside``
    Distance of the neighbours' mean from the point, ÷ their root mean square distance from it.
``level``
    Size of the vertical part of the plane's normal.
``below``, ``above``
    How far the point is below its lowest, and above its highest neighbour, ÷ s.
``sunk``, ``raised``
    The same, ÷ how far the third lowest is above the lowest, or the third highest below the
    highest, and a fiftieth of s.
``rare``
    Distance to the eighth neighbour ÷ the typical one in the whole cloud.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.evidence.eigen import eigenvalues, eigenvectors
from lidar_outlier_filter.core.kernels import inner_kernel, median, select
from lidar_outlier_filter.core.lanes import LANES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Singles = NDArray[np.float32]
    Ints = NDArray[np.int64]
    Index = NDArray[np.int32]

K = 8  # neighbours
FEW = 3  # of them
LEAST = 1e-6  # metres that are added to scales, which may be 0
NARROW = 1e-6  # ratio of variances across and along, below which neighbours lie on a line
EVEN = 0.02  # of s: heights differ so much on any surface
SMOOTH = 0.01  # of s: less is not expected of any surface
TABLE = 128  # places for the points that two steps reach, K + K * K at most; a power of 2
FAR = 1e6  # features are at most so large

NEAR = (
    *('near1', 'near3', 'near8', 'denser', 'sparser', 'jump', 'jump_at', 'listed', 'steps2'),
    *('off', 'flat', 'off_flat', 'thin', 'aside', 'level', 'below', 'above'),
    *('sunk', 'raised', 'rare'),
)
COUNT = len(NEAR)


class Near(NamedTuple):
    """N points in tree order, and their neighbours.

    Attributes
    ----------
    xyz : (N, 3) float64, metres
    index : (N, K) int32
        The nearest first.
    radius : (N,) float64
        Distance to the eighth, metres.
    typical : float
        The typical radius of the whole cloud.

    """

    xyz: Floats
    index: Index  # type: ignore[assignment]  # nobody misses that of tuples
    radius: Floats
    typical: float


class NearRoom(NamedTuple):
    """Room to work in, for one thread; ``scale`` holds s of each lane."""

    scale: Floats
    distance: Floats
    radii: Floats
    moment: Floats
    mean: Floats
    value: Floats
    vector: Floats
    table: Ints


@inner_kernel
def make_room() -> NearRoom:
    """Make room for points that are measured side by side."""
    return NearRoom(
        np.empty(LANES),
        np.empty(K),
        np.empty(K),
        np.empty((6, LANES)),
        np.empty((3, LANES)),
        np.empty((3, LANES)),
        np.empty((4, LANES)),
        np.empty(TABLE, np.int64),
    )


@inner_kernel
def write_near(near: Near, points: Ints, room: NearRoom, values: Singles) -> None:
    """Write the features (COUNT, LANES) of points, so many as there are lanes."""
    for lane in range(LANES):
        p = points[lane]
        s = room.scale[lane] = _write_distances(near, p, lane, room, values)
        values[8, lane] = count_steps(near.index, p, room.table)
        add_moments(near.xyz, near.index[p], K, p, lane, room.moment, room.mean)
        for m in range(K):
            room.radii[m] = near.xyz[near.index[p, m], 2] - near.xyz[p, 2]
        write_heights(room.radii, K, s, 15, 17, lane, values)
        values[19, lane] = near.radius[p] / near.typical
    eigenvalues(room.moment, room.value)
    eigenvectors(room.moment, room.value, NARROW, room.vector)
    for lane in range(LANES):
        s = room.scale[lane]
        off, flat = off_plane(room.mean, room.value, room.vector, lane)
        values[9, lane], values[10, lane] = off / s, flat / s
        values[11, lane] = off / (flat + SMOOTH * s)
        along = np.sqrt(max(room.value[2, lane], 0.0))
        values[12, lane] = np.sqrt(max(room.value[1, lane], 0.0)) / (along + LEAST)
        values[13, lane] = aside(room.moment, room.mean, lane)
        values[14, lane] = abs(room.vector[2, lane])
    for feature in range(COUNT):
        for lane in range(LANES):
            values[feature, lane] = min(max(values[feature, lane], -FAR), FAR)


@inner_kernel
def _write_distances(near: Near, p: int, lane: int, room: NearRoom, values: Singles) -> float:
    """Write the features of distances, and return s."""
    xyz, radius = near.xyz, near.radius
    distance, radii = room.distance, room.radii
    least, most, listed, few = np.inf, 0.0, 0, 0.0
    jump, jump_at = 1.0, 0
    for m in range(K):
        o = near.index[p, m]
        d = length(xyz, p, o)
        distance[m], radii[m] = d, radius[o]
        least, most = min(least, radius[o]), max(most, radius[o])
        listed += d <= radius[o]
        few += d if m < FEW else 0.0
        ratio = d / (distance[m - 1] + LEAST) if m > 0 else 1.0
        if ratio > jump:
            jump, jump_at = ratio, m
    s = median(radii, K) + LEAST
    values[0, lane], values[1, lane] = distance[0] / s, few / (FEW * s)
    values[2, lane], values[3, lane] = distance[K - 1] / s, distance[K - 1] / (least + LEAST)
    values[4, lane], values[5, lane] = most / s, jump
    values[6, lane], values[7, lane] = jump_at, listed
    return s


@inner_kernel
def count_steps(index: Index, p: int, table: Ints) -> int:
    """Count the other points that two steps from p lead to."""
    table[:] = -1
    count = 0
    for m in range(K):
        o = index[p, m]
        count += _put(table, o)
        for n in range(K):
            other = index[o, n]
            if other != p:
                count += _put(table, other)
    return count


@inner_kernel
def _put(table: Ints, number: int) -> int:
    """Put a number into a table, unless it is there; return how many were put."""
    place = number & (len(table) - 1)
    while table[place] != -1 and table[place] != number:
        place = (place + 1) & (len(table) - 1)
    new = table[place] == -1
    table[place] = number
    return int(new)


@inner_kernel
def length(xyz: Floats, p: int, o: int) -> float:
    """Return the distance of two points."""
    dx, dy, dz = xyz[p, 0] - xyz[o, 0], xyz[p, 1] - xyz[o, 1], xyz[p, 2] - xyz[o, 2]
    return float(np.sqrt((dx * dx + dy * dy) + dz * dz))


@inner_kernel
def add_moments(
    xyz: Floats, others: Index, count: int, p: int, lane: int, moment: Floats, mean: Floats
) -> None:
    """Write the mean of some points, from p, and their second moments around it."""
    x = y = z = xx = yy = zz = xy = xz = yz = 0.0
    for m in range(count):
        o = others[m]
        a, b, c = xyz[o, 0] - xyz[p, 0], xyz[o, 1] - xyz[p, 1], xyz[o, 2] - xyz[p, 2]
        x, y, z = x + a, y + b, z + c
    x, y, z = x / count, y / count, z / count
    for m in range(count):
        o = others[m]
        a, b, c = xyz[o, 0] - xyz[p, 0] - x, xyz[o, 1] - xyz[p, 1] - y, xyz[o, 2] - xyz[p, 2] - z
        xx, yy, zz = xx + a * a, yy + b * b, zz + c * c
        xy, xz, yz = xy + a * b, xz + a * c, yz + b * c
    mean[0, lane], mean[1, lane], mean[2, lane] = x, y, z
    moment[0, lane], moment[1, lane], moment[2, lane] = xx / count, yy / count, zz / count
    moment[3, lane], moment[4, lane], moment[5, lane] = xy / count, xz / count, yz / count


@inner_kernel
def write_heights(
    z: Floats, count: int, scale: float, row: int, sunk: int, lane: int, values: Singles
) -> None:
    """Write how far a point is below and above others, whose z from it are reordered."""
    quarter = count // 4
    next_low, next_high = select(z, count, quarter), select(z, count, count - 1 - quarter)
    low = high = z[0]
    for m in range(1, count):
        low, high = min(low, z[m]), max(high, z[m])
    values[row, lane], values[row + 1, lane] = low / scale, -high / scale
    values[sunk, lane] = low / (next_low - low + EVEN * scale)
    values[sunk + 1, lane] = -high / (high - next_high + EVEN * scale)


@inner_kernel
def off_plane(mean: Floats, value: Floats, vector: Floats, lane: int) -> tuple[float, float]:
    """Return how far a point is from the plane, or line, and how far its neighbours are from it."""
    x, y, z = mean[0, lane], mean[1, lane], mean[2, lane]
    along = x * vector[0, lane] + y * vector[1, lane] + z * vector[2, lane]
    if value[1, lane] > NARROW * value[2, lane]:
        return abs(along), np.sqrt(max(value[0, lane], 0.0))
    across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    return across, np.sqrt(max(value[0, lane] + value[1, lane], 0.0))


@inner_kernel
def aside(moment: Floats, mean: Floats, lane: int) -> float:
    """Return how far the mean of neighbours is from the point ÷ how far they are from that mean."""
    x, y, z = mean[0, lane], mean[1, lane], mean[2, lane]
    spread = np.sqrt(moment[0, lane] + moment[1, lane] + moment[2, lane])
    return float(np.sqrt(x * x + y * y + z * z) / (spread + LEAST))
