# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which points are on the own vehicle, point by point; cells are (ring, column): (near, far)."""

import math
from collections.abc import Mapping, Sequence

Cells = Mapping[tuple[int, int], tuple[float, float]]


def find_masked(
    xyz: Sequence[Sequence[float]],
    ring: Sequence[int],
    valid: Sequence[bool],
    cells: Cells,
    tolerance: float,
) -> tuple[list[bool], list[bool]]:
    """Find the points on the vehicle, and those behind it.

    Columns are half a degree wide, from x on against the clock. A shadow needs the vehicle in the
    columns on either side, too.
    """
    on_vehicle, in_shadow = [], []
    for position, number, is_valid in zip(xyz, ring, valid, strict=True):
        cell, *beside = [(number, (column_of(position) + step) % 720) for step in (0, -1, 1)]
        is_there = is_valid and cell in cells
        near, far = cells[cell] if is_there else (math.inf, math.inf)
        distance = range_of(position)
        on_vehicle.append(near - tolerance <= distance <= far + tolerance)
        is_inside = is_there and all(one in cells for one in beside)
        in_shadow.append(is_inside and distance > far + tolerance)
    return on_vehicle, in_shadow


def column_of(position: Sequence[float]) -> int:
    """Return the column of half a degree that a point is in."""
    x, y, _ = position
    return math.floor(math.atan2(y, x) / (2 * math.pi) * 720) % 720


def range_of(position: Sequence[float]) -> float:
    """Return the distance from the sensor."""
    x, y, z = position
    return math.sqrt(x * x + y * y + z * z)
