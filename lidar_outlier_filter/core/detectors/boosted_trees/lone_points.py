# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Lone points of a whole cloud: far from every surface, line and crown, also where they are many.

Trees compare a point with its neighbours. Where one point of a hundred is lone, the neighbours of a
lone point are lone themselves, and it seems as near to them as it should be. So lone points are
found by the density of all points around them, as DBSCAN finds noise (Ester et al. 1996), and the
trees judge the others without them.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.neighbours.floor import MAX_COLUMNS, ROW, WINDOW_COLUMNS, Floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import K

# Within so many typical distances to the eighth neighbour, a lone point has no eight others.
REACH = 5.0
# Width ÷ length of a point and its eight neighbours, below which they lie on a line, as on a wire.
MAX_THINNESS = 0.15
# Height ÷ width below which they are level ground, as seen through a crown; and the least cosine of
# its slope.
MAX_FLATNESS, MIN_LEVEL = 0.07, 0.8
NONE = np.empty(0, np.int64), np.empty(0)  # no lone points


class Parted(NamedTuple):
    """Points without the lone ones.

    Attributes
    ----------
    hood : Neighbourhood
        Of the M points that are not lone.
    rest : (M,) int64
        Their indices in the cloud, in tree order.
    lone : (L,) int64
        Indices of the lone points.
    isolation : (L,) float64
        Distance to the eighth neighbour ÷ the longest that is kept, greater than 1.

    """

    hood: Neighbourhood
    rest: Ints
    lone: Ints
    isolation: Floats


def part(hood: Neighbourhood, index: Ints, around: Floor) -> Parted:
    """Take the lone points out of a cloud; of eight points or fewer there would be no neighbours.

    Parameters
    ----------
    hood : of more than eight points, no two of which are at one place
    index : (N,) int64
        Their indices in the cloud, in tree order.
    around : Floor
        What the whole cloud is like.

    """
    lone, isolation = _find(hood, around)
    if len(lone) == 0 or len(hood) - len(lone) <= K:
        return Parted(hood, index, *NONE)
    given, is_lone = np.empty(len(hood), np.int64), np.zeros(len(hood), np.bool_)
    given[hood.order] = index
    is_lone[hood.order[lone]] = True
    left = hood.without(is_lone)
    return Parted(left, given[~is_lone][left.order], index[lone], isolation)


def _find(hood: Neighbourhood, around: Floor) -> tuple[Ints, Floats]:
    """Return the lone points, in tree order, and how far they are beyond reach."""
    radius = np.sqrt(hood.squared_distances(K))
    sparse = np.flatnonzero(radius > REACH * around.typical)
    reach = REACH * np.maximum(around.typical, _usual(hood.xyz, radius, sparse, around))
    sparse, reach = sparse[radius[sparse] > reach], reach[radius[sparse] > reach]
    near = hood.nearest(K).index[sparse]
    together = np.concatenate([hood.xyz[sparse][:, None], hood.xyz[near]], axis=1)
    distance = np.linalg.norm(together[:, 1:] - together[:, :1], axis=2)
    together -= together.mean(axis=1, keepdims=True)
    squares, axes = np.linalg.eigh(np.einsum('ski,skj->sij', together, together))
    aligned = squares[:, 1] < MAX_THINNESS**2 * squares[:, 2]
    aligned |= (squares[:, 0] < MAX_FLATNESS**2 * squares[:, 1]) & (abs(axes[:, 2, 0]) > MIN_LEVEL)
    has_company = np.ones(len(radius), np.bool_)
    has_company[sparse] = aligned
    # All within reach are among the eight nearest, as the eighth is beyond.
    is_lone = ~(aligned | (has_company[near] & (distance <= reach[:, None])).any(axis=1))
    isolation: Floats = radius[sparse[is_lone]] / reach[is_lone]
    return sparse[is_lone], isolation


def _usual(xyz: Floats, radius: Floats, some: Ints, around: Floor) -> Floats:
    """Return the median distance to the eighth neighbour in the square around each of some points.

    Far from a scanner, all points are sparse.
    """
    number = np.floor((xyz[:, :2] - around.origin) / (WINDOW_COLUMNS * around.side))
    row, within = np.minimum(number, MAX_COLUMNS).astype(np.int64).T
    square = row << ROW | within
    squares = np.unique(square[some])
    of = np.minimum(np.searchsorted(squares, square), max(len(squares) - 1, 0))
    held = np.flatnonzero(squares[of] == square) if len(squares) else some
    order = held[np.lexsort((radius[held], of[held]))]
    count = np.bincount(of[held], minlength=len(squares))
    middle = np.cumsum(count) - count + (count - 1) // 2
    usual: Floats = radius[order[middle]][of[some]]
    return usual
