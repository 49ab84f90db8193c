# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whether rejected points are above or below what is kept around them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]

EACH = 32.0  # kept points of a cell on the map, about


def is_high(xyz: Floats, kept: Bools, rejected: Bools) -> Bools:
    """Return which of the rejected points (R,) are above what is kept around them on the map.

    Kept points are averaged in square cells. Each rejected one is compared with the nearest cell.
    """
    where = np.flatnonzero(rejected)
    if not kept.any():
        return np.zeros(len(where), np.bool_)
    place = xyz[kept]
    low, high = place[:, :2].min(axis=0), place[:, :2].max(axis=0)
    area = max(float(np.prod(np.maximum(high - low, 1e-6))), 1e-12)
    side = np.sqrt(area * EACH / len(place))
    cell = np.floor((place[:, :2] - low) / side).astype(np.int64)
    number = cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    _, inside, count = np.unique(number, return_inverse=True, return_counts=True)
    means = [np.bincount(inside.reshape(-1), place[:, axis]) / count for axis in range(3)]
    _, nearest = cKDTree(np.stack(means[:2], axis=1)).query(xyz[where, :2])
    above: Bools = xyz[where, 2] > means[2][nearest]
    return above
