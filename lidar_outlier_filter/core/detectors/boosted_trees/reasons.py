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
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_values import measure
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    QUESTIONS,
    VALUES,
    TreeModel,
    Trees,
)
from lidar_outlier_filter.core.kernels.kernels import kernel

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Bools, Bytes, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.second_pass import FirstPass
    from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared

# A number never changes its meaning, so each group has numbers to spare: of the window, of the
# second pass, and of profile scanners. 0 is none.
FIRST_NUMBERS = ((1, WINDOW), (65, SECOND_PASS), (129, PROFILE))
LIKELY = ('range', 'range_ratio_glare', 'uneven', 'share', 'share_range')  # no reasons
REASON_NAMES = {
    first + k: name
    for first, names in FIRST_NUMBERS
    for k, name in enumerate(names)
    if name not in LIKELY
}
_NUMBERS = {name: number for number, name in REASON_NAMES.items()}


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
    names = (*WINDOW, *(PROFILE if prepared.profile else ()), *SECOND_PASS)
    numbers = np.array([_NUMBERS.get(name, 0) for name in names], np.uint8)
    values = measure(prepared, first, wanted, threads)
    found = np.full(values.shape[1], _NUMBERS['first'], np.uint8)
    again = first.score[wanted] > np.float32(model.doubtful)
    found[again] = _strongest(model.again, values[:, again], numbers)
    before = found == _NUMBERS['first']
    found[before] = _strongest(model.first, values[:, before], numbers)
    reason = np.zeros(len(wanted), np.uint8)
    reason[wanted] = found
    return reason


def _strongest(trees: Trees, values: Singles, numbers: Bytes) -> Bytes:
    """Return the number of the feature that adds most to each of W points; 0: none can be a reason.

    What adds nothing cannot: trees did not ask about it, or it made no difference.
    """
    added = contribute(trees, values)
    added[(numbers == 0)[:, None] | (added == 0)] = -np.inf
    found = np.where(added.max(axis=0) > -np.inf, numbers[added.argmax(axis=0)], 0)
    return found.astype(np.uint8)


def contribute(trees: Trees, values: Singles) -> Singles:
    """Return what each feature adds to the log-odds of W points with these values, both (F, W)."""
    added = np.zeros(values.shape, np.float32)
    # Of one layout, whatever was picked: another one would be compiled once more.
    _add_up(trees, find_means(trees), np.ascontiguousarray(values), added)
    return added


def find_means(trees: Trees) -> Singles:
    """Return the mean (T, 15) of the values that are possible at each node of full trees.

    The questions come first, as in ``Trees``, and the values behind them.
    """
    means = np.empty((len(trees.value), QUESTIONS + VALUES), np.float32)
    means[:, QUESTIONS:] = trees.value
    for node in range(QUESTIONS - 1, -1, -1):
        means[:, node] = np.float32(0.5) * (means[:, 2 * node + 1] + means[:, 2 * node + 2])
    return means


@kernel
def _add_up(trees: Trees, means: Singles, values: Singles, added: Singles) -> None:
    for k in range(values.shape[1]):
        for tree in range(len(trees.feature)):
            f, t, mean = trees.feature[tree], trees.limit[tree], means[tree]
            node = 0
            while node < QUESTIONS:
                number = 2 * node + (2 if values[f[node], k] > t[node] else 1)
                added[f[node], k] += mean[number] - mean[node]
                node = number
