# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of the second pass: log-odds of the first pass around a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Index, Ints, Single, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import SECOND_PASS, rows
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    AROUND,
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
    offset_of,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window_features import (
    COUNT,
    level_within,
    width,
)
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.lanes import LANES
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
from lidar_outlier_filter.core.scan_pattern.placed_pattern import STRETCH, Pattern

ROW = rows(SECOND_PASS, COUNT)
CLIP = F(4.0)
UNKNOWN = F(-5.0)
POSITIONS_WIDE = F(2 * STRETCH + 1)  # of the longer stretch
BINS = 8  # of range: up to 1, 2, 4, 8 ... m
# Rows of sums over a window: of clipped scores × a weight, and then of the weights. Those of the
# other rings are behind those of the own one.
OWN_SCORE, OWN_WEIGHT, CLOSE, LEVEL, BEHIND, BEFORE = 0, 2, 4, 6, 8, 10


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
