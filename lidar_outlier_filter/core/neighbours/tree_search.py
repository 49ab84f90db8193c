# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The k nearest neighbours of points of a kd-tree, exactly, ties included.

The points of a leaf are near each other, so they are searched together: all points within a guessed
reach of the leaf's box are copied side by side, and each of its points takes the k nearest of them
without a branch for each distance, several at a stroke of the processor. Where a point finds fewer
than k within the reach, it has found an upper bound of its own, and is searched again with that.

Distances are squared everywhere.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints
from lidar_outlier_filter.core.kernels.kernels import kernel, noalias_kernel
from lidar_outlier_filter.core.neighbours.tree_build import LEAF, Tree
from lidar_outlier_filter.core.neighbours.tree_walks import (
    Bounds,
    Buffers,
    gap,
    make_buffers,
    push,
    seen,
)

# What to expect of the next leaf: the mean distance of the k-th neighbours in the last one, times
# this; and of the next point: the last one's, times that.
REACH = 1.3
GUESS = 1.15
ROUNDS = 6  # of growing a reach that was much too short
STROKE = 16  # distances are padded with inf to a multiple of it: loops without a remainder
SURPLUS = 12  # distances that may be sorted although they are not among the k smallest
STEPS = 16  # towards the limit; ties may make it impossible
RANKED = 128  # up to here counting smaller ones is faster than to sort


class Lists(NamedTuple):
    """The lists of neighbours that are written, and what sorts them.

    Attributes
    ----------
    order : (N,) int64
        The index, as given, of each point in tree order.
    row : (N,) int32
        Where in ``index`` and ``tied`` the list of each point is; negative: it is not searched.
    index : (M, k) int32
    tied : (M,) bool
        Whether another point, not in the list, is exactly as far as the k-th.

    """

    order: Ints
    row: Index
    index: Index  # type: ignore[assignment]  # nobody misses that of tuples
    tied: Bools


@kernel
def search(xyz: Floats, tree: Tree, these: Ints, levels: int, lists: Lists) -> None:
    """Write the lists of the points in the leaves ``these``."""
    buffers, queries = make_buffers(lists.index.shape[1], levels), np.empty(LEAF, np.int64)
    reach = guess = 0.0
    for leaf in these:
        # Only where all coincide there is more than one batch.
        for begin in range(tree.first[leaf], tree.last[leaf], LEAF):
            count = _pick(lists.row, begin, min(begin + LEAF, tree.last[leaf]), queries)
            if count > 0:
                reach, guess = _batch(xyz, tree, leaf, queries, count, reach, guess, buffers, lists)


@noalias_kernel
def _pick(row: Index, begin: int, end: int, queries: Ints) -> int:
    """List the points of a range that are searched, and return how many there are."""
    count = 0
    for q in range(begin, end):
        queries[count] = q
        count += row[q] >= 0
    return count


@noalias_kernel
def _batch(
    xyz: Floats,
    tree: Tree,
    leaf: int,
    queries: Ints,
    count: int,
    reach: float,
    guess: float,
    buffers: Buffers,
    lists: Lists,
) -> tuple[float, float]:
    """Search points of one leaf; return what to guess for the next: its reach, and a distance."""
    k = lists.index.shape[1]
    total, done = 0.0, count
    for _ in range(ROUNDS):
        box = _around(xyz, queries, count)
        if reach == 0:
            dx, dy, dz = box[3] - box[0], box[4] - box[1], box[5] - box[2]
            reach = ((dx * dx + dy * dy) + dz * dz) / 4
        near, own = _collect(xyz, tree, leaf, box, reach, k, buffers)
        if near < 0:
            break
        if near <= k:
            reach *= 4
            continue
        shift = own - tree.first[leaf]
        count, reach, guess, found = _round(
            xyz, queries, count, near, shift, reach, guess, buffers, lists
        )
        total += found
        if count == 0:
            return REACH * total / done, guess
    # Too many or too few points around: the box is too large, or the guess was a bad one.
    for i in range(count):
        few = _alone(xyz, lists.order, tree, queries[i], k, buffers)
        _write(queries[i], few, buffers, lists)
    return 0.0, guess


@noalias_kernel
def _round(
    xyz: Floats,
    queries: Ints,
    count: int,
    near: int,
    shift: int,
    reach: float,
    guess: float,
    buffers: Buffers,
    lists: Lists,
) -> tuple[int, float, float, float]:
    """Search points among all candidates within reach; point q is candidate q + shift, if any.

    Those that find too few are gathered at the begin of ``queries``. Returns how many they are, the
    reach that they need, the distance guessed for the next point, and the sum of those found.
    """
    # Once, because every time that an array is taken from a tuple its references are counted.
    order, row, index, tied = lists
    k, size = index.shape[1], padded(near)
    x, y, z, found, distance, few, few_index, best, best_index, _, _ = buffers
    left, further, total = 0, 0.0, 0.0
    for i in range(count):
        q = queries[i]
        _measure(x, y, z, xyz[q, 0], xyz[q, 1], xyz[q, 2], distance, size)
        own = q + shift
        if own < near and found[own] == q:
            distance[own] = np.inf
        within = count_up_to(distance, size, reach)
        if within < k:
            queries[left] = q
            left += 1
            further = max(further, enough(distance, near, k, reach))
            continue
        limit = tighten(distance, size, k, guess, reach, within)
        chosen = choose(distance, found, near, limit, few, few_index)
        sort(order, few, few_index, chosen, best, best_index)
        r = row[q]
        for j in range(k):
            index[r, j] = best_index[j]
        tied[r] = chosen > k and best[k] == best[k - 1]
        guess = GUESS * best[k - 1]
        total += best[k - 1]
    return left, further, guess, total


@noalias_kernel
def _around(xyz: Floats, queries: Ints, count: int) -> Bounds:
    """Return the box around some points."""
    x0 = y0 = z0 = np.inf
    x1 = y1 = z1 = -np.inf
    for i in range(count):
        x, y, z = xyz[queries[i]]
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    return x0, y0, z0, x1, y1, z1


@noalias_kernel
def _collect(
    xyz: Floats, tree: Tree, home: int, box: Bounds, reach: float, k: int, buffers: Buffers
) -> tuple[int, int]:
    """Copy the points of all leaves within reach of the box side by side.

    Returns how many there are, or -1 if they are too many to be held; and which is the first of
    the leaf ``home``.
    """
    x, y, z, found, stack = buffers.x, buffers.y, buffers.z, buffers.found, buffers.nodes
    count = own = 0
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if gap(tree, node, box) > reach:
            continue
        child = tree.child[node]
        if child >= 0:
            stack[waiting], stack[waiting + 1] = child + 1, child
            waiting += 2
            continue
        first, last = tree.first[node], seen(tree, node, k)
        if count + (last - first) + STROKE > len(found):
            return -1, 0
        if node == home:
            own = count
        for p in range(first, last):
            x[count], y[count], z[count] = xyz[p, 0], xyz[p, 1], xyz[p, 2]
            found[count] = p
            # Without a branch. All points of the leaf itself stay, so that each finds itself.
            count += node == home or _beside(xyz[p, 0], xyz[p, 1], xyz[p, 2], box) <= reach
    for i in range(count, padded(count)):
        x[i] = y[i] = z[i] = np.inf
    return count, own


@noalias_kernel
def _beside(x: float, y: float, z: float, box: Bounds) -> float:
    """Return the squared distance of a point and a box, computed as :func:`gap` does."""
    dx = max(x - box[3], box[0] - x, 0.0)
    dy = max(y - box[4], box[1] - y, 0.0)
    dz = max(z - box[5], box[2] - z, 0.0)
    return float((dx * dx + dy * dy) + dz * dz)


@noalias_kernel
def _measure(
    near_x: Floats,
    near_y: Floats,
    near_z: Floats,
    x: float,
    y: float,
    z: float,
    distance: Floats,
    size: int,
) -> None:
    for i in range(size):
        dx, dy, dz = near_x[i] - x, near_y[i] - y, near_z[i] - z
        distance[i] = (dx * dx + dy * dy) + dz * dz


@noalias_kernel
def _alone(xyz: Floats, order: Ints, tree: Tree, q: int, k: int, buffers: Buffers) -> int:
    """Find the few candidates of point q by going through the tree from near to far."""
    x, y, z = xyz[q]
    box = (x, y, z, x, y, z)
    few, few_index, nodes, gaps = buffers.few, buffers.few_index, buffers.nodes, buffers.gaps
    # 0, but no literal one, for which numba would compile all that is called with it once more.
    count = int(tree.first[0])
    bound, full = np.inf, 2 * k + LEAF
    nodes[0], gaps[0], waiting = 0, 0.0, 1
    while waiting > 0:
        waiting -= 1
        node = nodes[waiting]
        if gaps[waiting] > bound:
            continue
        if tree.child[node] >= 0:
            waiting = push(tree, node, box, nodes, gaps, waiting)
            continue
        for p in range(tree.first[node], seen(tree, node, k)):
            dx, dy, dz = xyz[p, 0] - x, xyz[p, 1] - y, xyz[p, 2] - z
            few[count], few_index[count] = (dx * dx + dy * dy) + dz * dz, p
            count += few[count] <= bound and p != q
        if count > full:
            count, bound = _shorten(order, count, k, buffers)
            full = 2 * count + LEAF
    if count > k + SURPLUS:
        count, bound = _shorten(order, count, k, buffers)
    return count


@noalias_kernel
def _shorten(order: Ints, count: int, k: int, buffers: Buffers) -> tuple[int, float]:
    """Drop candidates that cannot be among the k nearest; return how many are left, and a bound."""
    few, few_index = buffers.few, buffers.few_index
    best, best_index = buffers.best, buffers.best_index
    farthest = 0.0
    for i in range(count):
        farthest = max(farthest, few[i])
    limit = tighten(few, count, k, 0.0, farthest, count)
    kept = choose(few, few_index, count, limit, best, best_index)
    for i in range(kept):
        few[i], few_index[i] = best[i], best_index[i]
    if kept > len(few) // 4:
        # So many are tied; one behind the k-th is enough to decide.
        sort(order, few, few_index, kept, best, best_index)
        kept = k + 1
        for i in range(kept):
            few[i], few_index[i] = best[i], best_index[i]
        limit = few[k - 1]
    return kept, limit


@noalias_kernel
def _write(q: int, few: int, buffers: Buffers, lists: Lists) -> None:
    """Write the row of a point: the first k of its few candidates."""
    order, row, index, tied = lists
    k, best, best_index, r = index.shape[1], buffers.best, buffers.best_index, row[q]
    sort(order, buffers.few, buffers.few_index, few, best, best_index)
    for i in range(k):
        index[r, i] = best_index[i]
    tied[r] = few > k and best[k] == best[k - 1]


# The k smallest of some hundred distances, without branches that nobody could predict ------------
#
# First a limit is found that has at least k of them, and not many more, below it: counting is what
# a processor does fastest, several at a stroke. Then the few below are sorted, by counting again.


@kernel
def padded(count: int) -> int:
    """Round up to whole strokes."""
    return (count + STROKE - 1) // STROKE * STROKE


@kernel
def count_up_to(distance: Floats, size: int, limit: float) -> int:
    """Count those of the first ``size`` distances that are not greater than the limit."""
    count = 0
    for i in range(size):
        count += distance[i] <= limit
    return count


@kernel
def tighten(
    distance: Floats, size: int, k: int, guess: float, upper: float, upper_count: int
) -> float:
    """Find a limit with at least k distances up to it, and not many more, if there is one.

    ``upper`` is a limit with at least k, and ``upper_count`` how many. Around a point of a surface
    their number grows like the squared distance, so the next limit is interpolated.
    """
    lower, lower_count, limit = 0.0, 0, guess
    for _ in range(STEPS):
        if upper_count <= k + SURPLUS:
            break
        if not lower < limit < upper:
            share = (k + SURPLUS / 2 - lower_count) / (upper_count - lower_count)
            limit = lower + share * (upper - lower)
            if not lower < limit < upper:
                break
        count = count_up_to(distance, size, limit)
        if count >= k:
            upper, upper_count = limit, count
        else:
            lower, lower_count = limit, count
    return upper


@kernel
def enough(distance: Floats, count: int, k: int, limit: float) -> float:
    """Find a limit, not much further, up to which there are at least k distances.

    Fewer than k are up to the limit given, and at least k of the ``count`` distances are finite.
    """
    furthest = 0.0
    for i in range(count):
        if furthest < distance[i] < np.inf:
            furthest = distance[i]
    return tighten(distance, count, k, 2 * limit, furthest, count)


@kernel
def choose(
    distance: Floats, index: Ints, count: int, limit: float, few: Floats, few_index: Ints
) -> int:
    """Copy the distances up to the limit, and their indices; return how many there are."""
    chosen = 0
    for i in range(count):
        few_index[chosen] = i
        chosen += distance[i] <= limit
    for i in range(chosen):
        which = few_index[i]
        few[i], few_index[i] = distance[which], index[which]
    return chosen


@kernel
def sort(
    order: Ints, few: Floats, few_index: Ints, count: int, best: Floats, best_index: Ints
) -> None:
    """Sort distances, and equal ones by the ``order`` of their indices.

    There must be three more entries, and ``few`` is padded.
    """
    if count > RANKED or not _rank(few, few_index, count, best, best_index):
        _sort(order, few, few_index, count, best, best_index)


@noalias_kernel
def _rank(few: Floats, few_index: Ints, count: int, best: Floats, best_index: Ints) -> bool:
    """Sort by counting for each of the few how many are nearer; False, and unsorted, with ties.

    Four at once, because loading costs more than comparing.
    """
    size = (count + 3) // 4 * 4
    for i in range(count, size):
        few[i] = np.inf
    total = 0
    for i in range(0, size, 4):
        a, b, c, d = few[i], few[i + 1], few[i + 2], few[i + 3]
        rank_a = rank_b = rank_c = rank_d = 0
        for j in range(size):
            other = few[j]
            rank_a += other < a
            rank_b += other < b
            rank_c += other < c
            rank_d += other < d
        best[rank_d], best_index[rank_d] = d, few_index[i + 3]
        best[rank_c], best_index[rank_c] = c, few_index[i + 2]
        best[rank_b], best_index[rank_b] = b, few_index[i + 1]
        best[rank_a], best_index[rank_a] = a, few_index[i]
        total += rank_a + rank_b + rank_c + rank_d
    # The ranks are 0, 1, 2 … if no two are equal, and that of padding is the count.
    return total == count * (count - 1) // 2 + (size - count) * count


@noalias_kernel
def _sort(order: Ints, few: Floats, few_index: Ints, count: int, best: Floats, index: Ints) -> None:
    """Sort by distance, then index: Shell's sort with Knuth's steps."""
    for i in range(count):
        best[i], index[i] = few[i], few_index[i]
    step = 1
    while step < count // 3:
        step = 3 * step + 1
    while step > 0:
        for i in range(step, count):
            d, p, j = best[i], index[i], i
            while j >= step and (
                best[j - step] > d or (best[j - step] == d and order[index[j - step]] > order[p])
            ):
                best[j], index[j] = best[j - step], index[j - step]
                j -= step
            best[j], index[j] = d, p
        step //= 3
