# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points judged by their scan pattern: features, and trees that weigh them.

The first pass has the features of each point's window alone. The second pass judges the points that
are not clearly good. It has also the scores of the first pass around them, and how many points have
high ones. The model files say what the trees were trained on.

The reason of a rejected point is the feature that adds most to its score, as a number. Where that
is the point's own result of the first pass, it is the strongest feature of that pass. Features
that only say where outliers are likely are no reason, nor are those that trees do not ask about.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import (
    PROFILE,
    REASON_NAMES,
    SECOND_PASS,
    WINDOW,
)
from lidar_outlier_filter.core.detectors.boosted_trees.profile_features import (
    PAIRS,
    find_groups,
    write_profile,
)
from lidar_outlier_filter.core.detectors.boosted_trees.second_pass import (
    NO_FIRST_PASS,
    FirstPass,
    count_scores,
    write_scores,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    NO_TREES,
    PATTERN_MODEL,
    PROFILE_MODEL,
    TreeModel,
    Trees,
    add_lanes,
    contribute,
    load,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    PatternWindow,
    Prepared,
    gather,
    make_window,
    prepare,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window_features import write_features
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, next_batch, rows_of_singles
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    LINES_AT_ONCE,
    Pattern,
    count_points,
    fill_copies,
    lines_at_once,
    spread,
)

MORE = len(PROFILE)
COUNT_ALL = len(WINDOW) + MORE + len(SECOND_PASS)
_NUMBERS = {name: number for number, name in REASON_NAMES.items()}


class FoundPattern(NamedTuple):
    """The scan pattern of some points, and whether it is that of a profile scanner."""

    pattern: Pattern
    profile: bool


def judge(
    pattern: Pattern,
    threshold: float,
    threads: int = 0,
    *,
    profile: bool = False,
    reason: Bytes | None = None,
) -> Floats:
    """Score the N points of a pattern, in the order given.

    Parameters
    ----------
    pattern : of the points
    threshold : the user's: 1 for that of the model, more for fewer rejected
    threads : maximum number of threads; 0: all cores
    profile : whether the pattern is that of a profile scanner
    reason : (N,) is filled with numbers of ``REASON_NAMES``; 0 for points that are not rejected

    Returns
    -------
    (N,) float64
        From 0; more than 1: rejected.

    """
    model = load(PROFILE_MODEL if profile else PATTERN_MODEL)
    prepared = prepare_all(FoundPattern(pattern, profile), threads)
    first = first_pass(prepared, model.first, threads)
    odds = second_pass(prepared, first, model.again, model.doubtful, threads)
    limit = (
        threshold * (model.threshold - MIN_LOG_ODDS),
        threshold * (model.threshold_bright - MIN_LOG_ODDS),
    )
    score, rejected = np.empty(count_points(pattern)), np.zeros(len(odds), np.bool_)
    pool.run(
        lambda i, j: _scale(pattern, odds, limit, i, j, score, rejected),
        *(len(pattern.first), lines_at_once(len(pattern.first), len(odds)), threads),
    )
    fill_copies(pattern, score)
    if reason is not None:
        found = strongest_of_trees(prepared, first, model, rejected, threads)
        spread(pattern, found, reason)
    return score


def prepare_all(found: FoundPattern, threads: int = 0) -> Prepared:
    """Compute what the windows of a pattern share, and the groups of a profile scanner."""
    prepared = prepare(found.pattern, threads)
    if not found.profile:
        return prepared
    return prepared._replace(groups=find_groups(found.pattern, prepared.near, threads))


def first_pass(prepared: Prepared, trees: Trees, threads: int = 0) -> FirstPass:
    """Give each place its log-odds; those of positions without a point are 0."""
    score = np.zeros(len(prepared.pattern.order), np.float32)
    _run(prepared, None, np.ones(len(score), np.bool_), trees, threads, score)
    return count_scores(prepared.pattern, score)


def second_pass(
    prepared: Prepared, first: FirstPass, trees: Trees, doubtful: float, threads: int = 0
) -> Singles:
    """Return the log-odds (M,) of each place: of these trees, where the first are ``doubtful``."""
    result = first.score.copy()
    _run(prepared, first, first.score > np.float32(doubtful), trees, threads, result)
    return result


def measure(
    prepared: Prepared,
    first: FirstPass | None = None,
    asked: Bools | None = None,
    threads: int = 1,
) -> Singles:
    """Return the features (F, W) of the asked positions (M,), or of all; of either pass.

    Without a point, a place has features of 0.
    """
    count = len(WINDOW) + len(PROFILE) * bool(prepared.profile)
    count += len(SECOND_PASS) * (first is not None)
    every = np.ones(len(prepared.pattern.order), np.bool_) if asked is None else asked
    values = np.zeros((count, np.count_nonzero(every)), np.float32)
    _run(prepared, first, every, NO_TREES, threads, np.empty(len(every), np.float32), values)
    return values


def _run(
    prepared: Prepared,
    first: FirstPass | None,
    asked: Bools,
    trees: Trees,
    threads: int,
    odds: Singles,
    values: Singles = np.empty((0, 0), np.float32),  # noqa: B008  nothing is written
) -> None:
    """Write the log-odds (M,) of the asked positions (M,); features if ``values`` has rows."""
    pattern, profile, second = prepared.pattern, prepared.profile, first is not None
    given = first or NO_FIRST_PASS
    column = np.cumsum(asked) - 1 if len(values) > 0 else np.empty(0, np.int64)
    # The first pass judges all positions, which takes long.
    at_once = lines_at_once(len(pattern.first), len(odds)) if second else LINES_AT_ONCE
    pool.run(
        lambda i, j: _judge(
            *(prepared, profile, given, second, asked, trees, column, i, j, odds, values)
        ),
        *(len(pattern.first), at_once, threads),
    )


@kernel
def _judge(
    prepared: Prepared,
    profile: bool | None,
    first: FirstPass,
    second: bool,
    asked: Bools,
    trees: Trees,
    column: Ints,
    begin: int,
    end: int,
    odds: Singles,
    values: Singles,
) -> None:
    """Write the log-odds of the asked points of lines begin to end, and their features."""
    # The only place that gathers windows, writes features and adds trees up: each further one would
    # take seconds to compile.
    pattern, room, total = prepared.pattern, make_pattern_room(), np.empty(LANES, np.float32)
    positions = room.window.positions
    for line in range(begin, end):
        k = pattern.first[line]
        while k < pattern.last[line]:
            count, k = next_batch(positions, asked, k, pattern.last[line])
            if count > 0:
                write_values(prepared, profile, first, second, line, room)
                add_lanes(trees, room.values, total)
            for lane in range(count):
                odds[positions[lane]] = total[lane]
            if len(values) > 0:
                _copy_values(room.values, positions[:count], column, values)


@noalias_kernel
def _copy_values(found: Singles, positions: Ints, column: Ints, values: Singles) -> None:
    for lane in range(len(positions)):
        for f in range(len(values)):
            values[f, column[positions[lane]]] = found[f, lane]


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
    """Write the features of points of a line, at the window's positions; of either pass.

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


def strongest_of_trees(
    prepared: Prepared,
    first: FirstPass,
    model: TreeModel,
    selected: Bools,
    threads: int = 0,
) -> Bytes:
    """Return the number (M,) of the feature that adds most to the log-odds of each selected place.

    Parameters
    ----------
    prepared : the pattern that was judged
    first : the result of the first pass
    model : the model of the pattern
    selected : (M,) bool, positions to explain; others have 0
    threads : maximum number of threads; 0: all cores

    """
    names = (*WINDOW, *(PROFILE if prepared.profile else ()), *SECOND_PASS)
    numbers = np.array([_NUMBERS.get(name, 0) for name in names], np.uint8)
    values = measure(prepared, first, selected, threads)
    found = np.full(values.shape[1], _NUMBERS['first'], np.uint8)
    again = first.score[selected] > np.float32(model.doubtful)
    found[again] = _strongest(model.again, values[:, again], numbers)
    before = found == _NUMBERS['first']
    found[before] = _strongest(model.first, values[:, before], numbers)
    reason = np.zeros(len(selected), np.uint8)
    reason[selected] = found
    return reason


def _strongest(trees: Trees, values: Singles, numbers: Bytes) -> Bytes:
    """Return the number (W,) of the feature that adds most to each point; 0: no feature.

    A feature that adds nothing is no reason: no tree asked about it, or it made no difference.
    """
    added = contribute(trees, values)
    added[(numbers == 0)[:, None] | (added == 0)] = -np.inf
    found = np.where(added.max(axis=0) > -np.inf, numbers[added.argmax(axis=0)], 0)
    return found.astype(np.uint8)


@kernel
def _scale(
    pattern: Pattern,
    odds: Singles,
    limit: tuple[float, float],
    begin: int,
    end: int,
    score: Floats,
    rejected: Bools,
) -> None:
    """Write the scores of the points of lines begin to end, as given, and which are rejected.

    Log-odds of ``limit`` above the least make a score of 1: without a brightness, and with one.
    """
    order, bright = pattern.order, pattern.bright
    dark_limit, bright_limit = limit
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line]):
            most = bright_limit if bright[k] >= 0 else dark_limit
            value = max(float(odds[k]) - MIN_LOG_ODDS, 0.0) / most
            score[order[k]] = value
            rejected[k] = value > 1
