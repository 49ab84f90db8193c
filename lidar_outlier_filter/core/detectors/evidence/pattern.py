# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points judged by their scan pattern: features, and trees that weigh them.

The first pass has the features of each point's window alone. The second pass judges the points that
are not clearly good. It has also the scores of the first pass around them, and how many points have
high ones. The trees were trained; :mod:`.pattern_model` says on what.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core import threads as pool
from lidar_outlier_filter.core.detectors.evidence.pattern_features import write_features
from lidar_outlier_filter.core.detectors.evidence.pattern_model import (
    PATTERN_MODEL,
    PROFILE_MODEL,
    load,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_scores import (
    FirstPass,
    count_scores,
    write_scores,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_window import (
    Prepared,
    gather,
    make_window,
    prepare,
)
from lidar_outlier_filter.core.detectors.evidence.profile_features import (
    COUNT_ALL,
    COUNT_PROFILE,
    make_pairs,
    write_profile,
)
from lidar_outlier_filter.core.detectors.evidence.profile_groups import find_groups
from lidar_outlier_filter.core.detectors.evidence.trees import Trees, add_up
from lidar_outlier_filter.core.kernels import kernel
from lidar_outlier_filter.core.lanes import LANES
from lidar_outlier_filter.core.neighbours.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.neighbours.scan_pattern import LINES_AT_ONCE, Pattern, find_pattern

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points import Points

    Floats = NDArray[np.float64]
    Singles = NDArray[np.float32]

LEAST = -8.0  # log-odds that make a score of 0


class FoundPattern(NamedTuple):
    """The scan pattern of some points, and whether it is that of a profile scanner."""

    pattern: Pattern
    profile: bool


def find_either(points: Points, sensor: str, threads: int = 0) -> FoundPattern | None:
    """Find the scan pattern of points; None where they have none, so that trees cannot judge them.

    Parameters
    ----------
    points : valid ones
    sensor : 'spinning', 'profile', or 'auto': whichever it is
    threads : at most so many at once; 0 for as many as there are cores

    """
    if sensor != 'profile':
        # Azimuths are known in the sensor's own frame only.
        pattern = find_pattern(points.in_own_frame, threads, spins=sensor == 'spinning')
        if pattern is not None:
            return FoundPattern(pattern, profile=False)
    if sensor != 'spinning':
        pattern = find_profile_pattern(points, threads)
        if pattern is not None:
            return FoundPattern(pattern, profile=True)
    return None


def judge(pattern: Pattern, threshold: float, threads: int = 0, *, profile: bool = False) -> Floats:
    """Score the N points of a pattern, in the order given.

    Parameters
    ----------
    pattern : of the points
    threshold : the user's: 1 for that of the model, more for fewer rejected
    threads : at most so many at once; 0 for as many as there are cores
    profile : whether the pattern is that of a profile scanner

    Returns
    -------
    (N,) float64
        From 0; more than 1: rejected.

    """
    model = load(PROFILE_MODEL if profile else PATTERN_MODEL)
    prepared = prepare(pattern, threads)
    if profile:
        groups = find_groups(pattern, prepared.near, threads)
        prepared = prepared._replace(groups=groups)
    odds = log_odds(prepared, model.first, model.again, model.doubtful, threads)
    there = pattern.order >= 0
    score = np.empty(int(np.count_nonzero(there)))
    statistic = np.maximum(odds[there].astype(np.float64) - LEAST, 0.0)
    score[pattern.order[there]] = statistic / (threshold * (model.threshold - LEAST))
    return score


def log_odds(
    prepared: Prepared, first: Trees, again: Trees, doubtful: float, threads: int = 0
) -> Singles:
    """Return the log-odds (M,) of each place; those of places without a point mean nothing.

    The second trees judge the points to which the first give more than ``doubtful``.
    """
    pattern = prepared.pattern
    lines = len(pattern.first)
    score = np.zeros(len(pattern.order), np.float32)
    pool.run(lambda i, j: _first(prepared, first, i, j, score), lines, LINES_AT_ONCE, threads)
    passed = count_scores(pattern, score)
    result = score.copy()
    low = np.float32(doubtful)
    pool.run(
        lambda i, j: _again(prepared, passed, again, low, i, j, result),
        lines,
        LINES_AT_ONCE,
        threads,
    )
    return result


@kernel
def _first(prepared: Prepared, trees: Trees, begin: int, end: int, score: Singles) -> None:
    pattern, window, pairs = prepared.pattern, make_window(), make_pairs()
    values, total = np.empty((COUNT_ALL, LANES), np.float32), np.empty(LANES, np.float32)
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            gather(prepared, line, k, window)
            write_features(pattern, line, k, window, values)
            if len(prepared.groups) > 0:
                write_profile(prepared, line, k, window, pairs, values)
            add_up(trees, values, total)
            for lane in range(min(pattern.last[line] - k, LANES)):
                score[k + lane] = total[lane]


@kernel
def _again(
    prepared: Prepared,
    first: FirstPass,
    trees: Trees,
    doubtful: np.float32,
    begin: int,
    end: int,
    result: Singles,
) -> None:
    pattern, window, pairs = prepared.pattern, make_window(), make_pairs()
    values, total = np.empty((COUNT_ALL, LANES), np.float32), np.empty(LANES, np.float32)
    score, more = first.score, COUNT_PROFILE if len(prepared.groups) > 0 else 0
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            count = min(pattern.last[line] - k, LANES)
            asked = False
            for lane in range(count):
                asked |= score[k + lane] > doubtful
            if not asked:
                continue
            gather(prepared, line, k, window)
            write_features(pattern, line, k, window, values)
            if len(prepared.groups) > 0:
                write_profile(prepared, line, k, window, pairs, values)
            write_scores(prepared, first, line, k, window, values[more:])
            add_up(trees, values, total)
            for lane in range(count):
                if score[k + lane] > doubtful:
                    result[k + lane] = total[lane]
