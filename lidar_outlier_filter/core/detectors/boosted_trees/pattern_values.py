# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""All features of points in the scan pattern, as trees see them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.profile_features import PAIRS, write_profile
from lidar_outlier_filter.core.detectors.boosted_trees.second_pass import FirstPass, write_scores
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    PatternWindow,
    gather,
    look_from,
    make_window,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window_features import write_features
from lidar_outlier_filter.core.kernels.kernels import apart_kernel, inlined_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, rows_of_singles

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared

MORE = len(PROFILE)
COUNT_ALL = len(WINDOW) + MORE + len(SECOND_PASS)


def no_first_pass() -> FirstPass:
    """Return a first pass that nothing looks at."""
    empty = np.empty(0, np.float32)
    return FirstPass(empty, np.empty(0, np.int32), empty, 0.0)


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
        more = MORE
    if second:
        write_scores(prepared.pattern, first, line, window, values[more:])


def measure(prepared: Prepared, first: FirstPass | None = None) -> Singles:
    """Return the features (F, M) of all places in one thread, of the second pass if it is given."""
    pattern, second = prepared.pattern, first is not None
    count = len(WINDOW) + (MORE if prepared.profile else 0) + (len(SECOND_PASS) if second else 0)
    out = np.zeros((count, len(pattern.order)), np.float32)
    _measure(prepared, prepared.profile, first or no_first_pass(), second, out)
    return out


@kernel
def _measure(
    prepared: Prepared, profile: bool | None, first: FirstPass, second: bool, out: Singles
) -> None:
    pattern, room = prepared.pattern, make_pattern_room()
    for line in range(len(pattern.first)):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            look_from(k, room.window.places)
            write_values(prepared, profile, first, second, line, room)
            _copy_points(room.values, pattern.last[line] - k, out[:, k:])


@apart_kernel
def _copy_points(values: Singles, count: int, out: Singles) -> None:
    """Copy the features of the first ``count`` lanes, or of all of them."""
    for f in range(len(out)):
        for lane in range(min(count, LANES)):
            out[f, lane] = values[f, lane]
