# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The local outlier factor as PCL-LOFFilter computes it, the code of Pirotti et al. (2018).

It differs from their equations 1 to 4 in two ways. A point is the first of its own k neighbours,
so k - 1 others are left. And the search of PCL gives squares of distances, which it takes for
distances: k-distances and reach distances are squares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.distances import squared_k_distances
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.neighbours.tree_walks import squared

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats, Index
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood


def measure(near: Neighbourhood, k: int) -> Floats:
    """Return the factor of every point, (N,) as given; no k points may coincide, k at least 2."""
    others = near.nearest(k - 1).index
    density = _densities(near.xyz, others, squared_k_distances(near, k - 1))
    factor = np.empty(len(near))
    factor[near.order] = _factors(others, density)
    return factor


@kernel
def _densities(xyz: Floats, others: Index, square: Floats) -> Floats:
    """Divide 1 by the mean squared reach distance; the first is that of a point from itself."""
    density = np.empty(len(xyz))
    for p in range(len(xyz)):
        total = square[p]
        for m in range(others.shape[1]):
            o = others[p, m]
            total += max(square[o], squared(xyz, p, o))
        density[p] = (others.shape[1] + 1) / total
    return density


@kernel
def _factors(others: Index, density: Floats) -> Floats:
    """Divide the mean density of the neighbours, the point among them, by its own."""
    factor = np.empty(len(density))
    for p in range(len(density)):
        total = density[p]
        for m in range(others.shape[1]):
            total += density[others[p, m]]
        factor[p] = total / (others.shape[1] + 1) / density[p]
    return factor
