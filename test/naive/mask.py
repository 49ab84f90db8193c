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
    for (x, y, z), number, is_valid in zip(xyz, ring, valid, strict=True):
        turn = math.atan2(y, x) / (2 * math.pi)
        cell = (number, math.floor(turn * 720) % 720)
        distance = math.sqrt(x * x + y * y + z * z)
        if not is_valid or cell not in cells:
            result.append(False)
            continue
        near, far = cells[cell]
        result.append(near - tolerance <= distance <= far + tolerance)
    return result
