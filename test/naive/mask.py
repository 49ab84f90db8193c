# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which points are on the own vehicle, point by point; cells are (ring, column): (near, far)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    Cells = Mapping[tuple[int, int], tuple[float, float]]


def covered(  # noqa: PLR0913  points, cells, and how
    xyz: Sequence[Sequence[float]],
    ring: Sequence[int],
    valid: Sequence[bool],
    cells: Cells,
    tolerance: float,
    *,
    rays: bool,
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
        beside = [(number, (cell[1] + step) % 720) for step in (-1, 1)]
        inside = all(one in cells for one in beside)
        behind = (rays and inside) or distance <= far + tolerance
        result.append(near - tolerance <= distance and behind)
    return result
