# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Features of the second pass: those of the window, and scores of the first pass around it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.evidence.pattern.features import (
    COUNT,
    copy_points,
    level_within,
    width,
    write_features,
)
from lidar_outlier_filter.core.detectors.evidence.pattern.window import (
    AROUND,
    FAR,
    ONE,
    OTHER,
    OWN,
    RINGS,
    SIZE,
    TWO,
    ZERO,
    F,
    gather,
    make_window,
    place_of,
)
from lidar_outlier_filter.core.kernels.kernels import apart_kernel, inlined_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, rows_of_singles
from lidar_outlier_filter.core.neighbours.placed_pattern import STRETCH

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Index, Single, Singles
    from lidar_outlier_filter.core.detectors.evidence.pattern.window import PatternWindow, Prepared
    from lidar_outlier_filter.core.neighbours.placed_pattern import Pattern

AGAIN = (
    'first',  # score of the first pass, -4 to 4
    'first_own',  # mean of those of the ring's returns
    'first_other',  # of other rings'
    'first_close',  # of all, the closer the more weight
    'first_level',  # of those at the same range; -5 for none
    'first_behind',  # of those farther from the sensor; -5 for none
    'first_before',
    'wide_own',  # share of a longer stretch of the ring whose score is above 0
    'wide_other',  # the same of other rings
    'share',  # of all points seen together
    'share_range',  # of those of them that are as far from the sensor
)
COUNT_AGAIN = COUNT + len(AGAIN)
CLIP = F(4.0)
UNKNOWN = F(-5.0)
PLACES_WIDE = F(2 * STRETCH + 1)  # of the longer stretch
BINS = 8  # of range: up to 1, 2, 4, 8 ... m
# Rows of sums over a window: of clipped scores × a weight, and then of the weights. Those of the
# other rings are behind those of the own one.
OWN_SCORE, OWN_WEIGHT, CLOSE, LEVEL, BEHIND, BEFORE, ROWS = 0, 2, 4, 6, 8, 10, 12


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


@kernel
def count_scores(pattern: Pattern, score: Singles) -> FirstPass:
    """Count the points with a score above 0."""
    places = len(score)
    before, share = np.zeros(places + 1, np.int32), np.zeros(places, np.float32)
    count, above = np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
    of = np.zeros(places, np.int8)
    for k in range(places):
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
    for k in range(places):
        share[k] = above[of[k]] / max(count[of[k]], 1)
    return FirstPass(score, before, share, float(np.float32(outliers / max(points, 1))))


@kernel
def measure_again(prepared: Prepared, first: FirstPass, begin: int, end: int, out: Singles) -> None:
    """Write the features of all points of lines begin to end: (COUNT_AGAIN, M)."""
    pattern, window = prepared.pattern, make_window()
    values = rows_of_singles(COUNT_AGAIN)
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            gather(prepared, line, k, window)
            write_features(pattern, line, k, window, values)
            write_scores(prepared, first, line, k, window, values)
            copy_points(values, pattern.last[line] - k, out[:, k:])


@inlined_kernel
def write_scores(
    prepared: Prepared, first: FirstPass, line: int, k: int, window: PatternWindow, values: Singles
) -> None:
    """Write the features of the first pass, behind the others, of gathered windows.

    The window's ``side`` is used up. Lanes behind the line's end mean nothing.
    """
    total = window.side[:ROWS]
    _sum_scores(prepared, first.score, line, k, window, total)
    for lane in range(width(values)):
        score = first.score[k + lane]
        values[COUNT, lane] = min(max(score, -CLIP), CLIP)
        values[COUNT + 1, lane] = _mean(total[OWN_SCORE, lane], total[OWN_WEIGHT, lane])
        values[COUNT + 2, lane] = _mean(total[OWN_SCORE + 1, lane], total[OWN_WEIGHT + 1, lane])
        values[COUNT + 3, lane] = _mean(total[CLOSE, lane], total[CLOSE + 1, lane])
        values[COUNT + 4, lane] = _mean(total[LEVEL, lane], total[LEVEL + 1, lane])
        values[COUNT + 5, lane] = _mean(total[BEHIND, lane], total[BEHIND + 1, lane])
        values[COUNT + 6, lane] = _mean(total[BEFORE, lane], total[BEFORE + 1, lane])
    _write_shares(prepared.near, first, k, values)


@apart_kernel
def _sum_scores(
    prepared: Prepared, score: Singles, line: int, k: int, window: PatternWindow, total: Singles
) -> None:
    """Sum up the scores of each window: of the ring, of other rings, and by where they are."""
    pattern = prepared.pattern
    reach, gap = pattern.range[k : k + LANES], pattern.gap[line]
    apart, most = pattern.apart[line], pattern.level[line]
    square, away, scores = window.square, window.away, window.side[ROWS]
    total[:] = ZERO
    for slot in range(SIZE):
        part = 0 if slot < 2 * OWN else 1
        _copy_scores(prepared.near, score, k, slot, scores)
        for lane in range(width(square)):
            value, off = square[slot, lane], away[slot, lane]
            unit = reach[lane] * gap + apart
            same = level_within(unit, most)
            good = value < FAR
            c = min(max(scores[lane], -CLIP), CLIP)
            one = ONE if good else ZERO
            weight = unit * unit / (unit * unit + value) if good else ZERO
            level = ONE if good & (abs(off) <= same) else ZERO
            behind, before = ONE if off > same else ZERO, ONE if off < -same else ZERO
            total[OWN_SCORE + part, lane] += one * c
            total[OWN_WEIGHT + part, lane] += one
            total[CLOSE, lane] += weight * c
            total[CLOSE + 1, lane] += weight
            total[LEVEL, lane] += level * c
            total[LEVEL + 1, lane] += level
            total[BEHIND, lane] += behind * c
            total[BEHIND + 1, lane] += behind
            total[BEFORE, lane] += before * c
            total[BEFORE + 1, lane] += before


@apart_kernel
def _copy_scores(near: Index, score: Singles, k: int, slot: int, scores: Singles) -> None:
    """Write the scores of one slot of the windows."""
    if slot < 2 * OWN:
        some = score[place_of(k, slot) :]
        for lane in range(len(scores)):
            scores[lane] = some[lane]
    else:
        ring, m = (slot - 2 * OWN) // AROUND, (slot - 2 * OWN) % AROUND - OTHER
        others = near[ring, k : k + LANES]
        for lane in range(len(scores)):
            scores[lane] = score[others[lane] + m]


@inlined_kernel
def _mean(total: Single, count: Single) -> Single:
    return total / count if count > ZERO else UNKNOWN


@apart_kernel
def _write_shares(near: Index, first: FirstPass, k: int, values: Singles) -> None:
    """Write the shares of points with a score above 0."""
    low, high = first.before[k - STRETCH :], first.before[k + STRETCH + 1 :]
    share, row = first.share[k : k + LANES], COUNT + 7
    for lane in range(width(values)):
        values[row, lane] = np.float32(high[lane] - low[lane]) / PLACES_WIDE
        values[row + 1, lane] = ZERO
        values[row + 2, lane] = first.whole
        values[row + 3, lane] = share[lane]
    for ring in range(2 * RINGS):
        others = near[ring, k : k + LANES]
        for lane in range(len(others)):
            j = max(others[lane], STRETCH)
            some = first.before[j + STRETCH + 1] - first.before[j - STRETCH]
            values[row + 1, lane] += np.float32(some) / (PLACES_WIDE * np.float32(2 * RINGS))
