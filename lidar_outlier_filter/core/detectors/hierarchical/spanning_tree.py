# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The Euclidean minimum spanning tree, without a triangulation: Borůvka's rounds in a kd-tree.

In each round every component so far takes the shortest edge that leads out of it (Borůvka 1926).
Points remember the nearest one of another component that they have found: until the two are of one
component nothing else can be nearer. Nodes of the kd-tree whose points are all of one component
are searched for, or skipped, as one (March, Ram and Gray, "Fast Euclidean minimum spanning tree",
2010). The tree is exact, its memory is a few numbers for each point, and its time near-linear.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.core.neighbours.tree_steps import gap, height

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Index, Ints
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood, Tree

CHUNK = 1 << 14  # points that a thread takes at once, about
MIXED = -1  # the component of a node with points of several


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


class _Search(NamedTuple):
    """What a search for the way out of components looks at; M nodes, N points, C components.

    Attributes
    ----------
    xyz : (N, 3) float64, in tree order
    tree : nodes of the kd-tree
    component : (N,) of each point, numbered from 0
    uniform : (M,) the component of all points of the node, or ``MIXED``
    height : levels of the tree

    """

    xyz: Floats
    tree: Tree
    component: Ints
    uniform: Ints
    height: int


class _Found(NamedTuple):
    """What searches have found so far.

    Attributes
    ----------
    squared : (N,) float64
        Squared distance below which the point has no other of another component.
    nearest : (N,) int64
        The nearest one of another component, exactly so far; -1: unknown.
    clear : (M,) float64
        Squared distance below which no point of the node has one.

    """

    squared: Floats
    nearest: Ints
    clear: Floats


def spanning_tree(neighbourhood: Neighbourhood, threads: int = 0) -> Edges:
    """Find the shortest edges that hold all points together.

    Lengths and the components that are left when all edges beyond a length are cut are unique, and
    so do not depend on the order of the points. Which of equally long edges is taken does.

    Parameters
    ----------
    neighbourhood : N points, at least one
    threads : as everywhere; the tree does not depend on it

    Returns
    -------
    Edges
        N - 1 of them; between coincident points their length is 0.

    """
    count, tree = len(neighbourhood), neighbourhood.tree
    component, components = np.arange(count), count
    found = _Found(np.zeros(count), np.full(count, -1), np.zeros(len(tree.child)))
    uniform = np.empty(len(tree.child), np.int64)
    search = _Search(neighbourhood.xyz, tree, component, uniform, height(tree))
    roots = _roots(tree, CHUNK)
    ends, edges = np.empty((count - 1, 2), np.int32), 0
    while components > 1:
        _label(tree, component, uniform)
        shortest = _shortest(component, found, components)

        def work(begin: int, _: int, shortest: Floats = shortest) -> None:
            _find_ways_out(search, found, roots[begin], shortest.copy())

        pool.run(work, len(roots), 1, threads)
        components, edges = _join(component, components, found, ends, edges)
    return Edges(ends, lengths(neighbourhood.xyz, ends))


@kernel
def lengths(xyz: Floats, ends: Index) -> Floats:
    """Return the lengths of edges, metres."""
    result = np.empty(len(ends))
    for edge in range(len(ends)):
        i, j = ends[edge]
        dx, dy, dz = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
        result[edge] = np.sqrt((dx * dx + dy * dy) + dz * dz)
    return result


@kernel
def _roots(tree: Tree, most: int) -> Ints:
    """Return the largest nodes of at most so many points, and leaves; together they hold all."""
    result = np.empty(len(tree.child), np.int64)
    stack = np.empty(len(tree.child), np.int64)
    stack[0], waiting, count = 0, 1, 0
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if tree.last[node] - tree.first[node] > most and tree.child[node] >= 0:
            stack[waiting], stack[waiting + 1] = tree.child[node] + 1, tree.child[node]
            waiting += 2
        else:
            result[count] = node
            count += 1
    return result[:count].copy()


@kernel
def _label(tree: Tree, component: Ints, uniform: Ints) -> None:
    """Return of each node of which component all its points are."""
    for node in range(len(tree.child) - 1, -1, -1):
        child = tree.child[node]
        if child >= 0:
            same = uniform[child] == uniform[child + 1]
            uniform[node] = uniform[child] if same else MIXED
            continue
        uniform[node] = component[tree.first[node]]
        for i in range(tree.first[node] + 1, tree.last[node]):
            if component[i] != uniform[node]:
                uniform[node] = MIXED
                break


@kernel
def _shortest(component: Ints, found: _Found, components: int) -> Floats:
    """Return of each component the shortest way out that is known, squared; inf: none.

    Of a point whose nearest has become one of its own component the way out is unknown again.
    """
    shortest = np.full(components, np.inf)
    for i in range(len(component)):
        own, j = component[i], found.nearest[i]
        if j >= 0 and component[j] == own:
            found.nearest[i] = -1
        elif j >= 0:
            shortest[own] = min(shortest[own], found.squared[i])
    return shortest


@kernel
def _find_ways_out(search: _Search, found: _Found, root: int, shortest: Floats) -> None:
    """Look, from each point below ``root`` that may have one, for a shorter way out."""
    tree = search.tree
    nodes, clears = np.empty(search.height + 2, np.int64), np.empty(search.height + 2)
    stack, gaps = np.empty(search.height + 2, np.int64), np.empty(search.height + 2)
    nodes[0], clears[0], waiting = root, 0.0, 1
    while waiting > 0:
        waiting -= 1
        node = nodes[waiting]
        clear = max(clears[waiting], found.clear[node])
        own = search.uniform[node]
        if own != MIXED:
            if clear >= shortest[own]:
                continue
            if shortest[own] < np.inf and _is_clear(search, node, own, shortest[own], stack):
                found.clear[node] = shortest[own]
                continue
        child = tree.child[node]
        if child >= 0:
            nodes[waiting], nodes[waiting + 1] = child + 1, child
            clears[waiting], clears[waiting + 1] = clear, clear
            waiting += 2
            continue
        for i in range(tree.first[node], tree.last[node]):
            own = search.component[i]
            if max(clear, found.squared[i]) < shortest[own]:
                squared, j = _nearest(search, i, own, False, shortest[own], stack, gaps)  # noqa: FBT003  numba
                found.squared[i], found.nearest[i] = squared, j
                if j >= 0 and search.uniform[node] != MIXED:
                    # The way back may be shorter: what is as short is yet to be found.
                    back, _ = _nearest(search, j, own, True, squared, stack, gaps)  # noqa: FBT003  numba
                    squared = min(squared, np.nextafter(back, np.inf))
                shortest[own] = squared


@inner_kernel
def _is_clear(search: _Search, node: int, own: int, squared: float, stack: Ints) -> bool:
    """Return whether nothing of another component is nearer to the box of a node."""
    tree = search.tree
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        other = stack[waiting]
        if search.uniform[other] == own:
            continue
        total = 0.0
        for axis in range(3):
            above = tree.low[other, axis] - tree.high[node, axis]
            below = tree.low[node, axis] - tree.high[other, axis]
            apart = max(above, below, 0.0)
            total += apart * apart
        if total >= squared:
            continue
        if search.uniform[other] != MIXED or tree.child[other] < 0:
            return False
        stack[waiting], stack[waiting + 1] = tree.child[other] + 1, tree.child[other]
        waiting += 2
    return True


@inner_kernel
def _nearest(
    search: _Search,
    i: int,
    own: int,
    within: bool,
    squared: float,
    stack: Ints,
    gaps: Floats,
) -> tuple[float, int]:
    """Find the nearest point within a component, or of another, that is nearer than given.

    -1: there is none.
    """
    xyz, tree = search.xyz, search.tree
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    here, nearest = (x, y, z, x, y, z), -1
    stack[0], gaps[0], waiting = 0, 0.0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if gaps[waiting] >= squared:
            continue
        near = tree.child[node]
        if near >= 0:
            far = near + 1
            near_gap = gap(tree, near, here) if _holds(search, near, own, within) else np.inf
            far_gap = gap(tree, far, here) if _holds(search, far, own, within) else np.inf
            if far_gap < near_gap:
                near, far, near_gap, far_gap = far, near, far_gap, near_gap
            stack[waiting], gaps[waiting] = far, far_gap
            stack[waiting + 1], gaps[waiting + 1] = near, near_gap
            waiting += 2
            continue
        least = gaps[waiting]
        for j in range(tree.first[node], tree.last[node]):
            dx, dy, dz = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
            d = (dx * dx + dy * dy) + dz * dz
            if d < squared and (search.component[j] == own) == within:
                squared, nearest = d, j
                # Of a heap of coincident points the first one does.
                if d <= least:
                    break
    return squared, nearest


@inner_kernel
def _holds(search: _Search, node: int, own: int, within: bool) -> bool:
    """Return whether a node may hold points within a component, or of another."""
    uniform = search.uniform[node]
    return bool(uniform == MIXED or (uniform == own) == within)


@kernel
def _join(
    component: Ints, components: int, found: _Found, ends: Index, edges: int
) -> tuple[int, int]:
    """Add of each component its shortest way out; return how many components and edges there are.

    Ways out that are equally long may close a ring; whichever comes last is left out.
    """
    start = np.full(components, -1)
    for i in range(len(component)):
        if found.nearest[i] >= 0:
            best = start[component[i]]
            if best < 0 or found.squared[i] < found.squared[best]:
                start[component[i]] = i
    parent = np.arange(components)
    for one in range(components):
        i, j = start[one], found.nearest[start[one]]
        a, b = _find(parent, one), _find(parent, component[j])
        if a != b:
            parent[max(a, b)] = min(a, b)
            ends[edges, 0], ends[edges, 1] = i, j
            edges += 1
    number, count = np.empty(components, np.int64), 0
    for one in range(components):
        # The parent of a component is never a later one, and so has its number already.
        if parent[one] == one:
            number[one] = count
            count += 1
        else:
            number[one] = number[parent[one]]
    for i in range(len(component)):
        component[i] = number[component[i]]
    return count, edges


@inner_kernel
def _find(parent: Ints, one: int) -> int:
    """Return the component that stands for all that ``one`` was joined with."""
    while parent[one] != one:
        parent[one] = parent[parent[one]]
        one = parent[one]
    return one
