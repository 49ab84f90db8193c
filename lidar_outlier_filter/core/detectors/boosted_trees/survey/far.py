# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Features of a point among its sixty nearest neighbours, behind those of :mod:`.survey_near`.

All lengths are divided by S, the median distance of the sixty to their own eighth.

``wide8``, ``wide20``, ``wide60``
    Distance to the eighth, twentieth and sixtieth neighbour ÷ S.
``densest``
    Distance to the eighth ÷ that of the sixth densest neighbour.
``contrast``
    S ÷ s, the median of the eight.
``first_edge``, ``longest``, ``before``, ``against``
    The sixty are joined to the point one by one, always the one nearest to any that are joined.
    The first and the longest distance of these ÷ S; how many were joined before the longest, and
    how long it is ÷ the longest before it.
``group``
    How many are joined before the first distance of more than 2 S.
``off20``, ``flat20``, ``off_flat20``, ``off60``, ``flat60``, ``off_flat60``
    As ``off``, ``flat`` and ``off_flat``, of the planes through 20 and 60.
``below20``, ``above20``, ``below60``, ``above60``
    How far the point is below the lowest, and above the highest of them, ÷ S.
``sunk20``, ``raised20``, ``sunk60``, ``raised60``
    The same, ÷ how far the lowest quarter of them, or the highest, is apart, and a fiftieth of S.
``rare60``
    S ÷ the typical distance to the eighth neighbour in the whole cloud.
``higher``
    Share of the sixty that are higher than the point.
``under``, ``over``
    Two of the twenty that lie opposite each other, seen from above, say a height between them. How
    far the point is below the lowest, and above the highest of these, ÷ S.
``first``, ``near_odds``, ``company8``, ``company60``
    Log-odds by the first trees; the mean of the eight; share of the eight and of the sixty for
    which they are more than 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.survey import near as survey_near
from lidar_outlier_filter.core.detectors.boosted_trees.survey.lanes import (
    NARROW,
    add_moments,
    copy_rows,
    gather,
    measure,
    off_plane,
    write_between,
    write_heights,
)
from lidar_outlier_filter.core.detectors.boosted_trees.survey.near import FAR, NEAR, SMOOTH
from lidar_outlier_filter.core.kernels.eigen import (
    eigenvalues,
    eigenvectors,
)
from lidar_outlier_filter.core.kernels.kernels import inner_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, network, sort
from lidar_outlier_filter.core.neighbours.places import LEAST, K

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Index, Ints, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.survey.near import Near

MOST, SOME = 60, 20  # neighbours
DENSE = 5  # rank of the neighbour that is dense, from 0
GAP = 2.0  # S: a longer distance ends a group
SORT_SOME, SORT_MOST = network(SOME, range(SOME)), network(MOST, range(MOST))
JOINING = 10  # numbers for each lane, while neighbours are joined

WIDE = (
    *('wide8', 'wide20', 'wide60', 'densest', 'contrast'),
    *('first_edge', 'longest', 'before', 'against', 'group'),
    *('off20', 'flat20', 'off_flat20', 'off60', 'flat60', 'off_flat60'),
    *('below20', 'above20', 'below60', 'above60'),
    *('sunk20', 'raised20', 'sunk60', 'raised60', 'rare60', 'higher', 'under', 'over'),
    *('first', 'near_odds', 'company8', 'company60'),
)
NAMES = (*NEAR, *WIDE)
BEGIN, COUNT = len(NEAR), len(NAMES)
PLANES, HEIGHTS, FIRST = BEGIN + 10, BEGIN + 16, BEGIN + 28


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
    index: Index  # type: ignore[assignment]  # nobody misses that of tuples


class FarBuffers(NamedTuple):
    """Room to work in, for one thread; of each lane.

    Attributes
    ----------
    near : that of the nearest eight
    scale : (LANES,) float64
        S, metres.
    offset : (3, MOST, LANES) float64
        Where the neighbours are, from the point, metres.
    distance, radii : (MOST, LANES) float64
        How far they are, and their distances to their own eighth, metres.
    work : (MOST, LANES) float64
    some : (SOME, LANES) float64
    joining : (JOINING, LANES) float64

    """

    near: survey_near.NearBuffers
    scale: Floats
    offset: Floats
    distance: Floats
    radii: Floats
    work: Floats
    some: Floats
    joining: Floats


@inner_kernel
def make_buffers() -> FarBuffers:
    """Allocate for points that are measured side by side."""
    lists = np.empty((3, MOST, LANES))
    return FarBuffers(
        survey_near.make_buffers(),
        np.empty(LANES),
        np.empty((3, MOST, LANES)),
        *(lists[0], lists[1], lists[2]),
        *(np.empty((SOME, LANES)), np.empty((JOINING, LANES))),
    )


@inner_kernel
def write_far(far: Far, points: Ints, rows: Ints, buffers: FarBuffers, values: Singles) -> None:
    """Write all features (COUNT, LANES) of points, whose neighbours are in these rows."""
    near, scale, count = far.near, buffers.scale, far.index.shape[1]
    some = min(SOME, count)
    survey_near.write_near(near, points, buffers.near, values)
    for lane in range(LANES):
        p, others = points[lane], far.index[rows[lane]]
        gather(near.xyz, near.radius, p, others, lane, buffers.offset, buffers.radii)
        _write_odds(far.odds, near.index[p], p, others, lane, values)
    measure(buffers.offset, count, buffers.distance)
    _write_distances(near, count, points, buffers, values)
    _write_planes(some, PLANES, buffers, values)
    _write_planes(count, PLANES + 3, buffers, values)
    z = buffers.offset[2]
    write_heights(z, some, SORT_SOME, scale, HEIGHTS, HEIGHTS + 4, buffers.some, values)
    write_heights(z, count, SORT_MOST, scale, HEIGHTS + 2, HEIGHTS + 6, buffers.work, values)
    _write_between(count, buffers, values)
    _write_group(count, buffers, values)
    for feature in range(BEGIN, COUNT):
        for lane in range(len(scale)):
            values[feature, lane] = min(max(values[feature, lane], -FAR), FAR)


@inner_kernel
def _write_distances(
    near: Near, count: int, points: Ints, buffers: FarBuffers, values: Singles
) -> None:
    """Write the features of distances, and S."""
    scale, distance, work = buffers.scale, buffers.distance, buffers.work
    copy_rows(buffers.radii, count, work)
    sort(work, SORT_MOST)
    # Ranks of a sorted list: the upper of two in the middle.
    half, dense, twentieth = count // 2, min(DENSE, count - 1), min(SOME, count) - 1
    for lane in range(len(scale)):
        s = scale[lane] = work[half, lane] + LEAST
        own = near.radius[points[lane]]
        values[BEGIN, lane] = own / s
        values[BEGIN + 1, lane] = distance[twentieth, lane] / s
        values[BEGIN + 2, lane] = distance[count - 1, lane] / s
        values[BEGIN + 3, lane] = own / (work[dense, lane] + LEAST)
        values[BEGIN + 4, lane] = s / buffers.near.scale[lane]
        values[HEIGHTS + 8, lane] = s / near.around.typical


@inner_kernel
def _write_group(count: int, buffers: FarBuffers, values: Singles) -> None:
    """Join the neighbours one by one (Prim's spanning tree), and write what distances say.

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
            against[lane] = edge / (of + LEAST) if longer else against[lane]
            before[lane] = joined if longer else before[lane]
            longest[lane] = edge if longer else longest[lane]
            apart = min(group[lane], float(joined))
            group[lane] = apart if edge > GAP * scale[lane] else group[lane]
        _take_out(offset, count - joined - 1, x, y, z, reach, best)
    for lane in range(len(scale)):
        values[BEGIN + 5, lane] = first[lane] / scale[lane]
        values[BEGIN + 6, lane] = longest[lane] / scale[lane]
        values[BEGIN + 7, lane], values[BEGIN + 8, lane] = before[lane], against[lane]
        values[BEGIN + 9, lane] = group[lane]


@inner_kernel
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


@inner_kernel
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


@inner_kernel
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


@inner_kernel
def _write_between(count: int, buffers: FarBuffers, values: Singles) -> None:
    """Write how many neighbours are higher, and where the point is between opposite ones."""
    offset, work, scale, row = buffers.offset, buffers.work, buffers.scale, HEIGHTS + 9
    higher, low, high = work[SOME], work[MOST - 2], work[MOST - 1]
    for lane in range(len(scale)):
        higher[lane] = 0.0
    for m in range(count):
        for lane in range(len(scale)):
            higher[lane] += offset[2, m, lane] > 0
    write_between(offset, min(SOME, count), work)
    for lane in range(len(scale)):
        s = scale[lane]
        values[row, lane] = higher[lane] / count
        values[row + 1, lane] = low[lane] / s if low[lane] < np.inf else 0.0
        values[row + 2, lane] = -high[lane] / s if high[lane] > -np.inf else 0.0


@inner_kernel
def _write_odds(
    odds: Singles, nearest: Index, p: int, others: Index, lane: int, values: Singles
) -> None:
    """Write what the first trees say of the point and of its neighbours."""
    total, few, many = 0.0, 0, 0
    for m in range(K):
        total += float(odds[nearest[m]])
        few += odds[nearest[m]] > 0
    for m in range(len(others)):
        many += odds[others[m]] > 0
    values[FIRST, lane], values[FIRST + 1, lane] = odds[p], total / K
    values[FIRST + 2, lane], values[FIRST + 3, lane] = few / K, many / len(others)
