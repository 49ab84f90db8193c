# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Filters for surveys of others, in plain loops."""

from itertools import pairwise

Position = tuple[float, float, float]


def minima(xyz: list[Position], cell: float, drop: float) -> list[bool]:
    """Return which points PDAL's ``filters.elm`` rejects.

    In each cell these are the lowest, one after the other, as long as the next is ``drop`` higher.
    """
    west, south = min(x for x, _, _ in xyz), min(y for _, y, _ in xyz)
    cells: dict[tuple[int, int], list[int]] = {}
    for n, (x, y, _) in enumerate(xyz):
        cells.setdefault((int((x - west) // cell), int((y - south) // cell)), []).append(n)
    rejected = [False] * len(xyz)
    for inside in cells.values():
        inside.sort(key=lambda n: xyz[n][2])
        for low, high in pairwise(inside):
            if xyz[high][2] - xyz[low][2] < drop:
                break
            rejected[low] = True
    return rejected


def isolated(xyz: list[Position], side: float, few: int) -> list[bool]:
    """Return which points lie where a voxel and the 26 around it hold at most so many."""
    first = [min(place[axis] for place in xyz) for axis in range(3)]
    voxels = [
        [int((value - low) // side) for value, low in zip(place, first, strict=True)]
        for place in xyz
    ]
    near = [
        sum(max(abs(a - b) for a, b in zip(one, other, strict=True)) <= 1 for other in voxels)
        for one in voxels
    ]
    return [count <= few for count in near]
