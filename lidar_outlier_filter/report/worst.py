# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is rejected of a file, by where it lies, and its largest groups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Floats, Index, Ints
from lidar_outlier_filter.core.neighbours.typical import typical_scale
from lidar_outlier_filter.files.judged_file import JudgedFile

MANY = 10  # points of a large group
TOUCHING = 1.8  # cells apart, of the middles: √3 and a little
MAX_GROUPS = 100  # groups that are kept of a file
ALONE, FEW, LARGE = 'alone', f'in groups of 2 to {MANY - 1}', f'in groups of {MANY} and more'


@dataclass(frozen=True)
class RejectedGroup:
    """Rejected points that lie together.

    Attributes
    ----------
    members : (n,) int64, indices in the file
    count : how many
    middle : of the box around them, in the units of the file
    across, height : of the box, metres
    high : whether most of them are above what is kept around them

    """

    members: Ints
    count: int
    middle: tuple[float, float, float]
    across: float
    height: float
    high: bool


@dataclass(frozen=True)
class Worst:
    """The rejected points of a file.

    Attributes
    ----------
    causes : the sizes of all groups, by where they lie
    groups : the largest
    near : within so many metres, typically, a point of the file has eight others

    """

    causes: Mapping[str, Sequence[int]]
    groups: Sequence[RejectedGroup]
    near: float


def find(judged: JudgedFile) -> Worst:
    """Find the groups of rejected points: those as close together as usual in the file are one."""
    xyz, rejected = judged.loaded.points.xyz, np.flatnonzero(judged.verdict.rejected)
    sides = [f'{side}, {size}' for side in ('below', 'above') for size in (ALONE, FEW, LARGE)]
    causes: dict[str, list[int]] = {name: [] for name in sides}
    near = typical_scale(xyz, np.flatnonzero(judged.loaded.points.valid))
    if not len(rejected):
        return Worst(causes, [], near)
    label = connect(xyz[rejected], near)
    order = np.argsort(label, kind='stable')
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    groups: list[RejectedGroup] = []
    score = judged.verdict.score[rejected]
    for part in sorted(parts, key=lambda part: (-len(part), -score[part].max())):
        high = bool(judged.high[part].mean() > 1 / 2)
        size = ALONE if len(part) == 1 else FEW if len(part) < MANY else LARGE
        causes[f'{"above" if high else "below"}, {size}'].append(len(part))
        if len(groups) < MAX_GROUPS:
            groups.append(_group(judged, rejected[part], high=high))
    return Worst(causes, groups, near)


def _group(judged: JudgedFile, members: Ints, *, high: bool) -> RejectedGroup:
    xyz = judged.loaded.points.xyz[members]
    low, top = xyz.min(axis=0), xyz.max(axis=0)
    x, y, z = ((low + top) / 2 / judged.units).tolist()
    across = float(np.hypot(*(top - low)[:2]))
    return RejectedGroup(members, len(members), (x, y, z), across, float(top[2] - low[2]), high)


def connect(xyz: Floats, cell: float) -> Index:
    """Find the group of each point (N, 3), metres: points in cells that touch are one."""
    cells, of = np.unique(np.floor(xyz / cell), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(TOUCHING, output_type='ndarray')
    ones = np.ones(len(pairs), np.bool_)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    label: Index = connected_components(graph, directed=False)[1]
    return label[of.reshape(-1)]
