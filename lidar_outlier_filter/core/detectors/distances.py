# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Distances to the k-th neighbours, which LOF and SOR share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.neighbours.tree_walks import squared

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Floats
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

CHUNK = 4096  # points that a thread takes at once


def squared_k_distances(neighbourhood: Neighbourhood, k: int) -> Floats:
    """Return, (N,) in tree order, the squared distance of each point to the k-th nearest other."""
    return squared_distances(neighbourhood.xyz, neighbourhood.nearest(k).index[:, -1])


@kernel
def squared_distances(xyz: Floats, others: NDArray[np.int32]) -> Floats:
    """Return, (N,), the squared distance of each of N points to another one, m²."""
    result = np.empty(len(others))
    for p in range(len(others)):
        result[p] = squared(xyz, p, others[p])
    return result
