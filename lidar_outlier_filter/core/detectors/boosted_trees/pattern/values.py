# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""All features that the trees ask of points: of either sensor, in either pass."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lidar_outlier_filter.core.detectors.boosted_trees.pattern.features import write_features
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.profile_features import (
    COUNT_ALL,
    COUNT_PROFILE,
    PAIRS,
    write_profile,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import write_scores
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.window import (
    PatternWindow,
    gather,
    make_window,
)
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel
from lidar_outlier_filter.core.kernels.lanes import rows_of_singles

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import FirstPass
    from lidar_outlier_filter.core.detectors.boosted_trees.pattern.window import Prepared


class PatternRoom(NamedTuple):
    """Room to work in, for one thread.

    Attributes
    ----------
    window : of the points
    pairs : (PAIRS, LANES) float32
        Of a profile scanner, what pairs of returns predict.
    values : (COUNT_ALL, LANES) float32
        The features; those of the second pass behind those of the first.

    """

    window: PatternWindow
    pairs: Singles
    values: Singles


@inlined_kernel
def make_pattern_room() -> PatternRoom:
    """Make room for one thread."""
    return PatternRoom(make_window(), rows_of_singles(PAIRS), rows_of_singles(COUNT_ALL))


@inlined_kernel
def write_values(
    prepared: Prepared,
    profile: bool | None,
    first: FirstPass,
    second: bool,
    line: int,
    room: PatternRoom,
) -> None:
    """Write the features of points of a line, at the window's places; of the second pass if asked.

    They need not follow each other: each lane gets what it would get alone. ``profile`` is that of
    ``prepared``, handed on by itself: numba leaves out what is asked of an argument that is None.
    """
    window, values = room.window, room.values
    gather(prepared, line, window)
    write_features(prepared.pattern, line, window, values)
    more = 0
    if profile is not None:
        write_profile(prepared, line, window, room.pairs, values)
        more = COUNT_PROFILE
    if second:
        write_scores(prepared.pattern, first, line, window, values[more:])
