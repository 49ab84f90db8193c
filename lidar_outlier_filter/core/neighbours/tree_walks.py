# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Distances to boxes and points of a kd-tree.

Distances are squared everywhere. The gap to a box is never more than the distance to a point in it,
not even by rounding, because both are computed alike and every operation rounds monotonically: what
is left out for a gap strictly greater than a bound could not have tied with it.
"""

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.kernels.kernels import noalias_kernel
from lidar_outlier_filter.core.neighbours.tree_build import Tree

Bounds = tuple[float, float, float, float, float, float]  # low corner, high corner

height, leaves = _kernels.tree_height, _kernels.tree_leaves


@noalias_kernel
def gap(tree: Tree, node: int, box: Bounds) -> float:
    """Return the squared distance between a box, which may be a point, and that of a node."""
    dx = max(tree.low[node, 0] - box[3], box[0] - tree.high[node, 0], 0.0)
    dy = max(tree.low[node, 1] - box[4], box[1] - tree.high[node, 1], 0.0)
    dz = max(tree.low[node, 2] - box[5], box[2] - tree.high[node, 2], 0.0)
    return float((dx * dx + dy * dy) + dz * dz)


@noalias_kernel
def squared(xyz: Floats, p: int, q: int) -> float:
    """Return the squared distance of two points, in the order of operations of the search."""
    dx, dy, dz = xyz[p, 0] - xyz[q, 0], xyz[p, 1] - xyz[q, 1], xyz[p, 2] - xyz[q, 2]
    return float((dx * dx + dy * dy) + dz * dz)
