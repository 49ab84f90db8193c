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
    make_window,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window_features import write_features
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import fill, rows_of_singles
from lidar_outlier_filter.core.scan_pattern.placed_pattern import LINES_AT_ONCE

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Bools, Ints, Singles
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


def measure(
    prepared: Prepared,
    first: FirstPass | None = None,
    asked: Bools | None = None,
    threads: int = 1,
) -> Singles:
    """Return the features (F, W) of the asked places (M,), or of all; of the second pass if given.

    Without a point, a place has features of 0.
    """
    pattern, profile, second = prepared.pattern, prepared.profile, first is not None
    given = first or no_first_pass()
    every = np.ones(len(pattern.order), np.bool_) if asked is None else asked
    column = np.cumsum(every) - 1
    count = len(WINDOW) + (MORE if profile else 0) + (len(SECOND_PASS) if second else 0)
    out = np.zeros((count, np.count_nonzero(every)), np.float32)
    pool.run(
        lambda i, j: _measure(prepared, profile, given, second, every, column, i, j, out),
        *(len(pattern.first), LINES_AT_ONCE, threads),
    )
    return out


@kernel
def _measure(
    prepared: Prepared,
    profile: bool | None,
    first: FirstPass,
    second: bool,
    asked: Bools,
    column: Ints,
    begin: int,
    end: int,
    out: Singles,
) -> None:
    """Write the features of the asked points of lines begin to end into their columns."""
    pattern, room = prepared.pattern, make_pattern_room()
    places = room.window.places
    for line in range(begin, end):
        k = pattern.first[line]
        while k < pattern.last[line]:
            count, k = fill(places, asked, k, pattern.last[line])
            if count > 0:
                write_values(prepared, profile, first, second, line, room)
            for lane in range(count):
                for f in range(len(out)):
                    out[f, column[places[lane]]] = room.values[f, lane]
