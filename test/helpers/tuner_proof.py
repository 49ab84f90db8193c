# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the tuner with an exhaustive search: tuned on one drive, judged on another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.tuning.output import whole
from lidar_outlier_filter.tuning.search import Goal, tune
from lidar_outlier_filter.tuning.search_space import searches

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lidar_outlier_filter.core.annotations import Progress
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.tuning.training import Training

    Asked = Mapping[str, Sequence[object]]

# Windows that see nothing but what is far, thresholds that reject nearly all or nearly nothing.
BAD_START: Mapping[str, object] = {
    'alpha_beta_gamma.before': 40,
    'alpha_beta_gamma.after': 40,
    'alpha_beta_gamma.order': 2,
    'alpha_beta_gamma.significance': 0.4,
    'lof.min_pts': 3,
    'lof.threshold': 30.0,
    'sor.k': 70,
    'sor.multiplier': 30.0,
}
AIM = 0.98  # of the best F1
EVERY = 8  # of the values of a threshold, in the exhaustive search


@dataclass(frozen=True)
class Proof:
    """F1 on the held-out data: at the start, tuned, as promised, and the best there is."""

    chain: tuple[str, ...]
    start: float
    tuned: float
    promised: float
    best: float
    runs: int

    @property
    def share(self) -> float:
        """Tuned ÷ best."""
        return self.tuned / self.best


def prove(  # noqa: PLR0913  all that it depends on
    learnt: Training,
    unseen: Training,
    start: FilterParameters,
    requested: Asked,
    every: int = EVERY,
    progress: Progress = lambda _done, _total, _what: None,
) -> Proof:
    """Tune on one, judge on the other, and search that one exhaustively.

    Parameters
    ----------
    learnt, unseen : points whose truth is known
    start : the chain and where the tuner begins
    requested : values to try, by parameter; those of detectors outside the chain are left out
    every : the exhaustive search tries each so-manieth value of the thresholds, with every
        combination of settings; of several detectors, each beside the others as tuned
    progress : see :func:`~lidar_outlier_filter.tuning.search.tune`

    """
    goal = Goal()
    mine = {name: one for name, one in requested.items() if name.partition('.')[0] in start.chain}
    found = tune(learnt, start, goal, requested=mine, progress=progress)
    tuned = run(unseen, found.parameters)
    best, runs = tuned.f1, 0
    for search in searches(start, mine):
        for done, setting in enumerate(search.settings):
            progress(done, len(search.settings), f'all settings of {search.detector}')
            for value in search.threshold.values[::every]:
                changes = {**setting, search.threshold.name: value}
                counts = run(unseen, found.parameters.changed(changes))
                runs += 1
                if counts.false_rejections.ratio <= goal.most_lost:
                    best = max(best, np.nan_to_num(counts.f1))
    before, promised = run(unseen, start).f1, whole(found.held_out).f1
    return Proof(start.chain, before, tuned.f1, promised, float(best), runs)


def run(data: Training, parameters: FilterParameters) -> Confusion:
    """Count what a chain finds and loses."""
    return confusion(data.bad, data.judge(parameters).rejected)
