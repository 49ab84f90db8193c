# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What only a profile scanner's window says of a point: predictions by pairs, and its group.

Two returns of the window that lie opposite each other predict the range between them: those as many
places before and after in the line, and those of lines before and after. On a surface all pairs
agree, and so do all about a point that is off it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, rows
from lidar_outlier_filter.core.detectors.boosted_trees.window import (
    AROUND,
    FAR,
    HALF,
    MOST,
    ONE,
    OTHER,
    OWN,
    OWN_PHASES,
    OWN_RANGES,
    RANGE,
    RINGS,
    TWO,
    ZERO,
    F,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window_features import COUNT
from lidar_outlier_filter.core.kernels.kernels import apart_kernel, inlined_kernel
from lidar_outlier_filter.core.kernels.lanes import network, sort

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Ints, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.window import (
        PatternWindow,
        Prepared,
    )
    from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

ROW = rows(PROFILE, COUNT)
PAIRS = OWN + RINGS * AROUND
RIGHT = F(3.5)  # standard deviations up to which a pair is right
MISSING = F(1e6)  # behind all others
ALL = network(PAIRS, range(PAIRS))


@inlined_kernel
def write_profile(
    prepared: Prepared, line: int, window: PatternWindow, pairs: Singles, values: Singles
) -> None:
    """Write the features of the points of gathered windows, behind those that all sensors have."""
    _predict_own(prepared.pattern, line, window, pairs)
    _predict_other(prepared.pattern, line, window, pairs)
    _write_right(pairs, values[ROW.agree])
    sort(pairs, ALL)
    _write_median(pairs, values[ROW.middle])
    _write_groups(prepared.groups, window.places, values)


@apart_kernel
def _write_groups(groups: Singles, places: Ints, values: Singles) -> None:
    """Write what is said of the groups of points."""
    for row in range(len(groups)):
        for lane in range(len(places)):
            values[ROW.group + row, lane] = groups[row, places[lane]]


@apart_kernel
def _predict_own(pattern: Pattern, line: int, window: PatternWindow, pairs: Singles) -> None:
    """Write what pairs of the line predict more than the range, standard deviations, plus MOST."""
    square, mine, own = window.square, window.mine, window.own
    sigma = HALF * pattern.noise[line]
    for m in range(OWN):
        a, b, row = OWN - 1 - m, OWN + m, pairs[m]
        before, after = own[OWN_RANGES + a], own[OWN_RANGES + b]
        for lane in range(len(row)):
            r = mine[RANGE, lane]
            pa, pb = own[OWN_PHASES + a, lane], own[OWN_PHASES + b, lane]
            good = (square[a, lane] < FAR) & (square[b, lane] < FAR) & (pb > pa)
            part = -pa / (pb - pa if good else ONE)
            value = (ONE - part) / before[lane] + part / after[lane]
            # Of a plane, the inverse range is a sine: between two others it is more than a line.
            off = (r * value - ONE - HALF * pa * pb) * r / sigma
            row[lane] = min(max(off, -MOST), MOST) + MOST if good else MISSING


@apart_kernel
def _predict_other(pattern: Pattern, line: int, window: PatternWindow, pairs: Singles) -> None:
    """Write the same of pairs of lines before and after."""
    square, away = window.square, window.away
    reach, sigma = window.mine[RANGE], HALF * pattern.noise[line]
    for ring in range(RINGS):
        for m in range(AROUND):
            a = 2 * OWN + ring * AROUND + m
            b = 2 * OWN + (2 * RINGS - 1 - ring) * AROUND + 2 * OTHER - m
            row, aside = pairs[OWN + ring * AROUND + m], F(m - OTHER) * pattern.step[line]
            curved = HALF * aside * aside
            for lane in range(len(row)):
                r = reach[lane]
                good = (square[a, lane] < FAR) & (square[b, lane] < FAR)
                value = HALF / (r + away[a, lane]) + HALF / (r + away[b, lane])
                off = (r * value - ONE + curved) * r / sigma
                row[lane] = min(max(off, -MOST), MOST) + MOST if good else MISSING


@apart_kernel
def _write_right(pairs: Singles, row: Singles) -> None:
    """Write the share of the pairs that predict the range."""
    for lane in range(len(row)):
        right = count = ZERO
        for m in range(len(pairs)):
            count += ONE if pairs[m, lane] < MISSING else ZERO
            right += ONE if abs(pairs[m, lane] - MOST) < RIGHT else ZERO
        row[lane] = right / count if count > ZERO else -ONE


@apart_kernel
def _write_median(pairs: Singles, row: Singles) -> None:
    """Write the median of those that are there, sorted, less MOST; 0 for none."""
    for lane in range(len(row)):
        count = 0
        for m in range(len(pairs)):
            count += pairs[m, lane] < MISSING
        low, high = pairs[max(count - 1, 0) // 2, lane], pairs[count // 2, lane]
        row[lane] = (low + high) / TWO - MOST if count > 0 else ZERO
