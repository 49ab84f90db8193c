# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Walks through a kd-tree: what searches share, points within a distance, lists that are kept.

Distances are squared everywhere. The gap to a box is never more than the distance to a point in it,
not even by rounding, because both are computed alike and every operation rounds monotonically: what
is left out for a gap strictly greater than a bound could not have tied with it.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, noalias_kernel
from lidar_outlier_filter.core.neighbours.tree_build import LEAF, Tree

Bounds = tuple[float, float, float, float, float, float]  # low corner, high corner

HELD, HELD_EACH = 512, 16  # candidates that are held: so many, and so many more for each neighbour

height, leaves = _kernels.tree_height, _kernels.tree_leaves


class Buffers(NamedTuple):
    """Buffers of one thread, in rows of R.

    Attributes
    ----------
    x, y, z : (R,) float64
        Coordinates of the candidates side by side.
    found : (R,) int64
        Their indices in tree order.
    distance : (R,) float64
        Theirs from the point that is searched, squared.
    few, few_index : (R,) float64, int64
        Distances and indices of those that may be among its k nearest.
    best, best_index : (R,) float64, int64
        The same, sorted.
    nodes, gaps : (H,) int64, float64
        A stack for walks through the tree.

    """

    x: Floats
    y: Floats
    z: Floats
    found: Ints
    distance: Floats
    few: Floats
    few_index: Ints
    best: Floats
    best_index: Ints
    nodes: Ints
    gaps: Floats


@device_function
def make_buffers(k: int, levels: int) -> Buffers:
    """Make buffers for searches of k neighbours in a tree of so many levels."""
    floats = np.empty((6, HELD + HELD_EACH * k))
    ints = np.empty((3, HELD + HELD_EACH * k), np.int64)
    return Buffers(
        *(floats[0], floats[1], floats[2], ints[0], floats[3], floats[4], ints[1]),
        *(floats[5], ints[2], np.empty(levels + 1, np.int64), np.empty(levels + 1)),
    )


@noalias_kernel
def gap(tree: Tree, node: int, box: Bounds) -> float:
    """Return the squared distance between a box, which may be a point, and that of a node."""
    dx = max(tree.low[node, 0] - box[3], box[0] - tree.high[node, 0], 0.0)
    dy = max(tree.low[node, 1] - box[4], box[1] - tree.high[node, 1], 0.0)
    dz = max(tree.low[node, 2] - box[5], box[2] - tree.high[node, 2], 0.0)
    return float((dx * dx + dy * dy) + dz * dz)


@noalias_kernel
def seen(tree: Tree, leaf: int, k: int) -> int:
    """Return where the points of a leaf end that can be among anybody's k nearest, or tied.

    Where more coincide than a leaf holds, only the first: they are those of the lowest index. One
    of them may be the point that is searched, and one more says that there is a tie.
    """
    first, last = tree.first[leaf], tree.last[leaf]
    return int(last if last - first <= LEAF else min(last, first + k + 2))


@noalias_kernel
def push(tree: Tree, node: int, box: Bounds, nodes: Ints, gaps: Floats, waiting: int) -> int:
    """Put the children of a node on the stack, the nearer one on top."""
    near = tree.child[node]
    far = near + 1
    near_gap, far_gap = gap(tree, near, box), gap(tree, far, box)
    if far_gap < near_gap:
        near, far, near_gap, far_gap = far, near, far_gap, near_gap
    nodes[waiting], gaps[waiting] = far, far_gap
    nodes[waiting + 1], gaps[waiting + 1] = near, near_gap
    return waiting + 2


@noalias_kernel
def squared(xyz: Floats, p: int, q: int) -> float:
    """Return the squared distance of two points, in the order of operations of the search."""
    dx, dy, dz = xyz[p, 0] - xyz[q, 0], xyz[p, 1] - xyz[q, 1], xyz[p, 2] - xyz[q, 2]
    return float((dx * dx + dy * dy) + dz * dz)


@kernel
def tied_at(xyz: Floats, index: Index, k: int, begin: int, end: int, tied: Bools) -> None:
    """Return of a range of points where the neighbour behind the k-th is exactly as far as it."""
    for q in range(begin, end):
        tied[q] = squared(xyz, index[q, k - 1], q) == squared(xyz, index[q, k], q)


@kernel
def carry_over(
    index: Index,
    tied: Bools,
    new_index: Index,
    begin: int,
    end: int,
    index_out: Index,
    tied_out: Bools,
    row: Index,
) -> None:
    """Copy the lists of a range of points that are kept; their new indices are not negative.

    ``row`` of the others is -1. Those that held a rejected point are searched again, and those that
    were tied, because it may have been with a rejected one.
    """
    for q in range(begin, end):
        new = new_index[q]
        if new < 0:
            continue
        lost = tied[q]
        for i in range(index.shape[1]):
            other = new_index[index[q, i]]
            index_out[new, i] = other
            lost |= other < 0
        row[new], tied_out[new] = new if lost else -1, False


@kernel
def within(
    xyz: Floats, tree: Tree, levels: int, which: Ints, limits: Floats, offsets: Ints, index: Index
) -> Ints:
    """Count for each of the points ``which`` the others up to its limit, squared, and list them.

    The list of ``which[i]`` begins at ``offsets[i]``; where ``index`` ends, it ends, too.
    """
    stack, counts = np.empty(levels + 1, np.int64), np.empty(len(which), np.int64)
    for i in range(len(which)):
        room = index[offsets[i] : offsets[i + 1]]
        counts[i] = _walk(xyz, tree, stack, which[i], limits[i], room)
    return counts


@noalias_kernel
def _walk(xyz: Floats, tree: Tree, stack: Ints, q: int, limit: float, found: Index) -> int:
    """Count the points within the limit, and list as many as ``index`` holds, in their order."""
    x, y, z = xyz[q]
    box = (x, y, z, x, y, z)
    count, stack[0], waiting = 0, 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if not gap(tree, node, box) <= limit:
            continue
        if tree.child[node] >= 0:
            stack[waiting], stack[waiting + 1] = tree.child[node] + 1, tree.child[node]
            waiting += 2
            continue
        for p in range(tree.first[node], tree.last[node]):
            if p != q and squared(xyz, p, q) <= limit:
                if count < len(found):
                    found[count] = p
                count += 1
    return count


@kernel
def squared_distances(xyz: Floats, others: Index, begin: int, end: int, result: Floats) -> None:
    """Write the squared distance of each of a range of points to another one, m²."""
    for p in range(begin, end):
        result[p] = squared(xyz, p, others[p])


@kernel
def copies(order: Ints, xyz: Floats, tree: Tree, these: Ints) -> Ints:
    """List, as given, points of successive leaves at the place of an earlier one, and that."""
    found = np.empty((tree.last[these[-1]] - tree.first[these[0]], 2), np.int64)
    count = 0
    for leaf in these:
        first = tree.first[leaf]
        for p in range(first + 1, tree.last[leaf]):
            q = first
            while q < p and squared(xyz, p, q) > 0:
                q += 1
            if q < p:
                found[count, 0], found[count, 1] = order[p], order[q]
                count += 1
    return found[:count].copy()
