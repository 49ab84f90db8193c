# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A check of verdicts that needs no labels: what is rejected must not form surfaces."""

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

MIN_SHARE = 0.03  # of the points, up to which nothing is checked: clean data have far less rejected
MIN_REJECTED = 64  # points, fewer show no surface
SAMPLE = 512  # rejected points that are looked at
NEAREST = 8  # other rejected points
# Typical thickness ÷ extent of rejected neighbours. In simulated snow, fog, dust and spray it was
# 0.24 and more, also where 58 % of the points were fog; of surfaces 0.001.
MAX_FLATNESS = 0.05


def rejects_surfaces(xyz: Floats, rejected: Bools, threads: int = 0) -> bool:
    """Return whether many points are rejected, and these lie on surfaces or lines.

    Parameters
    ----------
    xyz : (N, 3) float64
        Metres, in any frame.
    rejected : (N,) bool
    threads : maximum number of threads; 0: all cores

    """
    count = np.count_nonzero(rejected)
    if count < max(MIN_SHARE * len(xyz), MIN_REJECTED):
        return False
    hood, _, _ = Neighbourhood(xyz[rejected], NEAREST, threads).distinct()
    if len(hood) < MIN_REJECTED:
        return False
    some = np.arange(0, len(hood), -(-len(hood) // SAMPLE))
    near = hood.xyz[np.column_stack([some, hood.nearest_of(some, NEAREST)])]
    about = near - near.mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(np.einsum('ski,skj->sij', about, about))
    extent = np.maximum(squares.sum(axis=1), np.finfo(float).tiny)
    return bool(np.median(np.maximum(squares[:, 0], 0.0) / extent) < MAX_FLATNESS**2)
