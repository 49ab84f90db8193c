# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The tests of the distance to the nearest neighbours as textbook loops: the fast ones' slow twin.

Nothing of the package is imported here, so that no mistake can be shared. SOR and SOR2 are those of
Pirotti et al., "Implementation and assessment of two density-based outlier detection methods over
large spatial point clouds" (2018).
"""

from collections.abc import Sequence
from math import dist, inf, nan, sqrt

import numpy as np

Point = Sequence[float]
Cloud = Sequence[Point]


def distances(cloud: Cloud, p: int) -> list[float]:
    """Distances to all other points, ascending."""
    return sorted(dist(cloud[p], cloud[q]) for q in range(len(cloud)) if q != p)


def mean_distance(cloud: Cloud, p: int, k: int) -> float:
    """Mean distance to the k nearest other points."""
    return sum(distances(cloud, p)[:k]) / k


def ratio(value: float, limit: float) -> float:
    """Value over limit; nothing is beyond a limit of 0 but what is larger."""
    if limit > 0:
        return value / limit
    return inf if value > 0 else 0.0


def sor(
    cloud: Cloud, k: int, multiplier: float, growth: Sequence[float] | None = None
) -> list[float]:
    """Mean distance over mean + multiplier × sample standard deviation of all, × its own growth."""
    if len(cloud) <= k:
        return [nan for _ in cloud]
    values = [mean_distance(cloud, p, k) for p in range(len(cloud))]
    mean = sum(values) / len(values)
    deviation = sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))
    limit = mean + multiplier * deviation
    grown = [limit * one for one in growth] if growth else [limit for _ in cloud]
    return [ratio(value, one) for value, one in zip(values, grown, strict=True)]


def sor2(cloud: Cloud, k: int, limit: float, growth: Sequence[float] | None = None) -> list[float]:
    """Absolute difference of the mean distance from the median of all, over limit × growth."""
    if len(cloud) <= k:
        return [nan for _ in cloud]
    values = [mean_distance(cloud, p, k) for p in range(len(cloud))]
    middle = float(np.median(values))
    grown = [limit * one for one in growth] if growth else [limit for _ in cloud]
    return [ratio(abs(value - middle), one) for value, one in zip(values, grown, strict=True)]


def radius(
    cloud: Cloud, least: int, radius_m: float, reach: Sequence[float] | None = None
) -> list[float]:
    """Smallest radius that holds the least number of others, over the radius; inf without so many.

    ``reach`` gives each point a radius of its own where that is larger.
    """
    own = [max(radius_m, one) for one in reach] if reach else [radius_m for _ in cloud]
    if len(cloud) <= least:
        return [inf for _ in cloud]
    return [distances(cloud, p)[least - 1] / own[p] for p in range(len(cloud))]
