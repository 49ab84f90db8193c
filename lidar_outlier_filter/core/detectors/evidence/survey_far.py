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

from lidar_outlier_filter.core.detectors.evidence import survey_near
from lidar_outlier_filter.core.detectors.evidence.eigen import eigenvalues, eigenvectors
from lidar_outlier_filter.core.detectors.evidence.survey_near import (
    FAR,
    LEAST,
    NARROW,
    NEAR,
    SMOOTH,
    K,
    add_moments,
    length,
    off_plane,
    write_heights,
)
from lidar_outlier_filter.core.kernels import inner_kernel, select
from lidar_outlier_filter.core.lanes import LANES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.evidence.survey_near import Near

    Floats = NDArray[np.float64]
    Singles = NDArray[np.float32]
    Ints = NDArray[np.int64]
    Index = NDArray[np.int32]

MOST, SOME = 60, 20  # neighbours
STEPS = 3  # to any of them, and from there to any of theirs, lead to all that counts
DENSE = 5  # rank of the neighbour that is dense, from 0
GAP = 2.0  # S: a longer distance ends a group
OPPOSITE = -0.8  # cosine of the angle between neighbours, at most

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
    """M points, by their place in tree order, and up to 60 neighbours of each.

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


class FarRoom(NamedTuple):
    """Room to work in, for one thread."""

    near: survey_near.NearRoom
    radii: Floats
    reach: Floats
    scale: Floats
    place: Floats


@inner_kernel
def make_room() -> FarRoom:
    """Make room for points that are measured side by side."""
    near, lists = survey_near.make_room(), np.empty((2, MOST))
    return FarRoom(near, lists[0], lists[1], np.empty(LANES), np.empty((3, MOST)))


@inner_kernel
def write_far(far: Far, points: Ints, rows: Ints, room: FarRoom, values: Singles) -> None:
    """Write all features (COUNT, LANES) of points, whose neighbours are in these rows."""
    near, scale = far.near, room.scale
    survey_near.write_near(near, points, room.near, values)
    for lane in range(LANES):
        p, others = points[lane], far.index[rows[lane]]
        scale[lane] = _write_distances(near, p, others, lane, room, values)
        values[HEIGHTS + 8, lane] = scale[lane] / near.typical
        _gather(near.xyz, p, others, room.place)
        _write_heights(scale[lane], len(others), lane, room, values)
        _write_group(scale[lane], len(others), lane, room, values)
        _write_odds(far.odds, near.index[p], p, others, lane, values)
    for row, most in ((PLANES, SOME), (PLANES + 3, MOST)):
        _write_planes(far, points, rows, min(most, far.index.shape[1]), row, room, values)
    for feature in range(BEGIN, COUNT):
        for lane in range(LANES):
            values[feature, lane] = min(max(values[feature, lane], -FAR), FAR)


@inner_kernel
def _write_distances(
    near: Near, p: int, others: Index, lane: int, room: FarRoom, values: Singles
) -> float:
    """Write the features of distances, and return S."""
    count, radii = len(others), room.radii
    for m in range(count):
        radii[m] = near.radius[others[m]]
    # Ranks of a sorted list: the upper of two in the middle.
    scale = select(radii, count, count // 2) + LEAST
    dense = select(radii, count, min(DENSE, count - 1)) + LEAST
    own = near.radius[p]
    values[BEGIN, lane] = own / scale
    values[BEGIN + 1, lane] = length(near.xyz, p, others[min(SOME, count) - 1]) / scale
    values[BEGIN + 2, lane] = length(near.xyz, p, others[count - 1]) / scale
    values[BEGIN + 3, lane] = own / dense
    values[BEGIN + 4, lane] = scale / room.near.scale[lane]
    return scale


@inner_kernel
def _write_group(scale: float, count: int, lane: int, room: FarRoom, values: Singles) -> None:
    """Join the neighbours one by one (Prim's spanning tree), and write what distances say."""
    place, reach = room.place, room.reach
    x = y = z = 0.0
    reach[:count] = np.inf
    group, longest, before, against, first = count, 0.0, 0, 0.0, 0.0
    for joined in range(count):
        # What is left is kept together at the begin.
        left, best, least = count - joined, 0, np.inf
        for m in range(left):
            dx, dy, dz = place[0, m] - x, place[1, m] - y, place[2, m] - z
            squared = (dx * dx + dy * dy) + dz * dz
            reach[m] = min(reach[m], squared)
        for m in range(left):
            if reach[m] < least:
                best, least = m, reach[m]
        edge = np.sqrt(least)
        first = edge if joined == 0 else first
        if edge > longest:
            against = edge / ((longest if joined > 0 else scale) + LEAST)
            longest, before = edge, joined
        if edge > GAP * scale:
            group = min(group, joined)
        x, y, z = place[0, best], place[1, best], place[2, best]
        reach[best] = reach[left - 1]
        for axis in range(3):
            place[axis, best] = place[axis, left - 1]
    values[BEGIN + 5, lane] = first / scale
    values[BEGIN + 6, lane], values[BEGIN + 7, lane] = longest / scale, before
    values[BEGIN + 8, lane], values[BEGIN + 9, lane] = against, group


@inner_kernel
def _write_planes(
    far: Far, points: Ints, rows: Ints, count: int, row: int, room: FarRoom, values: Singles
) -> None:
    """Write the features of the plane through so many neighbours."""
    work = room.near
    for lane in range(LANES):
        others = far.index[rows[lane]]
        add_moments(far.near.xyz, others, count, points[lane], lane, work.moment, work.mean)
    eigenvalues(work.moment, work.value)
    eigenvectors(work.moment, work.value, NARROW, work.vector)
    for lane in range(LANES):
        off, flat = off_plane(work.mean, work.value, work.vector, lane)
        scale = room.scale[lane]
        values[row, lane], values[row + 1, lane] = off / scale, flat / scale
        values[row + 2, lane] = off / (flat + SMOOTH * scale)


@inner_kernel
def _write_heights(scale: float, count: int, lane: int, room: FarRoom, values: Singles) -> None:
    """Write the features of z."""
    z, some, work = room.place[2], min(SOME, count), room.reach
    for row, these in ((0, some), (2, count)):
        work[:these] = z[:these]
        write_heights(work, these, scale, HEIGHTS + row, HEIGHTS + 4 + row, lane, values)
    higher = 0
    for m in range(count):
        higher += z[m] > 0
    values[HEIGHTS + 9, lane] = higher / count
    low, high = between(room.place, work, some)
    values[HEIGHTS + 10, lane] = low / scale if low < np.inf else 0.0
    values[HEIGHTS + 11, lane] = -high / scale if high > -np.inf else 0.0


@inner_kernel
def between(place: Floats, away: Floats, some: int) -> tuple[float, float]:
    """Return the lowest and highest z, from the point, between two opposite neighbours.

    Without such neighbours they are inf and -inf. ``away`` is room to work in.
    """
    low, high = np.inf, -np.inf
    for m in range(some):
        away[m] = np.sqrt(place[0, m] * place[0, m] + place[1, m] * place[1, m])
    for m in range(some):
        for n in range(m):
            across = place[0, m] * place[0, n] + place[1, m] * place[1, n]
            if across < OPPOSITE * (away[m] * away[n]):
                z = (place[2, m] * away[n] + place[2, n] * away[m]) / (away[m] + away[n])
                low, high = min(low, z), max(high, z)
    return low, high


@inner_kernel
def _gather(xyz: Floats, p: int, others: Index, place: Floats) -> None:
    """Write where the neighbours are, from the point."""
    for m in range(len(others)):
        for axis in range(3):
            place[axis, m] = xyz[others[m], axis] - xyz[p, axis]


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
