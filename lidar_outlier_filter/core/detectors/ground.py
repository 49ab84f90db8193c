# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The ground under a cloud: a progressive morphological filter (Zhang et al. 2003).

1. The lowest point of each cell of a grid. A cell without points lies on the straight line between
   the nearest two of its row that have some, and beyond the last of them is as high as that. Rows
   without points lie between the nearest two rows in the same way.
2. Openings by squares of 3, 5, 9, 17 … cells, each of what the last one left, until a square is as
   wide as the widest that stands on the ground.
3. A cell that an opening of w cells lowers by more than ``RISE`` + ``SLOPE`` · (w - w before) ·
   cell, at most ``MOST_RISE``, is no ground; for the first opening it is ``RISE``. The ground under
   such cells is filled as in 1.

An opening takes off what is higher than its surroundings, and keeps what is lower: the paper leaves
low points to others. Here a cell of the ground that lies more than ``PIT`` below its closing by
3 × 3 cells takes the height of that. So a low point, or a small group of them, does not pull the
ground down. Not before the openings: under a dense canopy a cell with ground is a pit, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Ints

RISE, MOST_RISE = 0.3, 3.0  # metres
PIT = 0.5  # metres
SLOPE = 0.3  # of the ground, rise ÷ run
MOST_CELLS = 16  # for a point, and as many as in FREE_CELLS in any case
FREE_CELLS = 1 << 22


def heights(xyz: Floats, cell: float, widest: float) -> Floats:
    """Return how high N points are above the ground, metres; negative below it.

    Between the centres of cells the ground is interpolated, along x and along y.

    Parameters
    ----------
    xyz : (N, 3) float64, finite, metres, z up; N > 0
    cell : side of a cell, metres
    widest : of what stands on the ground, metres: openings go as far as that

    Raises
    ------
    FilterError
        If the cloud is spread over more than 16 cells for a point.

    References
    ----------
    .. [1] Zhang, Chen, Whitman, Shyu, Yan and Zhang (2003): A progressive morphological filter for
       removing nonground measurements from airborne LIDAR data. IEEE Transactions on Geoscience and
       Remote Sensing 41(4), 872-882. https://doi.org/10.1109/TGRS.2003.810682

    """
    if count_cells(xyz, cell) > most_cells(len(xyz)):
        must_be = f'large enough for at most {MOST_CELLS} cells a point'
        extent = ' × '.join(f'{side:g}' for side in np.ptp(xyz[:, :2], axis=0))
        raise FilterError('elevation.cell', must_be, f'{cell:g} m for {extent} m')
    at = (xyz[:, :2] - xyz[:, :2].min(axis=0)) / cell
    shape = at.max(axis=0).astype(np.int64) + 1
    ground = surface(lowest(at, xyz[:, 2], shape), cell, widest)
    height: Floats = xyz[:, 2] - ndimage.map_coordinates(
        ground, at.T - 0.5, order=1, mode='nearest'
    )
    return height


def count_cells(xyz: Floats, cell: float) -> float:
    """Count the cells under a cloud, which may be more than there are integers."""
    return float(np.prod(np.floor(np.ptp(xyz[:, :2], axis=0) / cell) + 1))


def most_cells(count: int) -> int:
    """Return how many cells a cloud of so many points may have."""
    return max(FREE_CELLS, MOST_CELLS * count)


def lowest(at: Floats, z: Floats, shape: Ints) -> Floats:
    """Return the lowest z of each cell; one without points is filled."""
    grid = np.full(shape, np.inf)
    index = at.astype(np.int64)
    np.minimum.at(grid, (index[:, 0], index[:, 1]), z)
    return filled(grid, np.isfinite(grid))


def surface(grid: Floats, cell: float, widest: float) -> Floats:
    """Return the ground of a grid of lowest points."""
    ground, is_ground = grid, np.ones(grid.shape, np.bool_)
    before = width = 3
    while True:
        opened = ndimage.grey_opening(ground, (width, width))
        rise = min(RISE + SLOPE * (width - before) * cell, MOST_RISE)
        is_ground &= ground - opened <= rise
        ground = opened
        if width * cell >= widest:
            break
        before, width = width, 2 * width - 1
    ground = filled(grid, is_ground)
    closed = ndimage.grey_closing(ground, (3, 3))
    return np.where(closed - ground > PIT, closed, ground)


def filled(grid: Floats, known: Bools) -> Floats:
    """Fill the cells that are not known, along rows, and then rows of which none is known.

    Of a grid without any known cell nothing changes.
    """
    rows = np.flatnonzero(known.any(axis=1))
    if len(rows) == 0:
        return grid
    result = grid.copy()
    columns = np.arange(grid.shape[1])
    for row in rows[~known[rows].all(axis=1)]:
        there = np.flatnonzero(known[row])
        result[row] = np.interp(columns, there, grid[row, there])
    for column in columns if len(rows) < len(grid) else ():
        result[:, column] = np.interp(np.arange(len(grid)), rows, result[rows, column])
    return result
