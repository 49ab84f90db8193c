# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Neighbours in space by a scan of all points: the slow twin of the search in a tree.

Nothing of the package is imported here, so that no mistake can be shared. Distances are squared:
those of different pairs are equal exactly where their three differences give the same float64.
Coordinates count in multiples of 2**-510 m: squares of smaller differences would not be normal.
"""

from collections.abc import Sequence

Point = Sequence[float]
Cloud = Sequence[Point]


def whole(value: float) -> float:
    """Return the nearest multiple of 2**-510: all floats from 2**-457 on are multiples of it."""
    value = float(value)
    return value if abs(value) >= 2.0**-457 else round(value * 2.0**510) * 2.0**-510


def squared(a: Point, b: Point) -> float:
    """Return the square of the distance of two points; the sum in this order."""
    dx, dy, dz = whole(a[0]) - whole(b[0]), whole(a[1]) - whole(b[1]), whole(a[2]) - whole(b[2])
    return (dx * dx + dy * dy) + dz * dz


def by_distance(cloud: Cloud, p: int) -> list[tuple[float, int]]:
    """Return (squared distance, index) of all others, sorted: of equally near ones the first."""
    return sorted((squared(cloud[p], cloud[q]), q) for q in range(len(cloud)) if q != p)


def nearest(cloud: Cloud, p: int, k: int) -> tuple[list[int], bool]:
    """Return the indices of the k nearest, and whether another is exactly as far as the k-th."""
    others = by_distance(cloud, p)
    tied = len(others) > k and others[k][0] == others[k - 1][0]
    return [q for _, q in others[:k]], tied


def within(cloud: Cloud, p: int, limit: float) -> list[int]:
    """Return the others whose squared distance is not greater than the limit, ascending."""
    return sorted(q for distance, q in by_distance(cloud, p) if distance <= limit)
