# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A kd-tree over points in space, in whose order near points lie together in memory.

A node is cut in the middle of the longest side of its box. The box is tight, so neither part is
empty, and points that are far from all others are cut off first (the sliding midpoint of
Maneewongvatana and Mount, "It's okay to be skinny, if your friends are fat", 1999).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Allocate, Floats, Index, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, median

LEAF = 24  # points
SUBTREE = 1 << 15  # points that are sorted at one go, by one thread in its own cache
LOPSIDED = 16  # a cut that leaves less than 1/16 of the points on one side
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

    points: tuple[Floats, Floats]
    indices: tuple[Index, Index]


class _Part(NamedTuple):
    """A node that is still to be cut; its points are here, in buffer 0 or 1."""

    node: int
    first: int
    last: int
    here: int
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
    buffers = _Buffers((points, allocate(xyz.shape, np.float64)), (index, np.empty_like(index)))
    nodes, parts = _divide(buffers, threads)

    def grow(which: int, _: int) -> Tree:
        return _grow(buffers, *parts[which][1:])

    tree = _join(nodes, parts, pool.run(grow, len(parts), 1, threads))
    return index, points, tree


def _divide(buffers: _Buffers, threads: int) -> tuple[list[list[int]], list[_Part]]:
    """Cut level by level, all nodes of one at once, down to parts for one thread each.

    Returns the rows first, last, child of the nodes, and those that are such parts.
    """
    nodes = [[0, len(buffers.points[0]), -1]]
    parts: list[_Part] = []
    level = [_Part(0, 0, len(buffers.points[0]), 0, MAX_LOPSIDED_CUTS)]
    while level:
        large = [part for part in level if part.last - part.first > SUBTREE]
        parts += [part for part in level if part.last - part.first <= SUBTREE]
        level = []

        def halve(which: int, _: int, large: list[_Part] = large) -> tuple[int, int]:
            return _halve(buffers, *large[which][1:])

        halves = pool.run(halve, len(large), 1, threads)
        for part, (middle, patience) in zip(large, halves, strict=True):
            if middle == part.first:  # all its points coincide
                parts.append(part)
                continue
            nodes[part.node][2] = len(nodes)
            for first, last in ((part.first, middle), (middle, part.last)):
                level.append(_Part(len(nodes), first, last, 1 - part.here, patience))
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
    return Tree(
        np.concatenate([tree.low for tree in trees]),
        np.concatenate([tree.high for tree in trees]),
        np.concatenate([tree.first for tree in trees]),
        np.concatenate([tree.last for tree in trees]),
        np.concatenate([tree.child for tree in trees]),
    )


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
    return _prune(tree, before[tree.first], before[tree.last], xyz)


@kernel
def _prune(tree: Tree, tree_first: Ints, tree_last: Ints, xyz: Floats) -> Tree:
    most = len(tree.child)
    low, high, first, last, child = _empty_tree(most)
    old, stack = np.empty(most, np.int64), np.empty(most, np.int64)
    count, old[0], stack[0], waiting = 1, 0, 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        was = old[node]
        # A node with an empty child gives way to its other child.
        while tree.child[was] >= 0 and tree_last[was] - tree_first[was] > LEAF:
            one, other = tree.child[was], tree.child[was] + 1
            if tree_first[one] < tree_last[one] and tree_first[other] < tree_last[other]:
                break
            was = one if tree_first[one] < tree_last[one] else other
        first[node], last[node], child[node] = tree_first[was], tree_last[was], -1
        if tree.child[was] >= 0 and last[node] - first[node] > LEAF:
            child[node] = count
            for side in range(2):
                old[count], stack[waiting] = tree.child[was] + side, count
                count, waiting = count + 1, waiting + 1
    for node in range(count - 1, -1, -1):
        if child[node] < 0:
            _bound(xyz, first[node], last[node], low[node], high[node])
        else:
            for axis in range(3):
                one = child[node]
                low[node, axis] = min(low[one, axis], low[one + 1, axis])
                high[node, axis] = max(high[one, axis], high[one + 1, axis])
    return _trimmed(Tree(low, high, first, last, child), count)


@device_function
def _empty_tree(nodes: int) -> Tree:
    ints = np.empty((3, nodes), np.int64)
    return Tree(np.empty((nodes, 3)), np.empty((nodes, 3)), ints[0], ints[1], ints[2])


@device_function
def _trimmed(tree: Tree, count: int) -> Tree:
    """Copy the nodes that have been made, and let go of the memory for more."""
    return Tree(
        *(tree.low[:count].copy(), tree.high[:count].copy()),
        *(tree.first[:count].copy(), tree.last[:count].copy(), tree.child[:count].copy()),
    )


@kernel
def _halve(buffers: _Buffers, first: int, last: int, here: int, patience: int) -> tuple[int, int]:
    """Cut a node: move its points to the other buffer, each part in its order.

    Returns where the second part begins – at ``first``, and nothing is moved, where all points
    coincide – and the patience that is left.
    """
    low, high = np.empty(3), np.empty(3)
    _bound(buffers.points[here], first, last, low, high)
    return _cut(buffers, first, last, here, low, high, patience)


@device_function
def _bound(points: Floats, first: int, last: int, low: Floats, high: Floats) -> None:
    """Find the smallest box around points."""
    x0 = y0 = z0 = np.inf
    x1 = y1 = z1 = -np.inf
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    low[0], low[1], low[2] = x0, y0, z0
    high[0], high[1], high[2] = x1, y1, z1


@device_function
def _cut(
    buffers: _Buffers, first: int, last: int, here: int, low: Floats, high: Floats, patience: int
) -> tuple[int, int]:
    """Do what :func:`_halve` does, with the box known."""
    points, index = buffers.points[here], buffers.indices[here]
    points_out, index_out = buffers.points[1 - here], buffers.indices[1 - here]
    axis = 0
    for other in (1, 2):
        if high[other] - low[other] > high[axis] - low[axis]:
            axis = other
    if low[axis] == high[axis]:
        return first, patience
    # Halved first, lest the sum overflow; rounded down to `low`, it would leave nothing below.
    cut = 0.5 * low[axis] + 0.5 * high[axis]
    if cut <= low[axis]:
        cut = high[axis]
    left = _count_below(points, first, last, axis, cut)
    if LOPSIDED * min(left, last - first - left) < last - first:
        if patience > 0:
            patience -= 1
        else:
            cut = _middle(points, first, last, axis, low[axis])
            left = _count_below(points, first, last, axis, cut)
    middle = first + left
    # Without a branch, which could not be predicted; unsigned, lest numba check for negatives.
    below, above = first, middle
    column = points[:, axis]
    for i in range(first, last):
        is_below = int(column[i] < cut)
        source, target = np.uint64(i), np.uint64(above + ((below - above) & -is_below))
        points_out[target, 0] = points[source, 0]
        points_out[target, 1] = points[source, 1]
        points_out[target, 2] = points[source, 2]
        index_out[target] = index[source]
        below += is_below
        above += 1 - is_below
    return middle, patience


@device_function
def _count_below(points: Floats, first: int, last: int, axis: int, cut: float) -> int:
    count = 0
    for i in range(first, last):
        count += points[i, axis] < cut
    return count


@device_function
def _middle(points: Floats, first: int, last: int, axis: int, low: float) -> float:
    """Find a cut at the median, or right above the lowest points if they are more than half."""
    cut = median(points[first:last, axis].copy(), last - first)
    if cut > low:
        return cut
    cut = np.inf
    for i in range(first, last):
        value = points[i, axis]
        if low < value < cut:
            cut = value
    return cut


@kernel
def _grow(buffers: _Buffers, begin: int, end: int, here: int, patience: int) -> Tree:
    """Cut points down to leaves, which end up in the first buffer."""
    most = 2 * (end - begin) + 1
    low, high, first, last, child = _empty_tree(most)
    where, left = np.empty(most, np.int64), np.empty(most, np.int64)  # buffer, patience
    stack = np.empty(most, np.int64)
    first[0], last[0], where[0], left[0] = begin, end, here, patience
    count, stack[0], waiting = 1, 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        i, j, here = first[node], last[node], where[node]
        _bound(buffers.points[here], i, j, low[node], high[node])
        middle = i
        if j - i > LEAF:
            middle, left[node] = _cut(buffers, i, j, here, low[node], high[node], left[node])
        if middle == i:
            child[node] = -1
            if here == 1:
                # One by one: for slices numba compiles the text of an error about their shapes.
                for m in range(i, j):
                    buffers.indices[0][m] = buffers.indices[1][m]
                    for axis in range(3):
                        buffers.points[0][m, axis] = buffers.points[1][m, axis]
            continue
        child[node] = count
        for side in range(2):
            first[count], last[count] = (i, middle) if side == 0 else (middle, j)
            where[count], left[count] = 1 - here, left[node]
            stack[waiting] = count
            count, waiting = count + 1, waiting + 1
    return _trimmed(Tree(low, high, first, last, child), count)
