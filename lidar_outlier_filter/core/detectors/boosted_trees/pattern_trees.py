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

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Index, Ints, Single, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import (
    PROFILE,
    REASON_NAMES,
    SECOND_PASS,
    WINDOW,
    rows,
)
from lidar_outlier_filter.core.detectors.boosted_trees.profile_features import (
    PAIRS,
    find_groups,
    write_profile,
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
    find_valleys,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import load as load_model
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    AROUND,
    COUNT,
    FAR,
    ONE,
    OTHER,
    OWN,
    RANGE,
    RINGS,
    SIZE,
    TWO,
    ZERO,
    F,
    PatternWindow,
    Prepared,
    gather,
    level_within,
    make_window,
    offset_of,
    prepare,
    width,
    write_features,
)
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, next_batch, rows_of_singles
from lidar_outlier_filter.core.kernels.vectors import (
    WIDTH,
    count,
    follow,
    least,
    load,
    most,
    no_counts,
    repeat,
    select,
    single,
    store,
    take,
)
from lidar_outlier_filter.core.scan_pattern.placed_pattern import (
    LINES_AT_ONCE,
    STRETCH,
    Pattern,
    count_points,
    fill_copies,
    lines_at_once,
    spread,
)

MORE = len(PROFILE)
COUNT_ALL = len(WINDOW) + MORE + len(SECOND_PASS)
_NUMBERS = {name: number for number, name in REASON_NAMES.items()}
ROW = rows(SECOND_PASS, COUNT)
CLIP = F(4.0)
UNKNOWN = F(-5.0)
POSITIONS_WIDE = F(2 * STRETCH + 1)  # of the longer stretch
BINS = 8  # of range: up to 1, 2, 4, 8 ... m
# Rows of sums over a window: of clipped scores × a weight, and then of the weights. Those of the
# other rings are behind those of the own one.
OWN_SCORE, OWN_WEIGHT, CLOSE, LEVEL, BEHIND, BEFORE = 0, 2, 4, 6, 8, 10


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
    odds = second_pass(prepared, first, trees.again, trees.doubtful, threads)
    known = odds[pattern.order >= 0]
    (own,) = find_valleys(known, np.array([trees.threshold]), trees.drop)
    score, rejected = scale(pattern, odds, threshold * (float(own) - MIN_LOG_ODDS), threads)
    if reason is not None:
        found = strongest_of_trees(prepared, first, trees, rejected, threads)
        spread(pattern, found, reason)
    return score


def scale(pattern: Pattern, odds: Singles, limit: float, threads: int = 0) -> tuple[Floats, Bools]:
    """Return the scores (N,) of the points as given, and which positions (M,) are rejected.

    Log-odds of ``limit`` above the least make a score of 1.
    """
    score, rejected = np.empty(count_points(pattern)), np.zeros(len(odds), np.bool_)
    pool.run(
        lambda i, j: _scale(pattern, odds, limit, i, j, score, rejected),
        *(len(pattern.first), lines_at_once(len(pattern.first), len(odds)), threads),
    )
    fill_copies(pattern, score)
    return score, rejected


def prepare_all(found: FoundPattern, threads: int = 0) -> Prepared:
    """Compute what the windows of a pattern share, and the groups of a profile scanner."""
    prepared = prepare(found.pattern, threads)
    if found.model != PROFILE_MODEL:
        return prepared
    return prepared._replace(groups=find_groups(found.pattern, prepared.near, threads))


def first_pass(prepared: Prepared, trees: Trees, threads: int = 0) -> FirstPass:
    """Give each place its log-odds; those of positions without a point are 0."""
    score = np.zeros(len(prepared.pattern.order), np.float32)
    write_odds(prepared, None, np.ones(len(score), np.bool_), trees, threads, score)
    return count_scores(prepared.pattern, score)


def second_pass(
    prepared: Prepared, first: FirstPass, trees: Trees, doubtful: float, threads: int = 0
) -> Singles:
    """Return the log-odds (M,) of each place: of these trees, where the first are ``doubtful``."""
    result = first.score.copy()
    write_odds(prepared, first, first.score > np.float32(doubtful), trees, threads, result)
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
    write_odds(prepared, first, every, NO_TREES, threads, np.empty(len(every), np.float32), values)
    return values


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
    """Write the log-odds of the asked points of lines begin to end, and their features.

    ``profile`` is that of ``prepared``, handed on by itself: numba leaves out what is asked of an
    argument that is None.
    """
    # The only place that gathers windows, writes features and adds trees up: each further one would
    # take seconds to compile.
    pattern, window, total = prepared.pattern, make_window(), np.empty(LANES, np.float32)
    pairs, found = rows_of_singles(PAIRS), rows_of_singles(COUNT_ALL)
    positions = window.positions
    for line in range(begin, end):
        k = pattern.first[line]
        while k < pattern.last[line]:
            count, k = next_batch(positions, asked, k, pattern.last[line])
            if count > 0:
                # Positions need not follow each other: each lane gets what it would get alone. The
                # features of the second pass are behind those of the first.
                gather(prepared, line, window)
                write_features(pattern, line, window, found)
                more = 0
                if profile is not None:
                    write_profile(prepared, line, window, pairs, found)
                    more = MORE
                if second:
                    write_scores(pattern, first, line, window, found[more:])
                add_lanes(trees, found, total)
            for lane in range(count):
                odds[positions[lane]] = total[lane]
            if len(values) > 0:
                _copy_values(found, positions[:count], column, values)


@noalias_kernel
def _copy_values(found: Singles, positions: Ints, column: Ints, values: Singles) -> None:
    for lane in range(len(positions)):
        for f in range(len(values)):
            values[f, column[positions[lane]]] = found[f, lane]


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
    limit: float,
    begin: int,
    end: int,
    score: Floats,
    rejected: Bools,
) -> None:
    """Write what :func:`scale` returns of the points of lines begin to end."""
    order = pattern.order
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line]):
            value = max(float(odds[k]) - MIN_LOG_ODDS, 0.0) / limit
            score[order[k]] = value
            rejected[k] = value > 1


# The features of the second pass: log-odds of the first pass around a point -----------------------


@kernel
def count_scores(pattern: Pattern, score: Singles) -> FirstPass:
    """Count the points with a score above 0."""
    positions = len(score)
    before, share = np.zeros(positions + 1, np.int32), np.zeros(positions, np.float32)
    count, above = np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
    of = np.zeros(positions, np.int8)
    for k in range(positions):
        there = pattern.order[k] >= 0
        mine, edge, b = pattern.range[k], ONE, 0
        while b < BINS - 1 and mine > edge:
            b, edge = b + 1, edge * TWO
        flag = there and score[k] > ZERO
        before[k + 1] = before[k] + flag
        count[b] += there
        above[b] += flag
        of[k] = b
    points = outliers = 0
    for b in range(BINS):
        points, outliers = points + count[b], outliers + above[b]
    for k in range(positions):
        share[k] = above[of[k]] / max(count[of[k]], 1)
    return FirstPass(score, before, share, float(np.float32(outliers / max(points, 1))))


@inlined_kernel
def write_scores(
    pattern: Pattern, first: FirstPass, line: int, window: PatternWindow, values: Singles
) -> None:
    """Write the features of the first pass, behind the others, of gathered windows."""
    total, positions = window.scores, window.positions
    for lane in range(0, LANES, WIDTH):
        _sum_scores(pattern, first.score, line, lane, window, total)
    for lane in range(width(values)):
        score = first.score[positions[lane]]
        values[ROW.first, lane] = min(max(score, -CLIP), CLIP)
        values[ROW.first_own, lane] = _mean(total[OWN_SCORE, lane], total[OWN_WEIGHT, lane])
        values[ROW.first_other, lane] = _mean(
            total[OWN_SCORE + 1, lane], total[OWN_WEIGHT + 1, lane]
        )
        values[ROW.first_close, lane] = _mean(total[CLOSE, lane], total[CLOSE + 1, lane])
        values[ROW.first_level, lane] = _mean(total[LEVEL, lane], total[LEVEL + 1, lane])
        values[ROW.first_behind, lane] = _mean(total[BEHIND, lane], total[BEHIND + 1, lane])
        values[ROW.first_before, lane] = _mean(total[BEFORE, lane], total[BEFORE + 1, lane])
    _write_shares(window.others, first, positions, values)


@noalias_kernel
def _sum_scores(
    pattern: Pattern, score: Singles, line: int, lane: int, window: PatternWindow, total: Singles
) -> None:
    """Sum up scores of windows from a lane on: of the ring, other rings, and by where they are."""
    square, away, others = window.square, window.away, window.others
    unit = load(window.mine[RANGE], lane) * pattern.gap[line] + pattern.apart[line]
    same, unit_square = level_within(unit, pattern.level[line]), unit * unit
    near = ZERO - same
    close = close_weight = level = behind = before = repeat(ZERO)
    levels, behinds, befores = no_counts(), no_counts(), no_counts()
    own_in_step = follow(load(window.positions, lane))
    for part in range(2):
        scores, there = repeat(ZERO), no_counts()
        in_step = False
        for slot in range(2 * OWN * part, 2 * OWN if part == 0 else SIZE):
            if part == 0:
                c = take(score, window.positions, lane, offset_of(slot), own_in_step)
            else:
                ring, m = (slot - 2 * OWN) // AROUND, (slot - 2 * OWN) % AROUND
                if m == 0:
                    in_step = follow(load(others, ring * LANES + lane))
                c = take(score, others[ring], lane, m - OTHER, in_step)
            c = least(most(c, -CLIP), CLIP)
            d, off = load(square, slot * LANES + lane), load(away, slot * LANES + lane)
            good = d < FAR
            scores, there = scores + select(good, c, ZERO), count(there, good)
            weight = select(good, unit_square / (unit_square + d), ZERO)
            close, close_weight = close + weight * c, close_weight + weight
            good = good & (abs(off) <= same)
            level, levels = level + select(good, c, ZERO), count(levels, good)
            good = off > same
            behind, behinds = behind + select(good, c, ZERO), count(behinds, good)
            good = off < near
            before, befores = before + select(good, c, ZERO), count(befores, good)
        store(total, (OWN_SCORE + part) * LANES + lane, scores)
        store(total, (OWN_WEIGHT + part) * LANES + lane, single(there))
    store(total, CLOSE * LANES + lane, close)
    store(total, (CLOSE + 1) * LANES + lane, close_weight)
    store(total, LEVEL * LANES + lane, level)
    store(total, (LEVEL + 1) * LANES + lane, single(levels))
    store(total, BEHIND * LANES + lane, behind)
    store(total, (BEHIND + 1) * LANES + lane, single(behinds))
    store(total, BEFORE * LANES + lane, before)
    store(total, (BEFORE + 1) * LANES + lane, single(befores))


@inlined_kernel
def _mean(total: Single, count: Single) -> Single:
    return total / count if count > ZERO else UNKNOWN


@noalias_kernel
def _write_shares(others: Index, first: FirstPass, positions: Ints, values: Singles) -> None:
    """Write the shares of points with a score above 0."""
    before, share = first.before, first.share
    for lane in range(width(values)):
        k = positions[lane]
        some = before[k + STRETCH + 1] - before[k - STRETCH]
        values[ROW.wide_own, lane] = np.float32(some) / POSITIONS_WIDE
        values[ROW.wide_other, lane] = ZERO
        values[ROW.share, lane] = first.whole
        values[ROW.share_range, lane] = share[k]
    for ring in range(len(others)):
        for lane in range(len(positions)):
            j = max(others[ring, lane], STRETCH)
            some = before[j + STRETCH + 1] - before[j - STRETCH]
            every = POSITIONS_WIDE * np.float32(2 * RINGS)
            values[ROW.wide_other, lane] += np.float32(some) / every
