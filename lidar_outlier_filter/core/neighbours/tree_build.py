# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A kd-tree over points in space, in whose order near points lie together in memory.

A node is cut in the middle of the longest side of its box. The box is tight, so neither part is
empty, and points that are far from all others are cut off first (the sliding midpoint of
Maneewongvatana and Mount, "It's okay to be skinny, if your friends are fat", 1999).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Allocate, Floats, Index, Ints
from lidar_outlier_filter.core.kernels import threads as pool

LEAF = _kernels.LEAF  # points
SUBTREE = 1 << 15  # points that are sorted at one go, by one thread in its own cache
MAX_LOPSIDED_CUTS = 16  # lopsided cuts on the way to a node; then it is cut at the median


class Tree(NamedTuple):
    """The M nodes of a kd-tree over N points in tree order.

    Node 0 is the root, and children come after their parents.

    Attributes
    ----------
    low, high : (M, 3) float64
        Corners of the smallest box around the points of the node, metres. Where there are no points
        at all, +inf and -inf.
    first, last : (M,) int64
        The points of the node: from ``first`` up to, not including, ``last``.
    child : (M,) int64
        The left child, whose points come first; the right one is the next node. -1 for a leaf. A
        leaf has at most 24 points, or more that all coincide.

    """

    low: Floats
    high: Floats
    first: Ints
    last: Ints
    child: Ints


class _Buffers(NamedTuple):
    """Points are moved to and fro between two buffers, their indices with them."""

    points: Floats
    spare_points: Floats
    indices: Index
    spare_indices: Index


class _Part(NamedTuple):
    """A node that is still to be cut; its points are in the first buffer, or in the spare one."""

    node: int
    first: int
    last: int
    in_spare: bool
    patience: int


def build(
    xyz: Floats, threads: int = 0, allocate: Allocate = np.empty
) -> tuple[Index, Floats, Tree]:
    """Sort points into a tree.

    Parameters
    ----------
    xyz : (N, 3) float64
        Finite, metres.
    threads : int
        0 for all cores; the tree does not depend on it.
    allocate : callable
        Returns arrays, in memory or in files.

    Returns
    -------
    order : (N,) int32
        Indices of the points in tree order; ascending within a leaf.
    xyz : (N, 3) float64
        The points in tree order.
    tree : Tree
        The nodes.

    """
    index, points = np.arange(len(xyz), dtype=np.int32), allocate(xyz.shape, np.float64)
    points[:] = xyz
    buffers = _Buffers(points, allocate(xyz.shape, np.float64), index, np.empty_like(index))
    nodes, parts = _divide(buffers, threads)

    def grow(which: int, _: int) -> Tree:
        return Tree(*_kernels.grow_tree(buffers, *parts[which][1:]))

    tree = _join(nodes, parts, pool.run(grow, len(parts), 1, threads))
    return index, points, tree


def _divide(buffers: _Buffers, threads: int) -> tuple[list[list[int]], list[_Part]]:
    """Cut level by level, all nodes of one at once, down to parts for one thread each.

    Returns the rows first, last, child of the nodes, and those that are such parts.
    """
    nodes = [[0, len(buffers.points), -1]]
    parts: list[_Part] = []
    level = [_Part(0, 0, len(buffers.points), False, MAX_LOPSIDED_CUTS)]  # noqa: FBT003
    while level:
        large = [part for part in level if part.last - part.first > SUBTREE]
        parts += [part for part in level if part.last - part.first <= SUBTREE]
        level = []

        def halve(which: int, _: int, large: list[_Part] = large) -> tuple[int, int]:
            return _kernels.halve_node(buffers, *large[which][1:])

        halves = pool.run(halve, len(large), 1, threads)
        for part, (middle, patience) in zip(large, halves, strict=True):
            if middle == part.first:  # all its points coincide
                parts.append(part)
                continue
            nodes[part.node][2] = len(nodes)
            for first, last in ((part.first, middle), (middle, part.last)):
                level.append(_Part(len(nodes), first, last, not part.in_spare, patience))
                nodes.append([first, last, -1])
    return nodes, parts


def _join(nodes: list[list[int]], parts: list[_Part], subtrees: list[Tree]) -> Tree:
    """Hang subtrees into the nodes that are their roots."""
    first, last, child = np.array(nodes, np.int64).T.copy()
    low, high = np.empty((len(child), 3)), np.empty((len(child), 3))
    trees = [Tree(low, high, first, last, child)]
    total = len(child)
    for part, tree in zip(parts, subtrees, strict=True):
        # The root of a subtree is there already: its other nodes move up by one.
        down = np.where(tree.child < 0, -1, tree.child + (total - 1))
        low[part.node], high[part.node], child[part.node] = tree.low[0], tree.high[0], down[0]
        trees.append(Tree(tree.low[1:], tree.high[1:], tree.first[1:], tree.last[1:], down[1:]))
        total += len(down) - 1
    for node in range(len(nodes) - 1, -1, -1):
        one = nodes[node][2]
        if one >= 0:
            low[node] = np.minimum(low[one], low[one + 1])
            high[node] = np.maximum(high[one], high[one + 1])
    joined = Tree(
        np.concatenate([tree.low for tree in trees]),
        np.concatenate([tree.high for tree in trees]),
        np.concatenate([tree.first for tree in trees]),
        np.concatenate([tree.last for tree in trees]),
        np.concatenate([tree.child for tree in trees]),
    )
    return _kept(joined)


def prune(tree: Tree, kept: NDArray[np.bool_], xyz: Floats) -> Tree:
    """Take points out of a tree.

    Parameters
    ----------
    tree : Tree
        Of N points.
    kept : (N,) bool
        In tree order.
    xyz : (M, 3) float64
        The points that are kept, in tree order.

    Returns
    -------
    Tree
        Without empty nodes, with tight boxes, and no node of 24 points or less divided.

    """
    before = np.concatenate([[0], np.cumsum(kept)])
    return _kept(Tree(*_kernels.prune_tree(tree, before[tree.first], before[tree.last], xyz)))


def _kept(tree: Tree) -> Tree:
    """Return a tree that is checked, once for all searches: nobody can write into its arrays."""
    return Tree(*_kernels.keep_tree(tree))
