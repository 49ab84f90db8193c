# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which points are on the own vehicle, point by point; cells are (ring, column): (near, far)."""

import math
from collections.abc import Mapping, Sequence

Cells = Mapping[tuple[int, int], tuple[float, float]]


def covered(
    xyz: Sequence[Sequence[float]],
    ring: Sequence[int],
    valid: Sequence[bool],
    cells: Cells,
    tolerance: float,
) -> list[bool]:
    """Look up the cell of each point: columns of half a degree, from x on against the clock."""
    result = []
    for position, number, is_valid in zip(xyz, ring, valid, strict=True):
        cell = (number, column_of(position))
        if not is_valid or cell not in cells:
            result.append(False)
            continue
        near, far = cells[cell]
        result.append(near - tolerance <= range_of(position) <= far + tolerance)
    return result


def shadowed(
    xyz: Sequence[Sequence[float]],
    ring: Sequence[int],
    valid: Sequence[bool],
    cells: Cells,
    tolerance: float,
) -> list[bool]:
    """Find the points behind the vehicle, where it is in the columns on either side, too."""
    result = []
    for position, number, is_valid in zip(xyz, ring, valid, strict=True):
        beside = [(number, (column_of(position) + step) % 720) for step in (0, -1, 1)]
        is_behind = is_valid and all(cell in cells for cell in beside)
        result.append(is_behind and range_of(position) > cells[beside[0]][1] + tolerance)
    return result


def column_of(position: Sequence[float]) -> int:
    """Return the column of half a degree that a point is in."""
    x, y, _ = position
    return math.floor(math.atan2(y, x) / (2 * math.pi) * 720) % 720


def range_of(position: Sequence[float]) -> float:
    """Return the distance from the sensor."""
    x, y, z = position
    return math.sqrt(x * x + y * y + z * z)
