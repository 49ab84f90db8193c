# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whether rejected points are above or below what is kept around them."""

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints

EACH = 32.0  # kept points of a cell on the map, about
POINTS_AT_ONCE = 1_000_000  # points in memory at once


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
    for begin in range(0, len(there), POINTS_AT_ONCE):
        part = slice(begin, begin + POINTS_AT_ONCE)
        i, j = (np.floor((xyz[there[part], axis] - low[axis]) / side) for axis in range(2))
        number[part] = i * rows + j
    if number.max() >= len(there):  # along a line there are more cells than points
        _, number = np.unique(number, return_inverse=True)
    count = np.bincount(number)
    full = np.flatnonzero(count)
    sums = [np.bincount(number, xyz[there, axis])[full] for axis in range(3)]
    return np.stack(sums, axis=1) / count[full, None]
