# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The floor of a whole cloud: it separates low points and low groups from lower ground.

Columns, two typical distances wide, stand on a grid; each has a lowest point. Wide columns are
of five by five. The floor of one is the lower quartile of the lowest points of its columns and of
those of the eight wide columns around. So low points in less than a quarter of the columns do
not lower it, but a terrace or a pit in more of them does. Copies, the
order of the points and tiles have no effect.

``deep``
    How far the point is below the floor, ÷ the side of a column; negative above it.
``deep_steep``
    The depth ÷ (the distance between the quartiles of the lowest points + the side).
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.typical import in_parts, typical_scale

SIDE = 2.0  # of a column, typical distances
WIDER = _kernels.FLOOR_WIDER  # columns to the side of a wide one
WINDOW_COLUMNS = 3 * WIDER
MAX_COLUMNS = _kernels.FLOOR_FARTHEST  # columns from the first: those beyond are one
ROW = 32  # bits of a column's number within its row
WITHIN = (1 << ROW) - 1
COLUMNS_AT_ONCE = 256

# Where rejected points are compared with what is kept: of a cell on the map.
EACH = 32.0  # kept points, about
MEANS_AT_ONCE = 1_000_000  # points in memory at once


class Floor(NamedTuple):
    """The floor of a whole cloud, and how far apart its points typically are.

    Attributes
    ----------
    typical : float
        Its :func:`.typical_scale`, metres.
    origin : (2,) float64
        The least x and y, metres.
    side : float
        Of a column, metres.
    wide : (C,) int64
        The wide columns that hold points, ascending: row << 32 | number within the row.
    floor : (C, 2) float64
        Lower quartile of the lowest points around, and how far it is below the upper, metres.

    """

    typical: float
    origin: Floats
    side: float
    wide: Ints
    floor: Floats


def measure_floor(xyz: Floats, where: Ints, threads: int = 0, side: float | None = None) -> Floor:
    """Find the floor of a whole cloud.

    Parameters
    ----------
    xyz : (N, 3) float64, metres; z points up
    where : (M,) int64
        Indices of the points to use; they are finite.
    threads : maximum number of threads; 0: all cores
    side : of a column, metres; None: by how far apart its points are

    """
    typical = typical_scale(xyz, where, threads) if side is None else side / SIDE
    side = SIDE * typical
    if len(where) == 0:
        return Floor(typical, np.zeros(2), side, np.empty(0, np.int64), np.empty((0, 2)))
    # NumPy takes the least of an axis faster than those of both at once.
    lows = in_parts(lambda some: (some[:, 0].min(), some[:, 1].min()), xyz, where, threads)
    origin = np.min(lows, axis=0)
    found = in_parts(
        lambda some: _lowest(*_kernels.column_runs(some, origin, side)), xyz, where, threads
    )
    column, low = _lowest(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
    wide: Ints = np.unique((column >> ROW) // WIDER << ROW | (column & WITHIN) // WIDER)
    floor = np.empty((len(wide), 2))
    pool.run(
        lambda i, j: _kernels.write_floor(wide, column, low, i, j, floor),
        *(len(wide), COLUMNS_AT_ONCE, threads),
    )
    return Floor(typical, origin, side, wide, floor)


def count_low(xyz: Floats, where: Ints, threads: int = 0) -> int:
    """Count low points: far below the floor, and not because of its slope.

    Parameters: see :func:`measure_floor`.
    """
    around = measure_floor(xyz, where, threads)
    return sum(in_parts(lambda some: _kernels.count_low(around, some), xyz, where, threads))


def _lowest(column: Ints, z: Floats) -> tuple[Ints, Floats]:
    """Return each column once, ascending, and its lowest z."""
    order = np.argsort(column, kind='stable')
    column = column[order]
    begins = np.flatnonzero(np.append(True, column[1:] != column[:-1]))
    return column[begins], np.minimum.reduceat(z[order], begins)


def is_high(xyz: Floats, kept: Bools, rejected: Bools) -> Bools:
    """Return which of the rejected points (R,) are above what is kept around them on the map.

    Kept points are averaged in square cells. Each rejected one is compared with the nearest cell.
    """
    where, there = np.flatnonzero(rejected), np.flatnonzero(kept)
    if not len(there) or not len(where):
        return np.zeros(len(where), np.bool_)
    from scipy.spatial import cKDTree  # noqa: PLC0415  it takes a third of a second to import

    means = _means(xyz, there)
    _, nearest = cKDTree(means[:, :2]).query(xyz[where, :2])
    above: Bools = xyz[where, 2] > means[nearest, 2]
    return above


def _means(xyz: Floats, there: Ints) -> Floats:
    """Average points in square cells on the map, (C, 3)."""
    low = np.array([xyz[there, axis].min() for axis in range(2)])
    high = np.array([xyz[there, axis].max() for axis in range(2)])
    area = max(float(np.prod(np.maximum(high - low, 1e-6))), 1e-12)
    side = np.sqrt(area * EACH / len(there))
    rows = int((high[1] - low[1]) / side) + 1
    number = np.empty(len(there), np.int64)
    for begin in range(0, len(there), MEANS_AT_ONCE):
        part = slice(begin, begin + MEANS_AT_ONCE)
        i, j = (np.floor((xyz[there[part], axis] - low[axis]) / side) for axis in range(2))
        number[part] = i * rows + j
    if number.max() >= len(there):  # along a line there are more cells than points
        _, number = np.unique(number, return_inverse=True)
    count = np.bincount(number)
    full = np.flatnonzero(count)
    sums = [np.bincount(number, xyz[there, axis])[full] for axis in range(3)]
    return np.stack(sums, axis=1) / count[full, None]
