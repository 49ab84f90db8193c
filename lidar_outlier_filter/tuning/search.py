# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The search for parameters, and an honest figure of what they are worth.

The model proposes, the chain itself decides: it is run with what the model found, each threshold is
swept again over scores under just these conditions, and what comes of it is kept where the chain is
better with it. The figure is that of stretches of the recording that a search has not seen: the
same search is done once for each fold, without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.verdict import ALL
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.confusion import FOUND, KEPT, LOST, MISSED
from lidar_outlier_filter.tuning.model import ROUNDS, Goal, Model, levels, middle_of_best
from lidar_outlier_filter.tuning.search_space import searches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Ints, Progress
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.tuning.search_space import Search, Values
    from lidar_outlier_filter.tuning.training import Training

HELD = 8  # verdicts that are kept in memory
FEWEST_FOLDS = 2


@dataclass(frozen=True)
class Tuned:
    """What a search has found.

    Attributes
    ----------
    parameters : the best found, on all stretches
    values : what was searched, by name
    before, after : (S, 4) int64
        Tallies by stretch: with the parameters at the start, and with those found.
    held_out : (S, 4) int64
        The same with those found without the fold that the stretch is in: what to expect.
    folds : what was found without each fold
    alone : outliers and good points that each detector of the chain, and no other, rejects

    """

    parameters: FilterParameters
    values: Mapping[str, object]
    before: Ints
    after: Ints
    held_out: Ints
    folds: tuple[Mapping[str, object], ...]
    alone: Mapping[str, tuple[int, int]]


def tune(  # noqa: PLR0913  what the command line offers
    data: Training,
    parameters: FilterParameters,
    goal: Goal,
    folds: int = 5,
    *,
    wanted: Mapping[str, Sequence[object]] | None = None,
    kept: Iterable[str] = (),
    progress: Progress = lambda _done, _total, _what: None,
) -> Tuned:
    """Search for the best parameters of a chain, and say what they are worth.

    Parameters
    ----------
    data : points whose truth is known
    parameters : the chain, and all that is not searched; also where the search begins
    goal : what to look for
    folds : parts, each in one piece, that are left out in turn: of the recording; or, of several
        recordings, whole ones
    wanted : values to try, by parameter, instead of or beside those of the table
    kept : parameters to leave as they are
    progress : is called before every run: how many of how many steps are done, and of what; it may
        leave

    Raises
    ------
    FilterError
        If there are fewer than two folds, or more of them than stretches or recordings, or what is
        to be searched cannot be.

    """
    fold = fold_of_each(data, folds)
    listed = searches(parameters, wanted, kept)
    searcher = Searcher(data, parameters, listed, goal, progress)
    held_out = np.zeros((data.stretches, 4), np.int64)
    found = []
    for number in range(folds):
        searcher.say = partial(progress, number, folds + 1, 'folds')
        out = fold == number
        found.append(searcher.find(~out))
        held_out[out] = searcher.measure(found[-1])[out]
    searcher.say = partial(progress, folds, folds + 1, 'folds')
    values = searcher.find(np.ones(data.stretches, np.bool_))
    return Tuned(
        parameters.changed(values),
        values,
        searcher.measure({}),
        searcher.measure(values),
        held_out,
        tuple(found),
        _alone(data, searcher.judge(values), parameters.chain),
    )


def fold_of_each(data: Training, folds: int) -> Ints:
    """Put every stretch (S,) into a fold.

    Of several recordings each is wholly in one: another drive differs more from this one than its
    own stretches do from each other.
    """
    sources = int(data.sources[-1]) + 1
    count, what = (data.stretches, 'stretches') if sources == 1 else (sources, 'recordings')
    if not FEWEST_FOLDS <= folds <= count:
        raise FilterError(
            'the number of folds', f'from {FEWEST_FOLDS} to the {count} {what}', folds
        )
    unit = np.arange(data.stretches) if sources == 1 else data.sources
    return unit * folds // count


def _alone(data: Training, verdict: Verdict, chain: Sequence[str]) -> dict[str, tuple[int, int]]:
    result = {}
    for name in chain:
        mine = verdict.rejected & (verdict.detectors & ALL == DETECTORS[name].bit)
        outliers, good = np.count_nonzero(mine & data.bad), np.count_nonzero(mine & data.good)
        result[name] = int(outliers), int(good)
    return result


class Searcher:
    """Searches on some stretches or on all; what was computed once is not computed again.

    ``say`` is called before every run.
    """

    def __init__(
        self,
        data: Training,
        parameters: FilterParameters,
        listed: Sequence[Search],
        goal: Goal,
        progress: Progress,
    ) -> None:
        """Make the model of the chain."""
        self._data, self._parameters, self._goal = data, parameters, goal
        self._thresholds = {search.detector: search.threshold for search in listed}
        self._model = Model(data, parameters, listed, goal, progress)
        self.say: Callable[[], object] = lambda: None
        self._counts: dict[tuple[tuple[str, object], ...], Ints] = {}
        self._verdicts: dict[tuple[tuple[str, object], ...], Verdict] = {}

    def measure(self, values: Values) -> Ints:
        """Run the chain with some parameters changed; count by stretch: (S, 4)."""
        key = tuple(sorted(values.items()))
        if key not in self._counts:
            rejected = self.judge(values).rejected
            counts = np.zeros((self._data.stretches, 4), np.int64)
            for column, points in (
                (FOUND, self._data.bad & rejected),
                (MISSED, self._data.bad & ~rejected),
                (LOST, self._data.good & rejected),
                (KEPT, self._data.good & ~rejected),
            ):
                where = self._data.stretch[points]
                counts[:, column] = np.bincount(where, minlength=len(counts))
            self._counts[key] = counts
        return self._counts[key]

    def judge(self, values: Values) -> Verdict:
        """Run the chain with some parameters changed."""
        key = tuple(sorted(values.items()))
        if key not in self._verdicts:
            while len(self._verdicts) >= HELD:
                del self._verdicts[next(iter(self._verdicts))]
            self.say()
            self._verdicts[key] = self._data.judge(self._parameters.changed(values))
        return self._verdicts[key]

    def find(self, train: Bools) -> dict[str, object]:
        """Search on the stretches (S,) given; return the parameters to be changed."""
        points = train[self._data.stretch]
        values = self._model.find(points)
        for _ in range(ROUNDS):
            before = values
            for detector in self._parameters.chain:
                candidate = self._swept_again(detector, values, points)
                if self._worth(candidate, train) > self._worth(values, train):
                    values = candidate
            if values == before:
                break
        # Where nothing is better than what was given, that stays.
        return values if self._worth(values, train) > self._worth({}, train) else {}

    def _worth(self, values: Values, train: Bools) -> float:
        return float(self._goal.worth(self.measure(values)[train].sum(axis=0)))

    def _swept_again(
        self, detector: str, values: dict[str, object], points: Bools
    ) -> dict[str, object]:
        """Sweep a threshold over the scores that its detector gives where the chain is now."""
        threshold = self._thresholds[detector]
        chain, bits = self._parameters.chain, self.judge(values).detectors
        others = np.zeros(len(bits), np.uint8)
        for name in chain:
            if name != detector:
                others += (bits & DETECTORS[name].bit) != 0
        seen = None
        if self._parameters.vote == 0:
            earlier = sum(DETECTORS[name].bit for name in chain[: chain.index(detector)])
            seen = (bits & earlier) == 0

        def score_of(changes: Values) -> NDArray[np.float32]:
            self.say()
            alone = {**values, **changes, 'chain': [detector], 'vote': 0}
            return self._data.judge(self._parameters.changed(alone), seen).score

        now = self._parameters.changed(values).flat()[threshold.name]
        level = levels(threshold, threshold.statistic(score_of, now))
        worth = self._model.sweep(level, len(threshold.values), points, others)
        return {**values, threshold.name: threshold.values[middle_of_best(worth[:-1])]}
