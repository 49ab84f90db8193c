# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The elevation gross-error test as textbook loops: the slow twin of the fast one.

Nothing of the package is imported here, so that no mistake can be shared. The method is that of
Kang, Huang and Yang, "A gross error elimination method for point cloud data based on kd-tree"
(2018), section 3.3, whose steps are named. Distances are compared by their squares.
"""

from collections.abc import Sequence
from math import nan
from statistics import fmean, stdev

Cloud = Sequence[Sequence[float]]


def set_apart(elevation: Sequence[float], gap: float, share: float) -> list[float]:
    """Step 1: by how much each point is beyond the rest of the cloud; 0 for the points of it.

    Seen from outside, elevations end at an empty stretch wider than ``gap``. Points beyond it are
    set apart if they are at most ``share`` of all, or a single one. Of one or two points none is.
    """
    count = len(elevation)
    most = max(1, int(share * count))
    rank = sorted(range(count), key=lambda i: elevation[i])
    beyond = [0.0] * count
    if 2 * most >= count:
        return beyond
    for upwards in (False, True):
        inwards = rank[::-1] if upwards else rank
        outside = 0
        for n in range(1, most + 1):
            if abs(elevation[inwards[n]] - elevation[inwards[n - 1]]) > gap > 0:
                outside = n
        for i in inwards[:outside]:
            beyond[i] = abs(elevation[i] - elevation[inwards[outside]])
    return beyond


def nearest(cloud: Cloud, p: int, k: int, axes: int = 2) -> list[int]:
    """Step 3: the k nearest others in x and y, or in z too, and all that are as near."""

    def squared(q: int) -> float:
        total = 0.0
        for axis in range(axes):
            step = cloud[p][axis] - cloud[q][axis]
            total += step * step
        return total

    others = {q: squared(q) for q in range(len(cloud)) if q != p}
    reach = sorted(others.values())[k - 1]
    return [q for q, distance in others.items() if distance <= reach]


def difference(cloud: Cloud, p: int, k: int, axes: int = 2) -> float:
    """Step 3: M, mean elevation of the neighbours less that of the point."""
    return fmean(cloud[q][2] for q in nearest(cloud, p, k, axes)) - cloud[p][2]


def scores(  # noqa: PLR0913  all settings
    cloud: Cloud,
    k: int,
    multiplier: float,
    sides: str,
    gap: float,
    share: float,
    sigma_floor: float,
    neighbours: str = 'map',
) -> list[float]:
    """Go through steps 1 to 5: statistic ÷ critical value; NaN where there are too few others."""
    if len(cloud) <= k:
        return [nan] * len(cloud)
    beyond = set_apart([point[2] for point in cloud], gap, share)
    answer = [b / gap if b > 0 else nan for b in beyond]
    left = [i for i, b in enumerate(beyond) if b == 0]
    if len(left) <= k:
        return answer
    body = [cloud[i] for i in left]
    axes = 2 if neighbours == 'map' else 3
    differences = [difference(body, p, k, axes) for p in range(len(body))]
    mean, sigma = fmean(differences), max(sigma_floor, stdev(differences))
    for i, m in zip(left, differences, strict=True):
        off = (m - mean) / (multiplier * sigma)
        answer[i] = {'both': abs(off), 'low': off, 'high': -off}[sides]
    return answer
