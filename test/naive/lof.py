# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The local outlier factor as textbook loops: the slow twin that the fast one is compared with.

Nothing of the package is imported here, so that no mistake can be shared. Definitions are those of
Sotoodeh, "Outlier detection in laser scanner point clouds" (2006), section 4, which are those of
Breunig et al., "LOF: identifying density-based local outliers" (2000). Distances are compared by
their squares: the root of different squares may be the same number, which would make ties.
"""

from collections.abc import Sequence
from math import nan, sqrt

import numpy as np

Point = Sequence[float]
Cloud = Sequence[Point]


def squared(a: Point, b: Point) -> float:
    """Square of the distance between two points."""
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return float(dx * dx + dy * dy + dz * dz)


def k_distance_squared(cloud: Cloud, p: int, k: int) -> float:
    """Square of the distance to the k-th nearest other point.

    Where that is 0, of the k-distinct-distance: to the k-th nearest other place at which points
    are, or to the farthest if there are fewer; 0 without other points.
    """
    distances = sorted(squared(cloud[p], cloud[q]) for q in range(len(cloud)) if q != p)
    if distances[k - 1] > 0:
        return distances[k - 1]
    positions = {tuple(map(float, point)) for point in cloud}
    distinct = sorted(d for d in (squared(cloud[p], place) for place in positions) if d > 0)
    return distinct[min(k, len(distinct)) - 1] if distinct else 0.0


def neighbourhood(cloud: Cloud, p: int, reach_squared: float) -> list[int]:
    """All other points not farther than the k-distance: k of them, or more where there are ties."""
    return [q for q in range(len(cloud)) if q != p and squared(cloud[p], cloud[q]) <= reach_squared]


def local_outlier_factors(cloud: Cloud, k: int) -> list[float]:
    """LOF of each point; NaN for all where a point has fewer than k others; 1 if all coincide."""
    everyone = range(len(cloud))
    if len(cloud) <= k:
        return [nan for _ in everyone]
    square = [k_distance_squared(cloud, p, k) for p in everyone]
    if max(square) == 0:
        return [1.0 for _ in everyone]
    near = [neighbourhood(cloud, p, square[p]) for p in everyone]
    k_distance = [sqrt(one) for one in square]
    density = []
    for p in everyone:
        reach = [max(k_distance[o], sqrt(squared(cloud[p], cloud[o]))) for o in near[p]]
        density.append(1 / (sum(reach) / len(reach)))
    return [sum(density[o] / density[p] for o in near[p]) / len(near[p]) for p in everyone]


def scores(cloud: Cloud, k: int, threshold: float, statistic: str) -> list[float]:
    """LOF, or its absolute difference from the median of all (lof2), over the threshold."""
    factors = local_outlier_factors(cloud, k)
    if statistic == 'lof2' and factors:
        middle = float(np.median(factors))
        factors = [abs(factor - middle) for factor in factors]
    return [factor / threshold for factor in factors]
