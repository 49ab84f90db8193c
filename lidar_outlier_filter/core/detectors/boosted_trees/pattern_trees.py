# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points judged by their scan pattern: features, and trees that weigh them.

The first pass has the features of each point's window alone. The second pass judges the points that
are not clearly good. It has also the scores of the first pass around them, and how many points have
high ones. The model files say what the trees were trained on.

Points between two surfaces resemble no other outlier, and have trees of their own where a model has
them: the higher result counts.

The reason of a rejected point is the feature that adds most to its score, as a number. Where that
is the point's own result of the first pass, it is the strongest feature of that pass. Features
that only say where outliers are likely are no reason, nor are those that trees do not ask about.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Index, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import (
    PANE,
    PROFILE,
    REASON_NUMBERS,
    SECOND_PASS,
    WINDOW,
)
from lidar_outlier_filter.core.detectors.boosted_trees.profile_features import find_of_block
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    NO_TREES,
    PATTERN_MODEL,
    PROFILE_MODEL,
    TreeModel,
    Trees,
    contribute,
    find_valleys,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import load as load_model
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared, prepare
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    LINES_AT_ONCE,
    Pattern,
    count_points,
    fill_copies,
    lines_at_once,
    spread,
)

# Trees on mixed pixels judge from these log-odds of the first pass on, and what stands off so far,
# metres, from the returns beside it, the nearer and the other.
MIXED_FROM, OFF_NEARER, OFF_OTHER = np.float32(-7.0), 0.02, 0.06
# Trees on ghosts judge from these log-odds of the first pass on.
MIRRORED_FROM = np.float32(-2.0)
PANES_AT_ONCE = 512  # points whose planes a thread finds


class FoundPattern(NamedTuple):
    """The scan pattern of some points, and the name of the model for it."""

    pattern: Pattern
    model: str


class FirstPass(NamedTuple):
    """Scores of the first pass, and how many points have one above 0.

    Attributes
    ----------
    score : (M,) float32
        Of each place.
    before : (M + 1,) int32
        Points with a score above 0 up to each place.
    share : (M,) float32
        Of all points as far as each.
    whole : float
        Of all points.

    """

    score: Singles
    before: Index
    share: Singles
    whole: float


_NONE = np.empty(0, np.float32)
NO_FIRST_PASS = FirstPass(_NONE, np.empty(0, np.int32), _NONE, 0.0)  # of the first pass itself


def judge(
    pattern: Pattern,
    threshold: float,
    threads: int = 0,
    *,
    model: str = PATTERN_MODEL,
    reason: Bytes | None = None,
) -> Floats:
    """Score the N points of a pattern, in the order given.

    Parameters
    ----------
    pattern : of the points
    threshold : the user's: 1 for that of the model, more for fewer rejected
    threads : maximum number of threads; 0: all cores
    model : the name of the model for the pattern
    reason : (N,) is filled with numbers of ``REASON_NAMES``; 0 for points that are not rejected

    Returns
    -------
    (N,) float64
        From 0; more than 1: rejected.

    """
    trees, prepared = load_model(model), prepare_all(FoundPattern(pattern, model), threads)
    first = first_pass(prepared, trees.first, threads)
    odds = second_pass(prepared, first, trees, threads)
    (own,) = find_valleys(odds[pattern.order >= 0], np.array([trees.threshold]), trees.drop)
    cause = raise_mixed(prepared, first, trees.mixed, odds, threads)
    raise_ghosts(prepared, first, trees, float(own), odds, cause, threads)
    score, rejected = scale(pattern, odds, threshold * (float(own) - MIN_LOG_ODDS), threads)
    if reason is not None:
        alone = rejected & (cause > 0)
        found = strongest_of_trees(prepared, first, trees, rejected & ~alone, threads)
        found[alone] = cause[alone]
        spread(pattern, found, reason)
    return score


def scale(pattern: Pattern, odds: Singles, limit: float, threads: int = 0) -> tuple[Floats, Bools]:
    """Return the scores (N,) of the points as given, and which positions (M,) are rejected.

    Log-odds of ``limit`` above the least make a score of 1.
    """
    score, rejected = np.empty(count_points(pattern)), np.zeros(len(odds), np.bool_)
    pool.run(
        lambda i, j: _kernels.scale_odds(
            *(pattern, odds, MIN_LOG_ODDS, limit, i, j, score, rejected)
        ),
        *(len(pattern.first), lines_at_once(len(pattern.first), len(odds)), threads),
    )
    fill_copies(pattern, score)
    return score, rejected


def prepare_all(found: FoundPattern, threads: int = 0) -> Prepared:
    """Compute what the windows of a pattern share, and what all lines of a profile scanner do."""
    prepared = prepare(found.pattern, threads)
    if found.model != PROFILE_MODEL:
        return prepared
    return prepared._replace(of_block=find_of_block(found.pattern, prepared.near, threads))


def first_pass(prepared: Prepared, trees: Trees, threads: int = 0) -> FirstPass:
    """Give each place its log-odds; those of positions without a point are 0."""
    score = np.zeros(len(prepared.pattern.order), np.float32)
    write_odds(prepared, None, np.ones(len(score), np.bool_), trees, threads, score)
    return count_scores(prepared.pattern, score)


def second_pass(
    prepared: Prepared, first: FirstPass, model: TreeModel, threads: int = 0
) -> Singles:
    """Return the log-odds (M,) of each place: of these trees, where the first are doubtful."""
    result, doubtful = first.score.copy(), first.score > np.float32(model.doubtful)
    write_odds(prepared, first, doubtful, model.again, threads, result)
    return result


def raise_mixed(
    prepared: Prepared, first: FirstPass, trees: Trees, odds: Singles, threads: int = 0
) -> Bytes:
    """Raise log-odds (M,) to those of being between two surfaces.

    Returns the reason's number (M,) of places that rise, and 0 of others.
    """
    cause = np.zeros(len(odds), np.uint8)
    if len(trees.value) > 0:  # of profile scanners
        between = np.full(len(odds), MIN_LOG_ODDS, np.float32)
        asked = may_be_mixed(prepared.pattern, first.score)
        write_odds(prepared, None, asked, trees, threads, between)
        cause[between > odds] = REASON_NUMBERS['between_surfaces']
        np.maximum(odds, between, out=odds)
    return cause


def raise_ghosts(
    prepared: Prepared,
    first: FirstPass,
    model: TreeModel,
    limit: float,
    odds: Singles,
    cause: Bytes,
    threads: int = 0,
) -> None:
    """Raise log-odds (M,) to those of being mirrored, and write the reason's number (M,).

    How much lower the block's threshold ``limit`` is than the model's does not count.
    """
    if len(model.ghosts.value) == 0:
        return
    places, values = find_mirrored(prepared, first, odds <= limit, threads)
    mirrored = np.empty(len(places), np.float32)
    _kernels.add_trees(model.ghosts, values, mirrored)
    mirrored += np.float32(limit - model.threshold)
    rises = mirrored > odds[places]
    odds[places[rises]], cause[places[rises]] = mirrored[rises], REASON_NUMBERS['mirrored']


def find_mirrored(
    prepared: Prepared, first: FirstPass, kept: Bools, threads: int = 0
) -> tuple[Ints, Singles]:
    """Return the places (W,) of points that may be mirrored, of the kept (M,), and their features.

    These are ``OF_GHOSTS``, (F, W).
    """
    asked = kept & (first.score > MIRRORED_FROM) & (prepared.pattern.order >= 0)
    places = np.flatnonzero(asked)
    panes = np.zeros((len(PANE), len(places)), np.float32)
    pool.run(
        lambda i, j: _kernels.find_panes(prepared, places, i, j, panes),
        *(len(places), PANES_AT_ONCE, threads),
    )
    behind = panes[0] > 0
    asked[places] = behind
    values = np.concatenate([measure(prepared, first, asked, threads), panes[:, behind]])
    return places[behind], values


def may_be_mixed(pattern: Pattern, score: Singles) -> Bools:
    """Return which places (M,) trees on mixed pixels judge."""
    return stands_off(pattern, OFF_NEARER, OFF_OTHER) & (score > MIXED_FROM)


def stands_off(pattern: Pattern, nearer: float, other: float) -> Bools:
    """Return which places (M,) differ so much in range, metres, from both beside them."""
    gap = np.abs(np.diff(pattern.range))
    found = np.zeros(len(pattern.range), np.bool_)
    found[1:-1] = np.minimum(gap[:-1], gap[1:]) > np.float32(nearer)
    found[1:-1] &= np.maximum(gap[:-1], gap[1:]) > np.float32(other)
    return found & (pattern.order >= 0)


def measure(
    prepared: Prepared,
    first: FirstPass | None = None,
    asked: Bools | None = None,
    threads: int = 1,
) -> Singles:
    """Return the features (F, W) of the asked positions (M,), or of all; of either pass.

    Without a point, a place has features of 0.
    """
    count = _count_features(prepared, second=first is not None)
    every = np.ones(len(prepared.pattern.order), np.bool_) if asked is None else asked
    values = np.zeros((count, np.count_nonzero(every)), np.float32)
    write_odds(prepared, first, every, NO_TREES, threads, np.empty(len(every), np.float32), values)
    return values


def _count_features(prepared: Prepared, *, second: bool) -> int:
    """Return how many features a pass over a pattern has."""
    return len(WINDOW) + len(PROFILE) * (len(prepared.of_block) > 0) + len(SECOND_PASS) * second


def write_odds(
    prepared: Prepared,
    first: FirstPass | None,
    asked: Bools,
    trees: Trees,
    threads: int,
    odds: Singles,
    values: Singles = np.empty((0, 0), np.float32),  # noqa: B008  nothing is written
) -> None:
    """Write the log-odds (M,) of the asked positions (M,); features if ``values`` has rows."""
    pattern, second = prepared.pattern, first is not None
    given = first or NO_FIRST_PASS
    column = np.cumsum(asked) - 1 if len(values) > 0 else np.empty(0, np.int64)
    # The first pass judges all positions, which takes long.
    at_once = lines_at_once(len(pattern.first), len(odds)) if second else LINES_AT_ONCE
    pool.run(
        lambda i, j: _kernels.judge_pattern(
            *(prepared, given, second, asked, trees, column, i, j, odds, values)
        ),
        *(len(pattern.first), at_once, threads),
    )


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
    names = (*WINDOW, *(PROFILE if len(prepared.of_block) > 0 else ()), *SECOND_PASS)
    numbers = np.array([REASON_NUMBERS.get(name, 0) for name in names], np.uint8)
    values = measure(prepared, first, selected, threads)
    found = np.full(values.shape[1], REASON_NUMBERS['first'], np.uint8)
    again = first.score[selected] > np.float32(model.doubtful)
    found[again] = _strongest(model.again, values[:, again], numbers)
    before = found == REASON_NUMBERS['first']
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


def count_scores(pattern: Pattern, score: Singles) -> FirstPass:
    """Count the points with a score above 0."""
    return FirstPass(score, *_kernels.count_scores(pattern, score))
