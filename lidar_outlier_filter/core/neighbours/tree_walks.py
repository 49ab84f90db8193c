# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points of a kd-tree within a distance, and lists that are kept when points are removed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import kernel, noalias_kernel
from lidar_outlier_filter.core.neighbours.tree_steps import gap

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints
    from lidar_outlier_filter.core.neighbours.tree_build import Tree


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
