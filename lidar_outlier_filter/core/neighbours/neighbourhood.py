# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The one neighbour search that the spatial detectors share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Allocate, Bools, Floats, Index, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.threads import Result
from lidar_outlier_filter.core.neighbours.tree_build import Tree, build, prune
from lidar_outlier_filter.errors import FilterError

__all__ = ['Nearest', 'Neighbourhood', 'Tree']

LARGEST_M = 1e150  # metres: squares stay finite
FINEST_M = 2.0**-510  # metres: squares stay normal numbers, none of which is rounded to 0
COARSE = 2.0**53 * FINEST_M  # of numbers from here on FINEST_M is no longer a part
MAX_POINTS = 2**31 - 1  # their indices are int32
# What a thread takes at once, about a millisecond: leaves where all points are selected, and rows.
LEAVES, ROWS = 64, 1 << 14
CHECKED_POINTS = 1 << 20  # points whose coordinates are checked at once
# Up to this share it pays to keep the lists that are still right. Measured on the simulated street,
# k = 20, points rejected at random: of 1 %, keeping takes 0.4 times as long as searching all again,
# of 3 %, 0.65, of 10 %, 1.07, because then 88 % of the lists have lost a point.
FEW_REJECTED = 0.1


class Nearest(NamedTuple):
    """The k nearest neighbours of N points.

    Attributes
    ----------
    index : (N, k) int32
        For each point in tree order the indices in tree order of its neighbours, the nearest first.
    tied : (N,) bool
        Another point, not in the list, is exactly as far as the k-th.

    """

    index: Index  # type: ignore[assignment]  # nobody misses that of tuples
    tied: Bools


class _Sorted(NamedTuple):
    order: Ints
    xyz: Floats
    tree: Tree


class Neighbourhood:
    """The neighbours of N points, in *tree order*: near points lie together in memory.

    Neighbours are exact. They are sorted by squared distance, ``(dx*dx + dy*dy) + dz*dz`` in
    float64, and where it is equal by the index of the point as given. A point is never its own
    neighbour; others that coincide with it are. Nothing depends on the number of threads.

    Coordinates count in multiples of 2**-510 m. So no square of a difference underflows: points
    either coincide, or have a distance greater than 0.

    The tree is built, and the lists are searched, when they are first asked for. At most 64 bytes a
    point are held, and 4 more for each neighbour. ``threads``: maximum number; 0: all cores.
    """

    def __init__(
        self, xyz: Floats, most: int, threads: int = 0, allocate: Allocate = np.empty
    ) -> None:
        """Take points; nothing is built yet.

        Parameters
        ----------
        xyz : (N, 3) float64
            Metres, finite and at most 1e150 in size. Must not change before the tree is built.
        most : int
            The largest number of neighbours that will be asked for, at least 1.
        threads : int
            Maximum number of threads; 0: all cores.
        allocate : callable
            Returns the arrays of coordinates and of lists, in memory or in files.

        """
        xyz = np.asarray(xyz, np.float64)
        if xyz.ndim != 2 or xyz.shape[1] != 3 or len(xyz) > MAX_POINTS:  # noqa: PLR2004  x, y, z
            raise FilterError('points', f'(N, 3) with N up to {MAX_POINTS}', xyz.shape)
        if len(xyz) > 0 and not (xyz.min() >= -LARGEST_M and xyz.max() <= LARGEST_M):
            got = xyz[~(np.abs(xyz) <= LARGEST_M)][0]
            raise FilterError('coordinates', f'finite and at most {LARGEST_M:g} m', got)
        self._given = _in_multiples(xyz)
        self._count, self._most, self.threads = len(xyz), most, threads
        self._allocate = allocate
        self._sorted: _Sorted | None = None
        self._nearest: Nearest | None = None

    def __len__(self) -> int:
        """Count the points."""
        return self._count

    @property
    def order(self) -> Ints:
        """The index, as given, of each point in tree order: (N,)."""
        return self._build().order

    @property
    def xyz(self) -> Floats:
        """The points in tree order: (N, 3), metres."""
        return self._build().xyz

    @property
    def tree(self) -> Tree:
        """The boxes that the points are sorted into."""
        return self._build().tree

    def nearest(self, k: int) -> Nearest:
        """List the k nearest neighbours of every point.

        The lists are searched once, for ``most`` neighbours; a smaller k is a view of them.

        Parameters
        ----------
        k : int
            From 1 to ``most``, and less than there are points.

        """
        most = min(self._most, self._count - 1)
        if not 1 <= k <= most:
            raise FilterError('the number of neighbours', f'1 to {most}', k)
        if self._nearest is None:
            nearest = self._empty_lists(self._count, most)
            self._search(nearest, np.arange(self._count, dtype=np.int32))
            self._nearest = nearest
        nearest = self._nearest
        if k == most:
            return nearest
        tied = self._squared(nearest.index, k) == self._squared(nearest.index, k + 1)
        return Nearest(nearest.index[:, :k], tied)

    def squared_distances(self, k: int) -> Floats:
        """Return, (N,) in tree order, the squared distance of each point to its k-th neighbour."""
        return self._squared(self.nearest(k).index, k)

    def distinct(self) -> tuple[Neighbourhood, Ints, Ints]:
        """Return the neighbourhood of M points, no two of which are at one place.

        Returns
        -------
        hood : of these points, at each place the first that was given
        index : (M,) int64
            Their indices as given, in tree order.
        copies : (2, C) int64
            Indices, as given, of all others, and of the point at the place of each.

        """
        order, xyz, tree = self._build()
        leaves = _kernels.subtrees(tree, 0)
        found = self._in_threads(
            lambda i, j: _kernels.find_copies(order, xyz, tree, leaves[i:j]), len(leaves)
        )
        copies = np.concatenate(found).T
        if copies.size == 0:
            return self, order, copies
        is_copy = np.zeros(len(self), np.bool_)
        is_copy[copies[0]] = True
        hood = self.without(is_copy)
        return hood, np.flatnonzero(~is_copy)[hood.order], copies

    def without(self, rejected: Bools) -> Neighbourhood:
        """Return the neighbourhood of the points that are left, numbered anew in the same order.

        It is equal to one made of these points, except for its tree order. What is known already is
        kept: the tree loses points, and of the lists only those that held one, or that were tied,
        are searched again. Where nothing has been built, nothing is.

        Parameters
        ----------
        rejected : (N,) bool
            In the order given at construction.

        """
        given, old = self._given, self._sorted
        if old is None:
            return Neighbourhood(given[~rejected], self._most, self.threads, self._allocate)
        kept = ~rejected[old.order]
        left = np.flatnonzero(kept)
        xyz = self._allocate((len(left), 3), np.float64)
        np.take(old.xyz, left, axis=0, out=xyz, mode='clip')  # other modes make a copy
        result = Neighbourhood(xyz, self._most, self.threads, self._allocate)
        number = np.cumsum(~rejected) - 1
        result._sorted = _Sorted(number[old.order[left]], xyz, prune(old.tree, kept, xyz))
        result._given = xyz[:0]
        few = len(xyz) > self._most and len(xyz) >= (1 - FEW_REJECTED) * self._count
        if self._nearest is not None and few:
            result._nearest = self._carry_over(result, kept)
        return result

    def within(self, which: Ints, squared: Floats) -> tuple[Ints, Index]:
        """List all other points up to a distance.

        Parameters
        ----------
        which : (M,) int64
            Indices in tree order.
        squared : (M,) float64
            Squared radius of each, inclusive, m²; a negative one finds no point.

        Returns
        -------
        offsets : (M + 1,) int64
            The neighbours of ``which[i]`` are ``index[offsets[i]:offsets[i + 1]]``.
        index : (offsets[M],) int32
            Indices in tree order, ascending. Of S points that coincide each has S - 1 neighbours.

        """
        squared = np.ascontiguousarray(squared, np.float64)
        which = np.ascontiguousarray(which, np.int64)
        _, xyz, tree = self._build()

        def walk(i: int, j: int) -> tuple[Ints, Index]:
            return _kernels.list_within(xyz, tree, which[i:j], squared[i:j])

        counts, lists = [np.zeros(1, np.int64)], [np.empty(0, np.int32)]
        for count, index in self._in_threads(walk, len(which)):
            counts.append(count)
            lists.append(index)
        return np.cumsum(np.concatenate(counts)), np.concatenate(lists)

    def nearest_of(self, which: Ints, k: int) -> Index:
        """List the k nearest neighbours of few points; k may be more than ``most``.

        Parameters
        ----------
        which : (M,) int64
            Indices in tree order.
        k : int
            From 1, and less than there are points.

        Returns
        -------
        (M, k) int32
            Indices in tree order, the nearest first.

        """
        which = np.ascontiguousarray(which, np.int64)
        if not (which[1:] > which[:-1]).all():
            which, inverse = np.unique(which, return_inverse=True)
            return self.nearest_of(which, k)[inverse]
        row = np.full(len(self), -1, np.int32)
        row[which] = np.arange(len(which))
        nearest = Nearest(np.empty((len(which), k), np.int32), np.empty(len(which), np.bool_))
        self._search(nearest, row)
        return nearest.index

    def _build(self) -> _Sorted:
        given = self._given
        # Two threads may both come here, and then both build the same.
        if self._sorted is None:
            order, xyz, tree = build(given, self.threads, self._allocate)
            self._sorted = _Sorted(order.astype(np.int64), xyz, tree)
            self._given = given[:0]
        return self._sorted

    def _search(self, nearest: Nearest, row: Index) -> None:
        """Write the lists of the points whose row is not negative."""
        order, xyz, tree = self._build()
        leaves = _kernels.subtrees(tree, 0)
        pool.run(
            lambda i, j: _kernels.search_nearest(xyz, tree, leaves[i:j], order, row, *nearest),
            len(leaves),
            LEAVES * len(self) // max(int(np.count_nonzero(row >= 0)), 1),
            self.threads,
        )

    def _carry_over(self, result: Neighbourhood, kept: Bools) -> Nearest:
        """Give the lists of this neighbourhood to one of fewer points, and mend them."""
        old, nearest = self.nearest(self._most), self._empty_lists(len(result), self._most)
        new_index = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
        row = np.empty(len(result), np.int32)
        self._in_threads(
            lambda i, j: _kernels.carry_over(*old, new_index, i, j, *nearest, row), self._count
        )
        result._search(nearest, row)
        return nearest

    def _squared(self, index: Index, k: int) -> Floats:
        """Return the squared distance of each point to its k-th neighbour in lists of all."""
        xyz, result = self.xyz, np.empty(self._count)
        self._in_threads(
            lambda i, j: _kernels.squared_distances(xyz, index, k, i, j, result), self._count
        )
        return result

    def _empty_lists(self, count: int, k: int) -> Nearest:
        return Nearest(self._allocate((count, k), np.int32), np.empty(count, np.bool_))

    def _in_threads(self, work: Callable[[int, int], Result], count: int) -> list[Result]:
        return pool.run(work, count, ROWS, self.threads)


def _in_multiples(xyz: Floats) -> Floats:
    """Round coordinates to multiples of ``FINEST_M``; nearly always they are, and none is copied.

    Else thousands of points might be at distance 0 from each other, and still not at one place.
    No box of the tree could hold them as one, and every search would visit all of them.
    """
    parts = (
        np.abs(xyz[begin : begin + CHECKED_POINTS]) for begin in range(0, len(xyz), CHECKED_POINTS)
    )
    if not any(((size < COARSE) & (size > 0)).any() for size in parts):
        return xyz
    return np.rint(xyz / FINEST_M) * FINEST_M
