# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of a point among its sixty nearest neighbours, see :mod:`.features`.

All lengths are divided by S, the median distance of the sixty to their own eighth.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Index, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees import near_features
from lidar_outlier_filter.core.detectors.boosted_trees.features import FAR, NEAR, rows
from lidar_outlier_filter.core.detectors.boosted_trees.near_features import (
    MAX_VALUE,
    NARROW,
    SMOOTH,
    Near,
    add_moments,
    copy_rows,
    gather,
    measure,
    off_plane,
    write_between,
    write_heights,
)
from lidar_outlier_filter.core.kernels.eigen import eigenvalues, eigenvectors
from lidar_outlier_filter.core.kernels.kernels import device_function
from lidar_outlier_filter.core.kernels.lanes import LANES, network, sort
from lidar_outlier_filter.core.neighbours.duplicates import MIN_SCALE_M, K

MAX_NEIGHBOURS, FEWER_NEIGHBOURS = 60, 20  # neighbours
DENSE_RANK = 5  # rank of the neighbour that is dense, from 0
GROUP_GAP = 2.0  # S: a longer distance ends a group
SORT_SOME, SORT_MAX = (network(k, range(k)) for k in (FEWER_NEIGHBOURS, MAX_NEIGHBOURS))
JOINING = 10  # numbers for each lane, while neighbours are joined

BEGIN, COUNT, ROW = len(NEAR), len(NEAR) + len(FAR), rows(FAR, len(NEAR))


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

    near: near_features.NearBuffers
    scale: Floats
    offset: Floats
    distance: Floats
    radii: Floats
    work: Floats
    some: Floats
    joining: Floats


@device_function
def make_buffers() -> FarBuffers:
    """Allocate for points that are measured side by side."""
    lists = np.empty((3, MAX_NEIGHBOURS, LANES))
    return FarBuffers(
        near_features.make_buffers(),
        np.empty(LANES),
        np.empty((3, MAX_NEIGHBOURS, LANES)),
        *(lists[0], lists[1], lists[2]),
        *(np.empty((FEWER_NEIGHBOURS, LANES)), np.empty((JOINING, LANES))),
    )


@device_function
def write_far(far: Far, points: Ints, rows: Ints, buffers: FarBuffers, values: Singles) -> None:
    """Write all features (COUNT, LANES) of points, whose neighbours are in these rows."""
    near, scale, count = far.near, buffers.scale, far.index.shape[1]
    some = min(FEWER_NEIGHBOURS, count)
    near_features.write_near(near, points, buffers.near, values)
    for lane in range(LANES):
        p, others = points[lane], far.index[rows[lane]]
        gather(near.xyz, near.radius, p, others, lane, buffers.offset, buffers.radii)
        _write_odds(far.odds, near.index[p], p, others, lane, values)
    measure(buffers.offset, count, buffers.distance)
    _write_distances(near, count, points, buffers, values)
    _write_planes(some, ROW.off20, buffers, values)
    _write_planes(count, ROW.off60, buffers, values)
    z = buffers.offset[2]
    write_heights(z, some, SORT_SOME, scale, ROW.below20, ROW.sunk20, buffers.some, values)
    write_heights(z, count, SORT_MAX, scale, ROW.below60, ROW.sunk60, buffers.work, values)
    _write_between(count, buffers, values)
    _write_group(count, buffers, values)
    for feature in range(BEGIN, COUNT):
        for lane in range(len(scale)):
            values[feature, lane] = min(max(values[feature, lane], -MAX_VALUE), MAX_VALUE)


@device_function
def _write_distances(
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
