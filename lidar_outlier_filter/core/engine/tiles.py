# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points in square tiles, and what of the others each tile needs.

Tiles are aligned absolutely: tile (i, j) holds the points with floor(x / side) = i and floor(y /
side) = j. So they depend on the points alone, not on how many fit into memory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import find_copies

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Allocate, Bools, Floats, Ints

CHUNK = 500_000  # points in memory at once
PAIRS = 20_000_000  # of a query and a tile, at once
ROUNDING = 1 + 1e-9  # distances of two searches differ by less


class Tiles:
    """N points, in tile order: those of a tile lie together, in the order given.

    Attributes
    ----------
    order : (N,) int64
        Index of each point among those given.
    xyz : (N, 3) float64
    first : (T + 1,) int64
        Tile t holds the points first[t] to first[t + 1].
    corner : (T, 2) float64
        Least x and y of the tile.
    low, high : (T, 3) float64
        The tight boxes of the points.

    """

    def __init__(self, xyz: Floats, valid: Bools, side: float, allocate: Allocate) -> None:
        """Sort the valid points; ``allocate`` gives an array (memory or file) for a copy."""
        self.side = side
        where = np.flatnonzero(valid)
        number, corners = _number(xyz, where, side)
        inside = np.argsort(number, kind='stable')
        self.order = where[inside]
        counts = np.bincount(number, minlength=len(corners))
        self.first = np.concatenate(([0], np.cumsum(counts)))
        self.corner = corners * side
        self.xyz = allocate((len(where), 3))
        self.low, self.high = np.empty((2, len(corners), 3))
        for begin in range(0, len(where), CHUNK):
            part = slice(begin, begin + CHUNK)
            self.xyz[part] = xyz[self.order[part]]
        for tile in range(len(self)):
            for axis in range(3):  # column by column: numpy is slow along rows of three
                values = self.xyz[self.part(tile), axis]
                self.low[tile, axis], self.high[tile, axis] = values.min(), values.max()

    def __len__(self) -> int:
        """Count the tiles that have points."""
        return len(self.first) - 1

    def part(self, tile: int) -> slice:
        """Return the indices of the points of a tile, in tile order."""
        return slice(int(self.first[tile]), int(self.first[tile + 1]))

    def around(self, tile: int, halo: float, left: Bools) -> tuple[Ints, Floats]:
        """Find the points in a tile and in a halo around it, its edges included.

        Parameters
        ----------
        tile : number of the tile
        halo : width, metres
        left : (N,) bool, in tile order
            Which points there are at all.

        Returns
        -------
        indices : (n,) int64
            In tile order of the points found, sorted as the points were given.
        box : (2, 2) float64
            Least and largest x and y: every point in between was found.

        """
        box = np.stack((self.corner[tile] - halo, self.corner[tile] + self.side + halo))
        near = (self.low[:, :2] <= box[1]).all(axis=1) & (self.high[:, :2] >= box[0]).all(axis=1)
        # Rounding may put a point beyond the edge of its own tile.
        near[tile] = True
        found = []
        for other in np.flatnonzero(near).tolist():
            part = self.part(other)
            inside = left[part] & (_in_box(self.xyz[part], box) | (other == tile))
            found.append(part.start + np.flatnonzero(inside))
        return self.as_given(np.concatenate(found)), box

    def as_given(self, indices: Ints) -> Ints:
        """Sort indices as the points were given."""
        ordered: Ints = indices[np.argsort(self.order[indices])]
        return ordered

    def closure(self, indices: Ints, k: int, hops: int, left: Bools, radius: Floats) -> Ints:
        """Find all points that are within ``hops`` steps, each to a k-nearest neighbour.

        A step leads to every point as near as the k-th nearest other place with points, wherever in
        the cloud it is.

        Parameters
        ----------
        indices : (n,) int64, in tile order
        k, hops : at least 1
        left : (N,) bool, in tile order
            Which points there are at all.
        radius : (N,) float64, in tile order
            Distance of each point to its k-th nearest other place, where it is known; those that
            are NaN are found here as needed, and written down.

        """
        found = new = indices
        for _ in range(hops):
            unknown = new[np.isnan(radius[new])]
            for some in self._batches(unknown):
                radius[some] = self._radii(self.xyz[some], k, left)
            near = [self._within(some, radius[some], left) for some in self._batches(new)]
            new = np.setdiff1d(np.concatenate(near), found) if near else new[:0]
            found = np.concatenate((found, new))
        return self.as_given(found)

    def _batches(self, indices: Ints) -> list[Ints]:
        count = max(1, PAIRS // len(self))
        return [indices[begin : begin + count] for begin in range(0, len(indices), count)]

    def _within(self, indices: Ints, radius: Floats, left: Bools) -> Ints:
        """Find all points within the radius of any of the points given."""
        queries, radius = self.xyz[indices], radius * ROUNDING
        to_tiles = _distances_to_boxes(queries, self.low, self.high)
        found = []
        for tile in np.flatnonzero((to_tiles <= radius[:, None]).any(axis=0)).tolist():
            there, points = self._left_in(tile, left)
            near = to_tiles[:, tile] <= radius
            lists = _tree(points).query_ball_point(queries[near], radius[near], workers=-1)
            found.append(there[np.unique(np.concatenate(lists)).astype(np.int64)])
        return np.unique(np.concatenate(found))

    def _radii(self, queries: Floats, k: int, left: Bools) -> Floats:
        """Return the distance of each query to its k-th nearest other place; inf: no so many."""
        to_tiles = _distances_to_boxes(queries, self.low, self.high)
        best = np.full((len(queries), k + 1), np.inf)  # with the own place
        for tile in np.argsort(to_tiles.min(axis=0), kind='stable').tolist():
            near = to_tiles[:, tile] <= best[:, k] * ROUNDING
            if near.any():
                _, points = self._left_in(tile, left)
                distance = distances_to_places(points, queries[near], k)
                both = np.concatenate((best[near], distance), axis=1)
                best[near] = np.sort(both, axis=1)[:, : k + 1]
        radii: Floats = best[:, k]
        return radii

    def _left_in(self, tile: int, left: Bools) -> tuple[Ints, Floats]:
        part = self.part(tile)
        inside = np.flatnonzero(left[part])
        return part.start + inside, self.xyz[part][inside]


def distances_to_places(points: Floats, queries: Floats, k: int) -> Floats:
    """Return the distances to the k + 1 nearest places with points, (Q, k + 1), inf for none."""
    result = np.full((len(queries), k + 1), np.inf)
    copies = find_copies(Neighbourhood(points, 1), points, 1)
    places = np.delete(points, copies[:, 0], axis=0) if len(copies) else points
    count = min(k + 1, len(places))
    if count and len(queries):
        tree, ranks = _tree(places), np.arange(1, count + 1)
        result[:, :count], _ = tree.query(queries, ranks, workers=-1)
    return result


def _tree(points: Floats) -> cKDTree:
    """Make a tree for few queries: it is made in half of the time, and answers later."""
    return cKDTree(points, compact_nodes=False, balanced_tree=False)


def _in_box(points: Floats, box: Floats) -> Bools:
    """Return which points lie between the least and the largest x and y of a box."""
    inside = np.ones(len(points), np.bool_)
    for axis in range(2):
        values = points[:, axis]
        inside &= (values >= box[0, axis]) & (values <= box[1, axis])
    return inside


def _distances_to_boxes(points: Floats, low: Floats, high: Floats) -> Floats:
    """Return the distance of every point to every box, (Q, T); 0 within."""
    total = np.zeros((len(points), len(low)))
    for axis in range(3):
        values = points[:, axis, None]
        outside = np.maximum(np.maximum(low[:, axis] - values, values - high[:, axis]), 0.0)
        total += outside * outside
    distances: Floats = np.sqrt(total)
    return distances


def _number(xyz: Floats, where: Ints, side: float) -> tuple[NDArray[np.int32], Floats]:
    """Return the number of the tile of each point, and i and j of each tile, (T, 2)."""
    # Complex numbers are sorted by their real part, then by the other.
    known = np.empty(0, np.complex128)
    for keys, _ in _runs(xyz, where, side):
        known = np.unique(np.concatenate((known, np.unique(keys))))
    number = [
        np.repeat(np.searchsorted(known, keys).astype(np.int32), lengths)
        for keys, lengths in _runs(xyz, where, side)
    ]
    return np.concatenate([np.empty(0, np.int32), *number]), np.stack((known.real, known.imag), 1)


def _runs(xyz: Floats, where: Ints, side: float) -> Iterator[tuple[NDArray[np.complex128], Ints]]:
    """Give i + j √-1 of each run of points in one tile, and its length: few, in most files."""
    for begin in range(0, len(where), CHUNK):
        part = where[begin : begin + CHUNK]
        keys = np.floor(xyz[part, 0] / side) + 1j * np.floor(xyz[part, 1] / side)
        first = np.flatnonzero(np.append([True], keys[1:] != keys[:-1]))
        yield keys[first], np.diff(np.append(first, len(keys)))
