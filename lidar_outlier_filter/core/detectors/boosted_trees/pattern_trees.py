# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points judged by their scan pattern: features, and trees that weigh them.

The first pass has the features of each point's window alone. The second pass judges the points that
are not clearly good. It has also the scores of the first pass around them, and how many points have
high ones. The model files say what the trees were trained on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.pattern_values import (
    make_pattern_room,
    no_first_pass,
    write_values,
)
from lidar_outlier_filter.core.detectors.boosted_trees.profile_groups import find_groups
from lidar_outlier_filter.core.detectors.boosted_trees.reasons import strongest_of_trees
from lidar_outlier_filter.core.detectors.boosted_trees.second_pass import FirstPass, count_scores
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    LEAST_LOG_ODDS,
    PATTERN_MODEL,
    PROFILE_MODEL,
    Trees,
    add_lanes,
    load,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared, prepare
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, fill
from lidar_outlier_filter.core.scan_pattern.own_frame import find_own_frame
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    LINES_AT_ONCE,
    Pattern,
    count_points,
    fill_copies,
    lines_at_once,
    spread,
)
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.recovered_rings import as_turn, in_bands
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Singles
    from lidar_outlier_filter.core.points.points import Points

UNSORTED = 0.8  # share of the steps along rings that go the way the head turns, at least


class FoundPattern(NamedTuple):
    """The scan pattern of some points, and whether it is that of a profile scanner."""

    pattern: Pattern
    profile: bool


def find_either(points: Points, sensor: str, threads: int = 0) -> FoundPattern | None:
    """Find the scan pattern of points; None where they have none, so that trees cannot judge them.

    Parameters
    ----------
    points : valid ones
    sensor : 'spinning', 'profile', or 'auto': whichever it is; 'free': one without rings
    threads : at most so many at once; 0 for as many as there are cores

    """
    if sensor == 'free':
        pattern = find_pattern(in_bands(points).in_own_frame, threads, spins=True)
        return None if pattern is None else FoundPattern(pattern, profile=False)
    # A spinning sensor's lines are measured at once, a profile scanner's are not: at most one of
    # the three fits. The frame of points that others may have moved is sought last, as it takes
    # longest.
    recovered = points.ring is not None
    # Azimuths are known in the sensor's own frame only.
    turned, spins = as_turn(points).in_own_frame, recovered or sensor == 'spinning'
    if sensor != 'profile':
        pattern = find_pattern(turned, threads, spins=spins)
        if pattern is not None:
            return FoundPattern(pattern, profile=False)
    if sensor != 'spinning':
        pattern = find_profile_pattern(points, threads)
        if pattern is not None:
            return FoundPattern(pattern, profile=True)
    if sensor == 'profile':
        return None
    pattern = None
    if points.own is None and not recovered:
        moved = find_own_frame(points)
        pattern = None if moved is None else find_pattern(moved.in_own_frame, threads)
    if pattern is None:
        # Rows of a range image, whose azimuths are not sorted.
        pattern = find_pattern(turned, threads, spins=spins, steady=UNSORTED)
    return None if pattern is None else FoundPattern(pattern, profile=False)


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
    threads : at most so many at once; 0 for as many as there are cores
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
        threshold * (model.threshold - LEAST_LOG_ODDS),
        threshold * (model.threshold_bright - LEAST_LOG_ODDS),
    )
    score, rejected = np.empty(count_points(pattern)), np.zeros(len(odds), np.bool_)
    pool.run(
        lambda i, j: _scale(pattern, odds, limit, i, j, score, rejected),
        len(pattern.first),
        lines_at_once(len(pattern.first), len(odds)),
        threads,
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
    """Give each place its log-odds; those of places without a point are 0."""
    pattern = prepared.pattern
    places = len(pattern.order)
    score, all_of_them = np.zeros(places, np.float32), np.ones(places, np.bool_)
    profile, second, nothing = prepared.profile, False, no_first_pass()
    pool.run(
        lambda i, j: _judge(prepared, profile, nothing, second, all_of_them, trees, i, j, score),
        len(pattern.first),
        LINES_AT_ONCE,
        threads,
    )
    return count_scores(pattern, score)


def second_pass(
    prepared: Prepared, first: FirstPass, trees: Trees, doubtful: float, threads: int = 0
) -> Singles:
    """Return the log-odds (M,) of each place: of these trees, where the first are ``doubtful``."""
    result, asked = first.score.copy(), first.score > np.float32(doubtful)
    profile, second = prepared.profile, True
    pool.run(
        lambda i, j: _judge(prepared, profile, first, second, asked, trees, i, j, result),
        len(prepared.pattern.first),
        lines_at_once(len(prepared.pattern.first), len(result)),
        threads,
    )
    return result


@kernel
def _judge(
    prepared: Prepared,
    profile: bool | None,
    first: FirstPass,
    second: bool,
    asked: Bools,
    trees: Trees,
    begin: int,
    end: int,
    result: Singles,
) -> None:
    """Write what trees say of the points of lines begin to end that are asked about."""
    # It takes seconds to compile: the compiler optimizes all that gathers windows, writes features
    # and adds trees up once more, in this one place.
    pattern, room, total = prepared.pattern, make_pattern_room(), np.empty(LANES, np.float32)
    places = room.window.places
    for line in range(begin, end):
        k = pattern.first[line]
        while k < pattern.last[line]:
            count, k = fill(places, asked, k, pattern.last[line])
            if count > 0:
                write_values(prepared, profile, first, second, line, room)
                add_lanes(trees, room.values, total)
            for lane in range(count):
                result[places[lane]] = total[lane]


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
            value = max(float(odds[k]) - LEAST_LOG_ODDS, 0.0) / most
            score[order[k]] = value
            rejected[k] = value > 1
