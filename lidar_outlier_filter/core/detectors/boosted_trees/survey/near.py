# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Features of a point among its eight nearest neighbours, without scan lines.

All lengths are divided by the local scale s, the median distance of those neighbours to their own
eighth: so features have no unit, and follow the density. z is expected to point up.

``near1``, ``near3``, ``near8``
    Distance to the nearest neighbour, mean of the three nearest, distance to the eighth, ÷ s.
``denser``
    Distance to the eighth ÷ the least of the neighbours' distances to theirs.
``sparser``
    The greatest of the neighbours' distances to their eighth ÷ s.
``jump``, ``jump_at``
    Greatest ratio of the distances to a neighbour and to the one before; neighbours before it.
``listed``
    How many of the neighbours are at least as far from their own eighth as from the point.
``steps2``
    How many other points two steps reach, each to one of the eight nearest.
``closed``
    How many points any number of such steps reach, with the point itself; 61 stands for all larger
    numbers. Fewer are a group that is apart from all else, however even it is in itself.
``off``, ``flat``, ``off_flat``
    Distance from the plane through the neighbours, and their standard deviation from it, ÷ s; the
    first ÷ the second and a hundredth of s.
``thin``
    Standard deviations of the neighbours across and along the plane's longest direction: a ratio.
``aside``
    Distance of the neighbours' mean from the point, ÷ their root mean square distance from it.
``level``
    Size of the vertical part of the plane's normal.
``below``, ``above``
    How far the point is below its lowest, and above its highest neighbour, ÷ s.
``sunk``, ``raised``
    The same, ÷ how far the third lowest is above the lowest, or the third highest below the
    highest, and a fiftieth of s.
``rare``
    Distance to the eighth neighbour ÷ the typical one in the whole cloud.

Behind these come the features of the :mod:`lidar_outlier_filter.core.neighbours.floor`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.survey.lanes import (
    NARROW,
    add_moments,
    aside,
    copy_rows,
    gather,
    measure,
    off_plane,
    write_heights,
)
from lidar_outlier_filter.core.kernels.eigen import (
    eigenvalues,
    eigenvectors,
)
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, network, sort
from lidar_outlier_filter.core.neighbours.floor import NAMES as FLOOR
from lidar_outlier_filter.core.neighbours.floor import write_depth
from lidar_outlier_filter.core.neighbours.places import LEAST, K

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Index, Ints, Singles
    from lidar_outlier_filter.core.neighbours.floor import Floor

FEW = 3  # of them
SMOOTH = 0.01  # of s: less is not expected of any surface
TABLE = 1024  # slots for the points that two steps reach, a power of 2: few of them meet
MARK = 1 << 32  # more than there are points
CLOSED = 61  # points: so many are no group
ROOM = CLOSED + 1 + K + K * K  # points that are found before the steps end, at most
FAR = 1e6  # features are at most so large
SORT = network(K, range(K))

NEAR = (
    *('near1', 'near3', 'near8', 'denser', 'sparser', 'jump', 'jump_at', 'listed', 'steps2'),
    *('off', 'flat', 'off_flat', 'thin', 'aside', 'level', 'below', 'above'),
    *('sunk', 'raised', 'rare', 'closed'),
    *FLOOR,
)
COUNT, DEPTH = len(NEAR), len(NEAR) - len(FLOOR)


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
    lead : (N,) bool
        Which points are known, by :func:`write_leads`, to lead to more than sixty others.

    """

    xyz: Floats
    index: Index  # type: ignore[assignment]  # nobody misses that of tuples
    radius: Floats
    around: Floor
    lead: Bools


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
    reached : (ROOM,) int64
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


@inner_kernel
def make_buffers() -> NearBuffers:
    """Allocate for points that are measured side by side."""
    lists = np.empty((3, K, LANES))
    return NearBuffers(
        np.empty(LANES),
        np.empty((3, K, LANES)),
        *(lists[0], lists[1], lists[2]),
        *(np.empty((6, LANES)), np.empty((3, LANES)), np.empty((3, LANES)), np.empty((4, LANES))),
        *(np.empty(ROOM, np.int64), np.zeros(TABLE + 1, np.int64)),
    )


@kernel
def write_leads(near: Near, some: Ints, lead: Bools) -> None:
    """Write which of some points lead to more than sixty others; none is known in ``near``."""
    buffers = make_buffers()
    for p in some:
        _, closed = _count_steps(near, p, buffers)
        lead[p] = closed == CLOSED


@inner_kernel
def write_near(near: Near, points: Ints, buffers: NearBuffers, values: Singles) -> None:
    """Write the features (COUNT, LANES) of points, so many as there are lanes."""
    for lane in range(LANES):
        p = points[lane]
        gather(near.xyz, near.radius, p, near.index[p], lane, buffers.offset, buffers.radii)
        values[8, lane], values[20, lane] = _count_steps(near, p, buffers)
        values[19, lane] = near.radius[p] / near.around.typical
        x, y, z = near.xyz[p, 0], near.xyz[p, 1], near.xyz[p, 2]
        write_depth(near.around, x, y, z, DEPTH, lane, values)
    measure(buffers.offset, K, buffers.distance)
    _write_distances(buffers, values)
    write_heights(buffers.offset[2], K, SORT, buffers.scale, 15, 17, buffers.work, values)
    add_moments(buffers.offset, K, buffers.moment, buffers.mean)
    eigenvalues(buffers.moment, buffers.value)
    eigenvectors(buffers.moment, buffers.value, NARROW, buffers.vector)
    for lane in range(len(buffers.scale)):
        s = buffers.scale[lane]
        off, flat = off_plane(buffers.mean, buffers.value, buffers.vector, lane)
        values[9, lane], values[10, lane] = off / s, flat / s
        values[11, lane] = off / (flat + SMOOTH * s)
        along = np.sqrt(max(buffers.value[2, lane], 0.0))
        values[12, lane] = np.sqrt(max(buffers.value[1, lane], 0.0)) / (along + LEAST)
        values[13, lane] = aside(buffers.moment, buffers.mean, lane)
        values[14, lane] = abs(buffers.vector[2, lane])
    for feature in range(COUNT):
        for lane in range(len(buffers.scale)):
            values[feature, lane] = min(max(values[feature, lane], -FAR), FAR)


@inner_kernel
def _write_distances(buffers: NearBuffers, values: Singles) -> None:
    """Write the features of distances, and s."""
    distance, radii, work, scale = buffers.distance, buffers.radii, buffers.work, buffers.scale
    copy_rows(radii, K, work)
    sort(work, SORT)
    half = K // 2
    for lane in range(len(scale)):
        s = scale[lane] = (work[half - 1, lane] + work[half, lane]) / 2 + LEAST
        least, most = work[0, lane], work[K - 1, lane]
        first, eighth = distance[0, lane], distance[K - 1, lane]
        values[0, lane], values[2, lane] = first / s, eighth / s
        values[1, lane] = (first + distance[1, lane] + distance[2, lane]) / (FEW * s)
        values[3, lane], values[4, lane] = eighth / (least + LEAST), most / s
    jump, jump_at, listed = work[0], work[1], work[2]
    for lane in range(len(scale)):
        jump[lane], jump_at[lane] = 1.0, 0.0
        listed[lane] = distance[0, lane] <= radii[0, lane]
    for m in range(1, K):
        for lane in range(len(scale)):
            ratio = distance[m, lane] / (distance[m - 1, lane] + LEAST)
            jump_at[lane] = m if ratio > jump[lane] else jump_at[lane]
            jump[lane] = max(jump[lane], ratio)
            listed[lane] += distance[m, lane] <= radii[m, lane]
    for lane in range(len(scale)):
        values[5, lane], values[6, lane] = jump[lane], jump_at[lane]
        values[7, lane] = listed[lane]


@inner_kernel
def _count_steps(near: Near, p: int, buffers: NearBuffers) -> tuple[int, int]:
    """Count the other points that two steps from p lead to, and all that any number of them does.

    Of the points that so many steps lead to, those found last are taken first: they are far out,
    and lead to new ones. What the table holds of earlier counts is less than ``mark``: so nothing
    is cleared.
    """
    reached, table = buffers.reached, buffers.table
    table[TABLE] += MARK
    mark, count, done = table[TABLE], 1, 0
    _put(table, mark, mark + p)
    reached[0] = p
    while done < min(count, K + 1):
        count = _step(near, reached[done], count, mark, buffers)
        done += 1
    two, begin, end, at = count - 1, done, count, count
    # What leads to a point leads to all that this one leads to.
    for i in range(count):
        if near.lead[reached[i]]:
            return two, CLOSED
    while begin < at and count < CLOSED:
        at -= 1
        count = _step(near, reached[at], count, mark, buffers)
        if at == begin:
            begin, end, at = end, count, count
    return two, min(count, CLOSED)


@inner_kernel
def _step(near: Near, one: int, count: int, mark: int, buffers: NearBuffers) -> int:
    """Put the neighbours of a point that were not reached before behind so many that were.

    Return how many these are now.
    """
    for m in range(K):
        o = near.index[one, m]
        # Without a branch: nobody can predict which points are new.
        buffers.reached[count] = o
        count += _put(buffers.table, mark, mark + o)
    return count


@inner_kernel
def _put(table: Ints, mark: int, number: int) -> bool:
    """Put a number into a table; return whether it was not there."""
    slot = number & (TABLE - 1)
    while (table[slot] >= mark) & (table[slot] != number):
        slot = (slot + 1) & (TABLE - 1)
    new: bool = table[slot] != number
    table[slot] = number
    return new
