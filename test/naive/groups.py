# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Groups by plain loops: cells that touch, also at a corner, are one."""

from itertools import product
from math import floor

CELL = 0.25  # metres


def connect(xyz: list[list[float]]) -> list[set[int]]:
    """Return the groups as sets of the numbers of their points."""
    cells: dict[tuple[int, ...], set[int]] = {}
    for number, point in enumerate(xyz):
        cells.setdefault(tuple(floor(value / CELL) for value in point), set()).add(number)
    groups = []
    left = set(cells)
    while left:
        pending, members = [left.pop()], set()
        while pending:
            cell = pending.pop()
            members |= cells[cell]
            for step in product((-1, 0, 1), repeat=3):
                beside = tuple(value + one for value, one in zip(cell, step, strict=True))
                if beside in left:
                    left.remove(beside)
                    pending.append(beside)
        groups.append(members)
    return groups
