# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Groups of rejected points that lie together, the largest first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.report.frames import Frames
    from lidar_outlier_filter.report.keeping import Kept

CELL = 0.25  # metres: points in cells that touch, also at a corner, are one group
MOST_GROUPS = 200  # that are listed
TOUCHING = 1.8  # cells apart, of the middles: √3 and a little


@dataclass(frozen=True)
class Group:
    """Rejected points that lie together.

    Attributes
    ----------
    frame : the number of the frame of its worst point
    count : points
    middle, size : of the box around them, metres
    range : least distance from the sensor, metres
    worst : the point with the largest score, its place in its frame

    """

    frame: int
    count: int
    middle: tuple[float, float, float]
    size: tuple[float, float, float]
    range: float
    worst: int


def find(kept: Kept, frames: Frames) -> tuple[list[Group], int]:
    """Find the groups; return the largest, and how many there are.

    Of frames that lie beside each other together, of others frame by frame.
    """
    counts = np.diff(frames.first)
    number = np.repeat(np.arange(len(frames)), counts)
    place = np.arange(len(number)) - frames.first[:-1][number]
    rejected = np.flatnonzero(kept.rejected[frames.order])
    ends = np.searchsorted(number[rejected], np.arange(len(frames) + 1))
    parts = [rejected] if frames.together else np.split(rejected, ends[1:-1])
    found: list[Group] = []
    total = 0
    for part in parts:
        if len(part) == 0:
            continue
        groups = _of_part(kept, frames.order[part], number[part], place[part])
        total += len(groups)
        found = sorted(found + groups, key=lambda group: -group.count)[:MOST_GROUPS]
    return found, total


def _of_part(
    kept: Kept, members: NDArray[np.int64], frame: NDArray[np.int64], place: NDArray[np.int64]
) -> list[Group]:
    """Find the groups among points that lie together; ``frame`` and ``place`` say where each is."""
    xyz = kept.xyz[members]
    label = connect(xyz)
    order = np.argsort(label, kind='stable')
    score = np.nan_to_num(kept.score[members], nan=-1.0)
    groups = []
    for part in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        low, high = xyz[part].min(axis=0), xyz[part].max(axis=0)
        worst = part[np.argmax(score[part])]
        groups.append(
            Group(
                int(frame[worst]),
                len(part),
                tuple(((low + high) / 2).tolist()),
                tuple((high - low).tolist()),
                float(kept.range[members[part]].min()),
                int(place[worst]),
            )
        )
    return groups


def connect(xyz: NDArray[np.float64], cell: float = CELL) -> NDArray[np.int32]:
    """Find the group of each point (N, 3), metres: points in cells that touch are one."""
    cells, of = np.unique(np.floor(xyz / cell), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(TOUCHING, output_type='ndarray')
    ones = np.ones(len(pairs), np.bool_)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    label: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return label[of.reshape(-1)]
