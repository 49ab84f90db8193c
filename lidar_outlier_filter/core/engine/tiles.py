# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector in square tiles of the map, each with a halo: its scores depend on the tiles.

Tiles are aligned absolutely: tile (i, j) holds the points with floor(x / side) = i and
floor(y / side) = j. So they depend on the coordinates alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.points.points import Points

HALO = 0.1  # of the side of a tile: its neighbours on the grid hold all of it


def detect_in_tiles(
    detect: Callable[[Points], Scores], points: Points, side: float, max_points: int
) -> Scores:
    """Score the points of each tile among those of the tile and its halo.

    Parameters
    ----------
    detect : scores some of the points, which keep their order
    points : N points
    side : of a tile, metres
    max_points : of a tile with its halo

    Raises
    ------
    CloudError
        If a tile with its halo holds more points.

    """
    result = Scores(np.full(len(points), np.nan), np.zeros(len(points), np.uint16))
    for indices, own in tiles(points.xyz, side):
        if len(indices) > max_points:
            must_be = f'at most max_points = {max_points}'
            raise CloudError('the number of points in a tile with its halo', must_be, len(indices))
        found = detect(points.take(indices)).take(own)
        result.score[indices[own]] = found.score
        if found.extra is not None and result.extra is not None:
            result.extra[indices[own]] = found.extra
    return result


def tiles(xyz: Floats, side: float) -> Iterator[tuple[Ints, Bools]]:
    """Yield the points of each tile and its halo, ascending, and which are in the tile itself."""
    # Complex numbers are sorted by their real part, then by the other.
    keys = np.floor(xyz[:, 0] / side) + 1j * np.floor(xyz[:, 1] / side)
    corners, number = np.unique(keys, return_inverse=True)
    order = np.argsort(number, kind='stable')
    parts = np.split(order, np.searchsorted(number[order], np.arange(1, len(corners))))
    tile_at = {corner: tile for tile, corner in enumerate(corners.tolist())}
    steps = [i + 1j * j for i in (-1, 0, 1) for j in (-1, 0, 1)]
    for tile, corner in enumerate(corners.tolist()):
        beside = [tile_at[corner + step] for step in steps if corner + step in tile_at]
        near = np.sort(np.concatenate([parts[other] for other in beside]))
        inside = np.ones(len(near), np.bool_)
        for axis, low in enumerate((corner.real * side, corner.imag * side)):
            values = xyz[near, axis]
            inside &= (values >= low - HALO * side) & (values <= low + side + HALO * side)
        own = number[near] == tile
        inside |= own  # rounding may put a point beyond the edge of its own tile
        yield near[inside], own[inside]
