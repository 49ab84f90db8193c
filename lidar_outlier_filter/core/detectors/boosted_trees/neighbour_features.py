# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of a point among its eight, or sixty, nearest neighbours, see :mod:`.features`.

Of the eight, all lengths are divided by the local scale s, the median distance of those neighbours
to their own eighth: so features have no unit, and follow the density. z is expected to point up.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import FAR, NEAR, rows
from lidar_outlier_filter.core.kernels.eigen import eigenvalues, eigenvectors
from lidar_outlier_filter.core.kernels.kernels import device_function, inlined_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, network, sort, sort_signed
from lidar_outlier_filter.core.neighbours.floor import Floor, write_depth
from lidar_outlier_filter.core.neighbours.typical import MIN_SCALE_M, K, number

FEW = 3  # of them
SMOOTH = 0.01  # of s: less is not expected of any surface
TABLE = 1024  # slots for the points that two steps reach, a power of 2: few of them meet
MARK = 1 << 32  # more than there are points
LARGEST_COMPONENT = 61  # points: so many are no group
SAMPLED = 8  # points: of one of so many it is found first whether its component is large
MAX_REACHED = LARGEST_COMPONENT + 1 + K + K * K  # points, before the steps end
MAX_VALUE = 1e6  # features are at most so large
SORT = network(K, range(K))

NARROW = 1e-6  # ratio of variances across and along, below which neighbours lie on a line
EVEN_HEIGHTS = 0.02  # of s: heights differ so much on any surface
OPPOSITE = -0.8  # cosine of the angle between neighbours, at most

NEAR_COUNT, FAR_COUNT, ROW = len(NEAR), len(NEAR) + len(FAR), rows((*NEAR, *FAR))
MAX_NEIGHBOURS, FEWER_NEIGHBOURS = 60, 20  # neighbours
DENSE_RANK = 5  # rank of the neighbour that is dense, from 0
GROUP_GAP = 2.0  # S: a longer distance ends a group
SORT_SOME, SORT_MAX = (network(k, range(k)) for k in (FEWER_NEIGHBOURS, MAX_NEIGHBOURS))
JOINING = 10  # numbers for each lane, while neighbours are joined


class Near(NamedTuple):
    """N points in tree order, and their neighbours.

    Attributes
    ----------
    xyz : (N, 3) float64, metres
    index : (N, K) int32
        The nearest first.
    radius : (N,) float64
        Distance to the eighth, metres.
    around : Floor
        What the whole cloud is like.
    is_large : (N,) bool
        Points that :func:`write_large_components` found in components of more than sixty others.

    """

    xyz: Floats
    index: Index  # type: ignore[assignment]  # hides the method of tuples
    radius: Floats
    around: Floor
    is_large: Bools


class NearBuffers(NamedTuple):
    """Room to work in, for one thread; of each lane.

    Attributes
    ----------
    scale : (LANES,) float64
        s, metres.
    offset : (3, K, LANES) float64
        Where the neighbours are, from the point, metres.
    distance, radii : (K, LANES) float64
        How far they are, and their distances to their own eighth, metres.
    work : (K, LANES) float64
    moment, mean, value, vector : (6, 3, 3 or 4, LANES) float64
        Of a plane.
    reached : (MAX_REACHED,) int64
        Points that steps lead to, in the order in which they were found.
    table : (TABLE + 1,) int64
        The last is the mark of the latest count.

    """

    scale: Floats
    offset: Floats
    distance: Floats
    radii: Floats
    work: Floats
    moment: Floats
    mean: Floats
    value: Floats
    vector: Floats
    reached: Ints
    table: Ints


@device_function
def make_near_buffers() -> NearBuffers:
    """Allocate for points that are measured side by side."""
    lists = np.empty((3, K, LANES))
    return NearBuffers(
        np.empty(LANES),
        np.empty((3, K, LANES)),
        *(lists[0], lists[1], lists[2]),
        *(np.empty((6, LANES)), np.empty((3, LANES)), np.empty((3, LANES)), np.empty((4, LANES))),
        *(np.empty(MAX_REACHED, np.int64), np.zeros(TABLE + 1, np.int64)),
    )


@kernel
def write_large_components(near: Near, begin: int, end: int, is_large: Bools) -> None:
    """Write which points of a sample lead to more than sixty others; ``near`` marks none yet."""
    buffers, index, marked = make_near_buffers(), near.index, near.is_large
    reached, table = buffers.reached, buffers.table
    for p in range(begin, end):
        if number(near.xyz, p) % SAMPLED == 0:
            _, size = _count_steps(index, marked, p, reached, table)
            is_large[p] = size == LARGEST_COMPONENT


@device_function
def write_near(near: Near, points: Ints, buffers: NearBuffers, values: Singles) -> None:
    """Write the features (NEAR_COUNT, LANES) of points, so many as there are lanes."""
    for lane in range(LANES):
        p = points[lane]
        gather(near.xyz, near.radius, p, near.index[p], lane, buffers.offset, buffers.radii)
        two, size = _count_steps(near.index, near.is_large, p, buffers.reached, buffers.table)
        values[ROW.steps2, lane], values[ROW.component_size, lane] = two, size
        values[ROW.rare, lane] = near.radius[p] / near.around.typical
        x, y, z = near.xyz[p, 0], near.xyz[p, 1], near.xyz[p, 2]
        write_depth(near.around, x, y, z, ROW.deep, lane, values)
    measure(buffers.offset, K, buffers.distance)
    _write_near_distances(buffers, values)
    scale, work = buffers.scale, buffers.work
    write_heights(buffers.offset[2], K, SORT, scale, ROW.below, ROW.sunk, work, values)
    add_moments(buffers.offset, K, buffers.moment, buffers.mean)
    eigenvalues(buffers.moment, buffers.value)
    eigenvectors(buffers.moment, buffers.value, NARROW, buffers.vector)
    for lane in range(len(buffers.scale)):
        s = buffers.scale[lane]
        off, flat = off_plane(buffers.mean, buffers.value, buffers.vector, lane)
        values[ROW.off, lane], values[ROW.flat, lane] = off / s, flat / s
        values[ROW.off_flat, lane] = off / (flat + SMOOTH * s)
        along = np.sqrt(max(buffers.value[2, lane], 0.0))
        values[ROW.thin, lane] = np.sqrt(max(buffers.value[1, lane], 0.0)) / (along + MIN_SCALE_M)
        values[ROW.aside, lane] = aside(buffers.moment, buffers.mean, lane)
        values[ROW.level, lane] = abs(buffers.vector[2, lane])
    for feature in range(NEAR_COUNT):
        for lane in range(len(buffers.scale)):
            values[feature, lane] = min(max(values[feature, lane], -MAX_VALUE), MAX_VALUE)


@device_function
def _write_near_distances(buffers: NearBuffers, values: Singles) -> None:
    """Write the features of distances, and s."""
    distance, radii, work, scale = buffers.distance, buffers.radii, buffers.work, buffers.scale
    copy_rows(radii, K, work)
    sort(work, SORT)
    half = K // 2
    for lane in range(len(scale)):
        s = scale[lane] = (work[half - 1, lane] + work[half, lane]) / 2 + MIN_SCALE_M
        least, most = work[0, lane], work[K - 1, lane]
        first, eighth = distance[0, lane], distance[K - 1, lane]
        values[ROW.near1, lane], values[ROW.near8, lane] = first / s, eighth / s
        values[ROW.near3, lane] = (first + distance[1, lane] + distance[2, lane]) / (FEW * s)
        values[ROW.denser, lane] = eighth / (least + MIN_SCALE_M)
        values[ROW.sparser, lane] = most / s
    jump, jump_at, listed = work[0], work[1], work[2]
    for lane in range(len(scale)):
        jump[lane], jump_at[lane] = 1.0, 0.0
        listed[lane] = distance[0, lane] <= radii[0, lane]
    for m in range(1, K):
        for lane in range(len(scale)):
            ratio = distance[m, lane] / (distance[m - 1, lane] + MIN_SCALE_M)
            jump_at[lane] = m if ratio > jump[lane] else jump_at[lane]
            jump[lane] = max(jump[lane], ratio)
            listed[lane] += distance[m, lane] <= radii[m, lane]
    for lane in range(len(scale)):
        values[ROW.jump, lane], values[ROW.jump_at, lane] = jump[lane], jump_at[lane]
        values[ROW.listed, lane] = listed[lane]


@device_function
def _count_steps(
    index: Index, is_large: Bools, p: int, reached: Ints, table: Ints
) -> tuple[int, int]:
    """Count the other points that two steps from p lead to, and all that any number of them does.

    Of the points that so many steps lead to, those found last are taken first: they are far out,
    and lead to new ones. What the table holds of earlier counts is less than ``mark``: so nothing
    is cleared.
    """
    table[TABLE] += MARK
    mark, count, done = table[TABLE], 1, 0
    _put(table, mark, mark + p)
    reached[0] = p
    while done < min(count, K + 1):
        count = _step(index, reached[done], count, mark, reached, table)
        done += 1
    two, begin, end, at = count - 1, done, count, count
    # A point that reaches a large component belongs to it.
    for i in range(count):
        if is_large[np.uint64(reached[i])]:
            return two, LARGEST_COMPONENT
    while begin < at and count < LARGEST_COMPONENT:
        at -= 1
        count = _step(index, reached[at], count, mark, reached, table)
        if at == begin:
            begin, end, at = end, count, count
    return two, min(count, LARGEST_COMPONENT)


@inlined_kernel
def _step(index: Index, one: int, count: int, mark: int, reached: Ints, table: Ints) -> int:
    """Append the neighbours of a point that were not reached before; return the new count."""
    for m in range(K):
        # Without a branch, which could not be predicted; unsigned, lest numba check for negatives.
        o = index[np.uint64(one), m]
        reached[np.uint64(count)] = o
        count += _put(table, mark, mark + o)
    return count


@inlined_kernel
def _put(table: Ints, mark: int, number: int) -> bool:
    """Put a number into a table; return whether it was not there."""
    slot = np.uint64(number & (TABLE - 1))
    while (table[slot] >= mark) & (table[slot] != number):
        slot = np.uint64((int(slot) + 1) & (TABLE - 1))
    new: bool = table[slot] != number
    table[slot] = number
    return new


@device_function
def gather(
    xyz: Floats, radius: Floats, p: int, others: Index, lane: int, offset: Floats, radii: Floats
) -> None:
    """Write where the neighbours of p are, and their distances to their own eighth."""
    x, y, z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
    for m in range(len(others)):
        o = others[m]
        offset[0, m, lane] = xyz[o, 0] - x
        offset[1, m, lane] = xyz[o, 1] - y
        offset[2, m, lane] = xyz[o, 2] - z
        radii[m, lane] = radius[o]


@device_function
def measure(offset: Floats, count: int, distance: Floats) -> None:
    """Write the distances (M, LANES) of the first ``count`` neighbours."""
    for m in range(count):
        for lane in range(distance.shape[1]):
            x, y, z = offset[0, m, lane], offset[1, m, lane], offset[2, m, lane]
            distance[m, lane] = np.sqrt((x * x + y * y) + z * z)


@device_function
def copy_rows(rows: Floats, count: int, copied: Floats) -> None:
    """Copy so many rows; those behind them become inf."""
    for m in range(len(copied)):
        for lane in range(copied.shape[1]):
            copied[m, lane] = rows[m, lane] if m < count else np.inf


@device_function
def add_moments(offset: Floats, count: int, moment: Floats, mean: Floats) -> None:
    """Write the mean of the first ``count`` neighbours, and their second moments around it."""
    mean[:], moment[:] = 0.0, 0.0
    for m in range(count):
        for lane in range(mean.shape[1]):
            mean[0, lane] += offset[0, m, lane]
            mean[1, lane] += offset[1, m, lane]
            mean[2, lane] += offset[2, m, lane]
    for lane in range(mean.shape[1]):
        mean[0, lane] = mean[0, lane] / count
        mean[1, lane] = mean[1, lane] / count
        mean[2, lane] = mean[2, lane] / count
    for m in range(count):
        for lane in range(mean.shape[1]):
            a = offset[0, m, lane] - mean[0, lane]
            b = offset[1, m, lane] - mean[1, lane]
            c = offset[2, m, lane] - mean[2, lane]
            moment[0, lane] += a * a
            moment[1, lane] += b * b
            moment[2, lane] += c * c
            moment[3, lane] += a * b
            moment[4, lane] += a * c
            moment[5, lane] += b * c
    for row in range(6):
        for lane in range(mean.shape[1]):
            moment[row, lane] = moment[row, lane] / count


@device_function
def write_heights(
    z: Floats,
    count: int,
    pairs: Ints,
    scale: Floats,
    row: int,
    sunk: int,
    work: Floats,
    values: Singles,
) -> None:
    """Write how far points are below and above the first ``count`` neighbours, whose z these are.

    ``pairs`` sorts as many rows as ``work`` has.
    """
    copy_rows(z, count, work)
    sort_signed(work, pairs)
    quarter = count // 4
    for lane in range(len(scale)):
        low, high, s = work[0, lane], work[count - 1, lane], scale[lane]
        next_low, next_high = work[quarter, lane], work[count - 1 - quarter, lane]
        values[row, lane], values[row + 1, lane] = low / s, -high / s
        values[sunk, lane] = low / (next_low - low + EVEN_HEIGHTS * s)
        values[sunk + 1, lane] = -high / (high - next_high + EVEN_HEIGHTS * s)


@device_function
def off_plane(mean: Floats, value: Floats, vector: Floats, lane: int) -> tuple[float, float]:
    """Return the distances of a point and of its neighbours (rms) from their plane, or line."""
    x, y, z = mean[0, lane], mean[1, lane], mean[2, lane]
    along = x * vector[0, lane] + y * vector[1, lane] + z * vector[2, lane]
    across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    thin, both = value[0, lane], value[0, lane] + value[1, lane]
    planar = value[1, lane] > NARROW * value[2, lane]
    return abs(along) if planar else across, np.sqrt(max(thin if planar else both, 0.0))


@device_function
def aside(moment: Floats, mean: Floats, lane: int) -> float:
    """Return how far the mean of neighbours is from the point ÷ how far they are from that mean."""
    x, y, z = mean[0, lane], mean[1, lane], mean[2, lane]
    spread = np.sqrt(moment[0, lane] + moment[1, lane] + moment[2, lane])
    return float(np.sqrt(x * x + y * y + z * z) / (spread + MIN_SCALE_M))


@device_function
def write_between(offset: Floats, count: int, work: Floats) -> None:
    """Write the lowest and highest z, from the point, between two opposite neighbours.

    They become the last but one and the last row of ``work``, inf and -inf without such neighbours.
    """
    opposite, low, high = OPPOSITE, len(work) - 2, len(work) - 1
    for lane in range(work.shape[1]):
        work[low, lane], work[high, lane] = np.inf, -np.inf
    for m in range(count):
        for lane in range(work.shape[1]):
            x, y = offset[0, m, lane], offset[1, m, lane]
            work[m, lane] = np.sqrt(x * x + y * y)
    for m in range(count):
        for n in range(m):
            for lane in range(work.shape[1]):
                across = (
                    offset[0, m, lane] * offset[0, n, lane]
                    + offset[1, m, lane] * offset[1, n, lane]
                )
                one, other = work[m, lane], work[n, lane]
                z = (offset[2, m, lane] * other + offset[2, n, lane] * one) / (one + other)
                found = across < opposite * (one * other)
                lower, higher = work[low, lane], work[high, lane]
                work[low, lane] = min(lower, z if found else lower)
                work[high, lane] = max(higher, z if found else higher)


# The features of a point among its sixty nearest neighbours ---------------------------------------
#
# All lengths are divided by S, the median distance of the sixty to their own eighth.


class Far(NamedTuple):
    """M points, by their index in tree order, and up to 60 neighbours of each.

    Attributes
    ----------
    near : all points
    odds : (N,) float32
        Log-odds by the first trees.
    index : (M, 60) int32
        The nearest first; fewer columns where there are fewer points.

    """

    near: Near
    odds: Singles
    index: Index  # type: ignore[assignment]  # hides the method of tuples


class FarBuffers(NamedTuple):
    """Room to work in, for one thread; of each lane.

    Attributes
    ----------
    near : that of the nearest eight
    scale : (LANES,) float64
        S, metres.
    offset : (3, MAX_NEIGHBOURS, LANES) float64
        Where the neighbours are, from the point, metres.
    distance, radii : (MAX_NEIGHBOURS, LANES) float64
        How far they are, and their distances to their own eighth, metres.
    work : (MAX_NEIGHBOURS, LANES) float64
    some : (FEWER_NEIGHBOURS, LANES) float64
    joining : (JOINING, LANES) float64

    """

    near: NearBuffers
    scale: Floats
    offset: Floats
    distance: Floats
    radii: Floats
    work: Floats
    some: Floats
    joining: Floats


@device_function
def make_far_buffers() -> FarBuffers:
    """Allocate for points that are measured side by side."""
    lists = np.empty((3, MAX_NEIGHBOURS, LANES))
    return FarBuffers(
        make_near_buffers(),
        np.empty(LANES),
        np.empty((3, MAX_NEIGHBOURS, LANES)),
        *(lists[0], lists[1], lists[2]),
        *(np.empty((FEWER_NEIGHBOURS, LANES)), np.empty((JOINING, LANES))),
    )


@device_function
def write_far(far: Far, points: Ints, rows: Ints, buffers: FarBuffers, values: Singles) -> None:
    """Write all features (FAR_COUNT, LANES) of points, whose neighbours are in these rows."""
    near, scale, count = far.near, buffers.scale, far.index.shape[1]
    some = min(FEWER_NEIGHBOURS, count)
    write_near(near, points, buffers.near, values)
    for lane in range(LANES):
        p, others = points[lane], far.index[rows[lane]]
        gather(near.xyz, near.radius, p, others, lane, buffers.offset, buffers.radii)
        _write_odds(far.odds, near.index[p], p, others, lane, values)
    measure(buffers.offset, count, buffers.distance)
    _write_far_distances(near, count, points, buffers, values)
    _write_planes(some, ROW.off20, buffers, values)
    _write_planes(count, ROW.off60, buffers, values)
    z = buffers.offset[2]
    write_heights(z, some, SORT_SOME, scale, ROW.below20, ROW.sunk20, buffers.some, values)
    write_heights(z, count, SORT_MAX, scale, ROW.below60, ROW.sunk60, buffers.work, values)
    _write_between(count, buffers, values)
    _write_group(count, buffers, values)
    for feature in range(NEAR_COUNT, FAR_COUNT):
        for lane in range(len(scale)):
            values[feature, lane] = min(max(values[feature, lane], -MAX_VALUE), MAX_VALUE)


@device_function
def _write_far_distances(
    near: Near, count: int, points: Ints, buffers: FarBuffers, values: Singles
) -> None:
    """Write the features of distances, and S."""
    scale, distance, work = buffers.scale, buffers.distance, buffers.work
    copy_rows(buffers.radii, count, work)
    sort(work, SORT_MAX)
    # Ranks of a sorted list: the upper of two in the middle.
    half, dense = count // 2, min(DENSE_RANK, count - 1)
    twentieth = min(FEWER_NEIGHBOURS, count) - 1
    for lane in range(len(scale)):
        s = scale[lane] = work[half, lane] + MIN_SCALE_M
        own = near.radius[points[lane]]
        values[ROW.wide8, lane] = own / s
        values[ROW.wide20, lane] = distance[twentieth, lane] / s
        values[ROW.wide60, lane] = distance[count - 1, lane] / s
        values[ROW.densest, lane] = own / (work[dense, lane] + MIN_SCALE_M)
        values[ROW.contrast, lane] = s / buffers.near.scale[lane]
        values[ROW.rare60, lane] = s / near.around.typical


@device_function
def _write_group(count: int, buffers: FarBuffers, values: Singles) -> None:
    """Join the neighbours one by one (Prim's spanning tree), and write features of the edges.

    The neighbours are put into another order.
    """
    offset, reach, work, scale = buffers.offset, buffers.work, buffers.joining, buffers.scale
    x, y, z, best, least = work[0], work[1], work[2], work[3], work[4]
    first, longest, before, against, group = work[5], work[6], work[7], work[8], work[9]
    for lane in range(len(scale)):
        x[lane] = y[lane] = z[lane] = longest[lane] = before[lane] = against[lane] = 0.0
        group[lane] = count
    copy_rows(reach, 0, reach)
    for joined in range(count):
        # What is left is kept together at the begin.
        _join_next(offset, count - joined, x, y, z, reach, best, least)
        for lane in range(len(scale)):
            edge = np.sqrt(least[lane])
            of = longest[lane] if joined > 0 else scale[lane]
            longer = edge > longest[lane]
            first[lane] = edge if joined == 0 else first[lane]
            against[lane] = edge / (of + MIN_SCALE_M) if longer else against[lane]
            before[lane] = joined if longer else before[lane]
            longest[lane] = edge if longer else longest[lane]
            apart = min(group[lane], float(joined))
            group[lane] = apart if edge > GROUP_GAP * scale[lane] else group[lane]
        _take_out(offset, count - joined - 1, x, y, z, reach, best)
    for lane in range(len(scale)):
        values[ROW.first_edge, lane] = first[lane] / scale[lane]
        values[ROW.longest, lane] = longest[lane] / scale[lane]
        values[ROW.before, lane], values[ROW.against, lane] = before[lane], against[lane]
        values[ROW.group, lane] = group[lane]


@device_function
def _join_next(
    offset: Floats,
    left: int,
    x: Floats,
    y: Floats,
    z: Floats,
    reach: Floats,
    best: Floats,
    least: Floats,
) -> None:
    """Find which of those left is nearest to any that are joined, the last of which is at x y z."""
    for lane in range(len(least)):
        best[lane], least[lane] = 0.0, np.inf
    for m in range(left):
        for lane in range(len(least)):
            dx, dy = offset[0, m, lane] - x[lane], offset[1, m, lane] - y[lane]
            dz = offset[2, m, lane] - z[lane]
            squared = min(reach[m, lane], (dx * dx + dy * dy) + dz * dz)
            reach[m, lane] = squared
            best[lane] = m if squared < least[lane] else best[lane]
            least[lane] = min(least[lane], squared)


@device_function
def _take_out(
    offset: Floats, last: int, x: Floats, y: Floats, z: Floats, reach: Floats, best: Floats
) -> None:
    """Put the last of those left where the best one was, which is at x y z now."""
    for lane in range(len(best)):
        m = np.uint64(best[lane])
        x[lane], y[lane], z[lane] = offset[0, m, lane], offset[1, m, lane], offset[2, m, lane]
        reach[m, lane] = reach[last, lane]
        for axis in range(3):
            offset[axis, m, lane] = offset[axis, last, lane]


@device_function
def _write_planes(count: int, row: int, buffers: FarBuffers, values: Singles) -> None:
    """Write the features of the plane through so many neighbours."""
    near, scale = buffers.near, buffers.scale
    add_moments(buffers.offset, count, near.moment, near.mean)
    eigenvalues(near.moment, near.value)
    eigenvectors(near.moment, near.value, NARROW, near.vector)
    for lane in range(len(scale)):
        off, flat = off_plane(near.mean, near.value, near.vector, lane)
        s = scale[lane]
        values[row, lane], values[row + 1, lane] = off / s, flat / s
        values[row + 2, lane] = off / (flat + SMOOTH * s)


@device_function
def _write_between(count: int, buffers: FarBuffers, values: Singles) -> None:
    """Write how many neighbours are higher, and where the point is between opposite ones."""
    offset, work, scale = buffers.offset, buffers.work, buffers.scale
    higher, low, high = work[FEWER_NEIGHBOURS], work[MAX_NEIGHBOURS - 2], work[MAX_NEIGHBOURS - 1]
    for lane in range(len(scale)):
        higher[lane] = 0.0
    for m in range(count):
        for lane in range(len(scale)):
            higher[lane] += offset[2, m, lane] > 0
    write_between(offset, min(FEWER_NEIGHBOURS, count), work)
    for lane in range(len(scale)):
        s = scale[lane]
        values[ROW.higher, lane] = higher[lane] / count
        values[ROW.under, lane] = low[lane] / s if low[lane] < np.inf else 0.0
        values[ROW.over, lane] = -high[lane] / s if high[lane] > -np.inf else 0.0


@device_function
def _write_odds(
    odds: Singles, nearest: Index, p: int, others: Index, lane: int, values: Singles
) -> None:
    """Write the first log-odds of the point, and their statistics over its neighbours."""
    total, few, many = 0.0, 0, 0
    for m in range(K):
        total += float(odds[nearest[m]])
        few += odds[nearest[m]] > 0
    for m in range(len(others)):
        many += odds[others[m]] > 0
    values[ROW.first, lane], values[ROW.near_odds, lane] = odds[p], total / K
    values[ROW.rejected_neighbour_share8, lane] = few / K
    values[ROW.rejected_neighbour_share60, lane] = many / len(others)
