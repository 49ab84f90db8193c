# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Features of profile scanners alone: predictions by pairs of returns, free groups, and heights.

Two returns of the window that lie opposite each other predict the range between them: those as many
positions before and after in the line, and those of lines before and after. On a surface all pairs
agree, and so do all about a point that is off it.

Returns that follow each other closely are a segment of their line. Segments of more than
40 returns are surfaces. Smaller ones that are close to each other on neighbouring
lines are a group, and a group is free unless it is close to a surface. An arm that moves while the
scanner passes is such a group, straight and slanted; a pole stands on the road, and upright. z must
be up. Returns are joined twice: widely, so that a group stays whole, and narrowly, so that a group
separates from a car that it nearly touches.

A mirror image of a house lies below a wet road. The height of a point is that above the floor of
the block, see :mod:`.floor`, from columns of one metre and one point in four of a line.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Index, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern, lines_at_once

GROUPS = tuple(name for name in PROFILE if name.startswith('group'))
COLUMN = 1.0  # metres: side of the columns of the floor
EVERY = 4  # points, of which one makes the floor
REACHES = (4.0, 1.6)  # × what beams are apart: up to which returns are joined
NO_GROUP = np.float32(-1.0)


class Segments(NamedTuple):
    """The segments of all lines, numbered from 0.

    Attributes
    ----------
    of : (M,) int32
        The segment of each place; -1 where there is no point.
    size : (S,) int32
        How many returns each has.

    """

    of: Index
    size: Index


def find_of_block(pattern: Pattern, near: Index, threads: int = 0) -> Singles:
    """Return what all lines together give each place (6, M): its free group, and its height.

    Parameters: see :func:`find_groups`.
    """
    heights = find_heights(pattern, threads)[None]
    return np.concatenate([find_groups(pattern, near, threads), heights])


def find_heights(pattern: Pattern, threads: int = 0) -> Singles:
    """Return how high each place (M,) is above the floor of the block, metres; 0: no point."""
    some = np.flatnonzero(pattern.order >= 0)[::EVERY]
    xyz = np.stack([pattern.x[some], pattern.y[some], pattern.z[some]], axis=1, dtype=np.float64)
    around = measure_floor(xyz, np.arange(len(some)), threads, COLUMN)
    out, lines = np.zeros(len(pattern.order), np.float32), len(pattern.first)
    pool.run(
        lambda i, j: _kernels.write_heights(pattern, around, i, j, out),
        *(lines, lines_at_once(lines, len(out)), threads),
    )
    return out


def find_groups(pattern: Pattern, near: Index, threads: int = 0) -> Singles:
    """Describe the free group that each point is in.

    Parameters
    ----------
    pattern : of the points, in M positions
    near : (4, M) the nearest place on each line beside
    threads : maximum number of threads; 0: all cores

    Returns
    -------
    (5, M) float32
        Of ``GROUPS``; of the wide group, where there is one.

    """
    out = np.full((len(GROUPS), len(pattern.order)), NO_GROUP)

    def find(n: int, _end: int) -> tuple[Segments, Index, Singles]:
        segments = Segments(*_kernels.find_segments(pattern, REACHES[n]))
        group = _kernels.join_segments(pattern, near, REACHES[n], segments)
        return segments, group, _kernels.describe_groups(pattern, segments, group)

    # The wide groups last, so that they are what stays.
    for found in reversed(pool.run(find, len(REACHES), 1, threads)):
        _kernels.write_groups(pattern, *found, out)
    return out
