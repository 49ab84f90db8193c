# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why the trees on the scan pattern say what they say: what each feature adds to the log-odds.

A tree asks three questions. Each leaves half of the values that were possible before it: what the
mean of the possible values changes by is what the question's feature adds. The sum over the trees,
and what they say on average, are the log-odds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.evidence.pattern import first_pass, second_pass
from lidar_outlier_filter.core.detectors.evidence.pattern_features import FEATURES
from lidar_outlier_filter.core.detectors.evidence.pattern_model import load
from lidar_outlier_filter.core.detectors.evidence.pattern_scores import (
    AGAIN,
    COUNT_AGAIN,
    measure_again,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_window import prepare
from lidar_outlier_filter.core.detectors.evidence.reasons import add_up_reasons, find_means
from lidar_outlier_filter.core.kernels import kernel
from lidar_outlier_filter.core.neighbours.scan_pattern import find_pattern
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.evidence.trees import Trees
    from lidar_outlier_filter.core.points import Points

    Singles = NDArray[np.float32]

REASONS = (*FEATURES, *AGAIN)


class Reasons(NamedTuple):
    """What the trees say of N points, and what of it is due to which feature.

    Attributes
    ----------
    odds : (N,) float32
        Log-odds: above the model's threshold a point is rejected.
    average : (N,) float32
        What the trees that judged the point say on average.
    added : (F, N) float32
        What each feature of ``REASONS`` adds to that; its sum over F and ``average`` are ``odds``.

    """

    odds: Singles
    average: Singles
    added: Singles

    @property
    def strongest(self) -> list[str]:
        """Name the feature that adds the most, of each point."""
        return [REASONS[f] for f in self.added.argmax(axis=0)]


def explain(points: Points, threads: int = 0) -> Reasons:
    """Explain the log-odds of valid points of a spinning sensor, in the order given.

    Parameters
    ----------
    points : valid ones, in the sensor's own frame
    threads : at most so many at once; 0 for as many as there are cores

    Raises
    ------
    FilterError
        If they have no scan pattern: trees do not judge them.

    """
    pattern = find_pattern(points, threads, spins=True)
    if pattern is None:
        raise FilterError('the points to explain', 'those of a scan pattern', 'others')
    model, there = load(), pattern.order >= 0
    prepared = prepare(pattern, threads)
    first = first_pass(prepared, model.first, threads)
    odds = second_pass(prepared, first, model.again, model.doubtful, threads)
    values = np.zeros((COUNT_AGAIN, len(there)), np.float32)
    measure_again(prepared, first, 0, len(pattern.first), values)
    again = first.score > np.float32(model.doubtful)
    added = np.zeros((COUNT_AGAIN, len(there)), np.float32)
    contribute(model.first, values, there & ~again, added)
    contribute(model.again, values, there & again, added)
    average = np.where(again, _average(model.again), _average(model.first))
    back = np.empty(len(points), np.int64)
    back[pattern.order[there]] = np.flatnonzero(there)
    return Reasons(odds[back], average[back].astype(np.float32), added[:, back])


def _average(trees: Trees) -> float:
    return float(trees.start + trees.value.mean(axis=1, dtype=np.float64).sum())


@kernel
def contribute(trees: Trees, features: Singles, wanted: NDArray[np.bool_], added: Singles) -> None:
    """Add what each feature (F, N) adds to the log-odds of the points that are wanted."""
    means = find_means(trees)
    for k in range(len(wanted)):
        if wanted[k]:
            add_up_reasons(trees, means, features[:, k], added[:, k])
