# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The Gabriel graph, without a triangulation (Gabriel and Sokal 1969; Sotoodeh 2007, section 3.2).

Two points have an edge if the ball between them, of which their distance is the diameter, has no
other point inside: if none sees the two at an obtuse angle. So with r another point, q has no edge
to p if (r - p)·(r - q) < 0: if it is beyond the plane through r at a right angle to p - r. The
planes of the points around p leave only a small region, Voronoi's cell of p twice as large, and
nodes of a kd-tree beyond one of them hold no candidates. The few that are left are tested with all
points that the ball may hold. This makes the graph exact; its memory are its edges, and its
time is near-linear for points that lie on surfaces.

Points on the ball do not count: the ball is open, as in the paper. On a grid both diagonals of a
square are edges, so that the graph is unique, but not part of any one Delaunay triangulation.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Index, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import kernel, noalias_kernel
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood, Tree
from lidar_outlier_filter.core.neighbours.tree_walks import gap, height

CHUNK = 2048  # points that a thread takes at once
PLANES = 64  # most that are kept for a point: those of the nearest candidates
MANY = 256  # candidates: more have their planes among the points before, too
SLACK = 1e-14  # of a product of lengths, or of a coordinate: more than its rounding


class Edges(NamedTuple):
    """E edges between N points.

    Attributes
    ----------
    ends : (E, 2) int32
        The points, in tree order.
    length : (E,) float64
        Metres.

    """

    ends: Index
    length: Floats


def gabriel_graph(neighbourhood: Neighbourhood, threads: int = 0) -> Edges:
    """Find all pairs of points with nothing inside the ball between them.

    Parameters
    ----------
    neighbourhood : N points, no two of which coincide
    threads : as everywhere; the graph does not depend on it

    Returns
    -------
    Edges
        In no particular order, but always in the same.

    """
    xyz, tree = neighbourhood.xyz, neighbourhood.tree
    levels = height(tree)

    def work(begin: int, end: int) -> Index:
        return _edges(xyz, tree, levels, begin, end)

    ends = np.concatenate(pool.run(work, len(neighbourhood), CHUNK, threads))
    return Edges(ends, _lengths(xyz, ends))


@kernel
def _lengths(xyz: Floats, ends: Index) -> Floats:
    """Return the lengths of edges, metres."""
    result = np.empty(len(ends))
    for edge in range(len(ends)):
        i, j = ends[edge]
        dx, dy, dz = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
        result[edge] = np.sqrt((dx * dx + dy * dy) + dz * dz)
    return result


@kernel
def _edges(xyz: Floats, tree: Tree, levels: int, begin: int, end: int) -> Index:
    """Find the edges from points ``begin`` to ``end`` to points behind them in tree order."""
    ends, count = np.empty((4 * (end - begin) + 16, 2), np.int32), 0
    # Used again for every point: nodes that wait; planes; points in front of all planes so far.
    # A plane: x, y, z of its point less those of the tested one; their product with themselves;
    # x, y, z of the point; its distance from the tested one.
    stack, planes = np.empty(levels + 2, np.int64), np.empty((PLANES, 8))
    candidates = np.empty(len(xyz), np.int32)
    for p in range(begin, end):
        found, kept = _find_candidates(xyz, tree, p, False, stack, planes, candidates)  # noqa: FBT003  numba
        if found > MANY:
            found, kept = _find_candidates(xyz, tree, p, True, stack, planes, candidates)  # noqa: FBT003  numba
        for c in range(found):
            q = candidates[c]
            # The point's own plane leaves it alone: r - q is zero.
            if _is_beyond(planes, kept, xyz[q, 0], xyz[q, 1], xyz[q, 2]):
                continue
            if not _is_empty(xyz, tree, p, q, stack):
                continue
            if count == len(ends):
                larger = np.empty((2 * count, 2), np.int32)
                larger[:count] = ends
                ends = larger
            ends[count, 0], ends[count, 1] = p, q
            count += 1
    return ends[:count].copy()


@noalias_kernel
def _find_candidates(
    xyz: Floats, tree: Tree, p: int, before: bool, stack: Ints, planes: Floats, candidates: Index
) -> tuple[int, int]:
    """Gather points behind p in tree order that no plane hides; return how many, and the planes.

    The planes of the points behind p mostly do. Where they leave many, as on a circle with points
    on its axis, those ``before`` p hide the most. Without them the search ends at ``MANY``.
    """
    x, y, z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
    here, found, kept = (x, y, z, x, y, z), 0, 0
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if not before and (found > MANY or tree.last[node] <= p + 1):
            continue
        if _is_hidden(tree, node, planes, kept, x, y, z):
            continue
        near = tree.child[node]
        if near >= 0:
            far = near + 1
            # The nearer one first: its points make better planes.
            if gap(tree, far, here) < gap(tree, near, here):
                near, far = far, near
            stack[waiting], stack[waiting + 1] = far, near
            waiting += 2
            continue
        for q in range(tree.first[node], tree.last[node]):
            u, v, w = xyz[q, 0], xyz[q, 1], xyz[q, 2]
            if q == p or _is_beyond(planes, kept, u, v, w):
                continue
            if q > p:
                candidates[found] = q
                found += 1
            kept = _add_plane(planes, kept, x, y, z, u, v, w)
    return found, kept


@noalias_kernel
def _is_hidden(
    tree: Tree, node: int, planes: Floats, kept: int, x: float, y: float, z: float
) -> bool:
    """Return whether the whole box of a node is beyond one of the planes."""
    low, high = tree.low[node], tree.high[node]
    # To the farthest corner: what a product with it is rounded by goes with its length.
    reach = max(abs(low[0] - x), abs(high[0] - x)) + max(abs(low[1] - y), abs(high[1] - y))
    reach += max(abs(low[2] - z), abs(high[2] - z))
    for k in range(kept):
        a, b, c = planes[k, 0], planes[k, 1], planes[k, 2]
        u = low[0] if a > 0 else high[0]
        v = low[1] if b > 0 else high[1]
        w = low[2] if c > 0 else high[2]
        slack = SLACK * planes[k, 7] * (reach + planes[k, 7])
        if (a * (u - x) + b * (v - y)) + c * (w - z) > planes[k, 3] + slack:
            return True
    return False


@noalias_kernel
def _is_beyond(planes: Floats, kept: int, u: float, v: float, w: float) -> bool:
    """Return whether a point is beyond one of the planes: whether its point is inside the ball."""
    for k in range(kept):
        a, b, c = planes[k, 0], planes[k, 1], planes[k, 2]
        if (a * (planes[k, 4] - u) + b * (planes[k, 5] - v)) + c * (planes[k, 6] - w) < 0:
            return True
    return False


@noalias_kernel
def _add_plane(
    planes: Floats, kept: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> int:
    """Sort the plane of (u, v, w), seen from (x, y, z), in by its distance; return how many."""
    a, b, c = u - x, v - y, w - z
    squared = (a * a + b * b) + c * c
    k = kept
    if kept == PLANES:
        if planes[kept - 1, 3] <= squared:
            return kept
        k = kept - 1
    while k > 0 and planes[k - 1, 3] > squared:
        for column in range(8):
            planes[k, column] = planes[k - 1, column]
        k -= 1
    planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3] = a, b, c, squared
    planes[k, 4], planes[k, 5], planes[k, 6], planes[k, 7] = u, v, w, np.sqrt(squared)
    return min(kept + 1, PLANES)


@noalias_kernel
def _is_empty(xyz: Floats, tree: Tree, p: int, q: int, stack: Ints) -> bool:
    """Return whether no point is inside the ball between p and q."""
    px, py, pz = xyz[p, 0], xyz[p, 1], xyz[p, 2]
    qx, qy, qz = xyz[q, 0], xyz[q, 1], xyz[q, 2]
    x, y, z = 0.5 * (px + qx), 0.5 * (py + qy), 0.5 * (pz + qz)
    here = (x, y, z, x, y, z)
    dx, dy, dz = qx - px, qy - py, qz - pz
    squared = 0.25 * ((dx * dx + dy * dy) + dz * dz)
    # The middle is rounded as the coordinates are, which may be far off.
    slack = SLACK * (abs(px) + abs(py) + abs(pz) + abs(qx) + abs(qy) + abs(qz))
    reach = squared + slack * (np.sqrt(squared) + slack)
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        near = tree.child[node]
        if near >= 0:
            far = near + 1
            near_gap, far_gap = gap(tree, near, here), gap(tree, far, here)
            if far_gap < near_gap:
                near, far, near_gap, far_gap = far, near, far_gap, near_gap
            if far_gap < reach:
                stack[waiting] = far
                waiting += 1
            if near_gap < reach:
                stack[waiting] = near
                waiting += 1
            continue
        for r in range(tree.first[node], tree.last[node]):
            u, v, w = xyz[r, 0], xyz[r, 1], xyz[r, 2]
            if ((px - u) * (qx - u) + (py - v) * (qy - v)) + (pz - w) * (qz - w) < 0:
                return False
    return True
