# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why a point is rejected: the feature that adds most to its score, as a number.

Each tree asks three questions. Each leaves half of the values that were possible before it: what
the mean of the possible values changes by is what the question's feature adds. Where that is the
point's own result of the first pass, the reason is the strongest feature of that pass.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core import threads as pool
from lidar_outlier_filter.core.detectors.evidence import features as weighted
from lidar_outlier_filter.core.detectors.evidence.pattern_features import (
    COUNT,
    FEATURES,
    write_features,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_scores import (
    AGAIN,
    FirstPass,
    write_scores,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_window import (
    Prepared,
    gather,
    make_window,
)
from lidar_outlier_filter.core.detectors.evidence.profile_features import (
    COUNT_ALL,
    COUNT_PROFILE,
    PROFILE,
    make_pairs,
    write_profile,
)
from lidar_outlier_filter.core.detectors.evidence.trees import VALUES, Trees
from lidar_outlier_filter.core.kernels import kernel
from lidar_outlier_filter.core.lanes import LANES
from lidar_outlier_filter.core.neighbours.scan_pattern import LINES_AT_ONCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.evidence.pattern_model import PatternModel

    Floats = NDArray[np.float64]
    Singles = NDArray[np.float32]
    Bools = NDArray[np.bool_]
    Numbers = NDArray[np.uint8]

DEPTH = 3
# A number never changes its meaning, so each group has room for more: of the window, of the second
# pass, of profile scanners, and of the weighted sum. 0 is none.
WINDOW, SECOND, OF_PROFILE, OF_SUM = 1, 65, 129, 193
SLANTED = OF_SUM + len(weighted.FEATURES)  # a slanted group in the air
REASON_NAMES = {
    first + k: name
    for first, names in (
        (WINDOW, FEATURES),
        (SECOND, AGAIN),
        (OF_PROFILE, PROFILE),
        (OF_SUM, (*weighted.FEATURES, 'slanted')),
    )
    for k, name in enumerate(names)
}


def number_rows(names: Sequence[str]) -> Numbers:
    """Return the numbers of the features of trees."""
    known = {name: number for number, name in REASON_NAMES.items() if number < OF_SUM}
    return np.array([known[name] for name in names], np.uint8)


def strongest_of_sum(contributions: Floats, weights: Floats) -> Numbers:
    """Return the numbers (N,) of the features of a weighted sum that add most."""
    return np.asarray(OF_SUM + (contributions * weights).argmax(axis=1), np.uint8)


def strongest_of_trees(
    prepared: Prepared,
    first: FirstPass,
    model: PatternModel,
    wanted: Bools,
    threads: int = 0,
) -> Numbers:
    """Return the numbers (M,) of the features that add most to the log-odds of wanted places.

    Parameters
    ----------
    prepared : the pattern that was judged
    first : what its first pass gave
    model : that judged it
    wanted : (M,) the places to explain; others have 0
    threads : at most so many at once; 0 for as many as there are cores

    """
    more = PROFILE if len(prepared.groups) > 0 else ()
    rows = number_rows((*FEATURES, *more, *AGAIN))
    reason = np.zeros(len(wanted), np.uint8)
    both, low = (model.first, model.again), np.float32(model.doubtful)
    pool.run(
        lambda i, j: _explain(prepared, first, both, low, rows, wanted, i, j, reason),
        len(prepared.pattern.first),
        LINES_AT_ONCE,
        threads,
    )
    return reason


@kernel
def _explain(
    prepared: Prepared,
    first: FirstPass,
    both: tuple[Trees, Trees],
    doubtful: np.float32,
    rows: Numbers,
    wanted: Bools,
    begin: int,
    end: int,
    reason: Numbers,
) -> None:
    pattern, window, pairs = prepared.pattern, make_window(), make_pairs()
    values, added = np.empty((COUNT_ALL, LANES), np.float32), np.empty(len(rows), np.float32)
    more = COUNT_PROFILE if len(prepared.groups) > 0 else 0
    own = COUNT + more  # the row of the point's own result of the first pass
    for line in range(begin, end):
        for k in range(pattern.first[line], pattern.last[line], LANES):
            count = min(pattern.last[line] - k, LANES)
            if not wanted[k : k + count].any():
                continue
            gather(prepared, line, k, window)
            write_features(pattern, line, k, window, values)
            if len(prepared.groups) > 0:
                write_profile(prepared, line, k, window, pairs, values)
            write_scores(prepared, first, line, k, window, values[more:])
            for lane in range(count):
                if wanted[k + lane]:
                    strongest = own
                    if first.score[k + lane] > doubtful:
                        strongest = _find_strongest(both[1], values[:, lane], added)
                    if strongest == own:
                        strongest = _find_strongest(both[0], values[:, lane], added)
                    reason[k + lane] = rows[strongest]


@kernel
def _find_strongest(trees: Trees, features: Singles, added: Singles) -> int:
    added[:] = 0
    add_up_reasons(trees, features, added)
    return int(added.argmax())


@kernel
def add_up_reasons(trees: Trees, features: Singles, added: Singles) -> None:
    """Add what each feature (F,) of a point adds to its log-odds."""
    for tree in range(len(trees.feature)):
        f, t, v = trees.feature[tree], trees.limit[tree], trees.value[tree]
        place, low, high = 0, 0, VALUES
        before = v.mean()
        for _ in range(DEPTH):
            middle = (low + high) // 2
            if features[f[place]] > t[place]:
                low, number = middle, 2 * place + 2
            else:
                high, number = middle, 2 * place + 1
            after = v[low:high].mean()
            added[f[place]] += after - before
            before, place = after, number
