# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of a point among its eight nearest neighbours, see :mod:`.features`.

All lengths are divided by the local scale s, the median distance of those neighbours to their own
eighth: so features have no unit, and follow the density. z is expected to point up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import NEAR, rows
from lidar_outlier_filter.core.kernels.eigen import eigenvalues, eigenvectors
from lidar_outlier_filter.core.kernels.kernels import device_function, inlined_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, network, sort, sort_signed
from lidar_outlier_filter.core.neighbours.duplicates import MIN_SCALE_M, K, number
from lidar_outlier_filter.core.neighbours.floor import Floor, write_depth

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

COUNT, ROW = len(NEAR), rows(NEAR)


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
def make_buffers() -> NearBuffers:
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
    buffers, index, marked = make_buffers(), near.index, near.is_large
    reached, table = buffers.reached, buffers.table
    for p in range(begin, end):
        if number(near.xyz, p) % SAMPLED == 0:
            _, size = _count_steps(index, marked, p, reached, table)
            is_large[p] = size == LARGEST_COMPONENT


@device_function
def write_near(near: Near, points: Ints, buffers: NearBuffers, values: Singles) -> None:
    """Write the features (COUNT, LANES) of points, so many as there are lanes."""
    for lane in range(LANES):
        p = points[lane]
        gather(near.xyz, near.radius, p, near.index[p], lane, buffers.offset, buffers.radii)
        two, size = _count_steps(near.index, near.is_large, p, buffers.reached, buffers.table)
        values[ROW.steps2, lane], values[ROW.component_size, lane] = two, size
        values[ROW.rare, lane] = near.radius[p] / near.around.typical
        x, y, z = near.xyz[p, 0], near.xyz[p, 1], near.xyz[p, 2]
        write_depth(near.around, x, y, z, ROW.deep, lane, values)
    measure(buffers.offset, K, buffers.distance)
    _write_distances(buffers, values)
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
    for feature in range(COUNT):
        for lane in range(len(buffers.scale)):
            values[feature, lane] = min(max(values[feature, lane], -MAX_VALUE), MAX_VALUE)


@device_function
def _write_distances(buffers: NearBuffers, values: Singles) -> None:
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
