# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why a point is rejected: the feature that adds most to its score, as a number.

Each tree asks three questions. Each leaves half of the values that were possible before it: what
the mean of the possible values changes by is what the question's feature adds. Where that is the
point's own result of the first pass, the reason is the strongest feature of that pass. Features
that only say where outliers are likely are no reason, nor are those that trees do not ask about.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.features import PROFILE, SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_values import (
    make_pattern_room,
    write_values,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    QUESTIONS,
    VALUES,
    TreeModel,
    Trees,
)
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import fill
from lidar_outlier_filter.core.scan_pattern.placed_pattern import LINES_AT_ONCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.annotations import Bools, Bytes, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.second_pass import FirstPass
    from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared

# A number never changes its meaning, so each group has numbers to spare: of the window, of the
# second pass, and of profile scanners. 0 is none.
FIRST_NUMBERS = ((1, WINDOW), (65, SECOND_PASS), (129, PROFILE))
OWN, MORE = len(WINDOW), len(PROFILE)
LIKELY = ('range', 'range_ratio_glare', 'uneven', 'share', 'share_range')  # no reasons
REASON_NAMES = {
    first + k: name
    for first, names in FIRST_NUMBERS
    for k, name in enumerate(names)
    if name not in LIKELY
}


def number_rows(names: Sequence[str]) -> Bytes:
    """Return the numbers of the features of trees; 0 for those that are no reason."""
    known = {name: number for number, name in REASON_NAMES.items()}
    return np.array([known.get(name, 0) for name in names], np.uint8)


def strongest_of_trees(
    prepared: Prepared,
    first: FirstPass,
    model: TreeModel,
    wanted: Bools,
    threads: int = 0,
) -> Bytes:
    """Return the numbers (M,) of the features that add most to the log-odds of wanted places.

    Parameters
    ----------
    prepared : the pattern that was judged
    first : what its first pass gave
    model : that judged it
    wanted : (M,) the places to explain; others have 0
    threads : at most so many at once; 0 for as many as there are cores

    """
    more = PROFILE if prepared.profile else ()
    rows = number_rows((*WINDOW, *more, *SECOND_PASS))
    reason = np.zeros(len(wanted), np.uint8)
    both, low = (model.first, model.again), np.float32(model.doubtful)
    pool.run(
        lambda i, j: _explain(
            prepared, prepared.profile, first, both, low, rows, wanted, i, j, reason
        ),
        len(prepared.pattern.first),
        LINES_AT_ONCE,
        threads,
    )
    return reason


@kernel
def _explain(
    prepared: Prepared,
    profile: bool | None,
    first: FirstPass,
    both: tuple[Trees, Trees],
    doubtful: np.float32,
    rows: Bytes,
    wanted: Bools,
    begin: int,
    end: int,
    reason: Bytes,
) -> None:
    pattern, buffers, added = prepared.pattern, make_pattern_room(), np.empty(len(rows), np.float32)
    means, values = (find_means(both[0]), find_means(both[1])), buffers.values
    more = 0
    if profile is not None:
        more = MORE
    places = buffers.window.places
    own = OWN + more  # the row of the point's own result of the first pass
    for line in range(begin, end):
        k = pattern.first[line]
        while k < pattern.last[line]:
            count, k = fill(places, wanted, k, pattern.last[line])
            if count > 0:
                write_values(prepared, profile, first, True, line, buffers)  # noqa: FBT003
            for lane in range(count):
                strongest = own
                if first.score[places[lane]] > doubtful:
                    strongest = _find_strongest(both[1], means[1], rows, values[:, lane], added)
                if strongest == own:
                    strongest = _find_strongest(both[0], means[0], rows, values[:, lane], added)
                reason[places[lane]] = rows[strongest] if strongest >= 0 else 0


@inner_kernel
def _find_strongest(
    trees: Trees, means: Singles, rows: Bytes, features: Singles, added: Singles
) -> int:
    """Return the row of the feature that adds most, of those that can be a reason; -1: none can.

    What adds nothing cannot: trees did not ask about it, or it made no difference.
    """
    added[:] = 0
    add_up_reasons(trees, means, features, added)
    strongest = -1
    for row in range(len(rows)):
        can = rows[row] != 0 and added[row] != 0
        if can and (strongest < 0 or added[row] > added[strongest]):
            strongest = row
    return strongest


@inner_kernel
def find_means(trees: Trees) -> Singles:
    """Return the mean (T, 15) of the values that are possible at each node of full trees.

    The questions come first, as in ``Trees``, and the values behind them.
    """
    means = np.empty((len(trees.value), QUESTIONS + VALUES), np.float32)
    for tree in range(len(means)):
        means[tree, QUESTIONS:] = trees.value[tree]
        for node in range(QUESTIONS - 1, -1, -1):
            low, high = means[tree, 2 * node + 1], means[tree, 2 * node + 2]
            means[tree, node] = np.float32(0.5) * (low + high)
    return means


@inner_kernel
def add_up_reasons(trees: Trees, means: Singles, features: Singles, added: Singles) -> None:
    """Add what each feature (F,) of a point adds to its log-odds."""
    for tree in range(len(trees.feature)):
        f, t, mean = trees.feature[tree], trees.limit[tree], means[tree]
        node = 0
        while node < QUESTIONS:
            number = 2 * node + (2 if features[f[node]] > t[node] else 1)
            added[f[node]] += mean[number] - mean[node]
            node = number
