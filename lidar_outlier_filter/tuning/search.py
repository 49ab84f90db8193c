# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The search for parameters, and an honest figure of what they are worth.

A model proposes: every detector is scored alone, once for each of its settings, thresholds are
swept over these scores, and verdicts are combined as the chain combines them. Then the chain itself
decides: each threshold is swept again where the chain is now, and the result is kept where the
chain is better with it. The figure is that of stretches of the recording that a search has not
seen: the same search is done once for each fold, without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.verdict import ALL
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.confusion import FOUND, KEPT, LOST, MISSED, f1, tally
from lidar_outlier_filter.parameters.filter import describe
from lidar_outlier_filter.tuning.output import Tuned
from lidar_outlier_filter.tuning.search_space import searches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats, Ints, Progress
    from lidar_outlier_filter.core.detectors.thresholds import Threshold
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.tuning.search_space import Search, Values
    from lidar_outlier_filter.tuning.training import Training

ROUNDS = 5  # over all detectors, or until nothing changes
SLACK = 1e-3  # what is worth this much less, relatively, is as good
HELD = 8  # verdicts that are kept in memory
MIN_FOLDS = 2


@dataclass(frozen=True)
class Goal:
    """What to look for.

    Attributes
    ----------
    most_lost : share of the good points that may be rejected; beyond it, the fewer the better

    """

    most_lost: float = 0.01

    def __post_init__(self) -> None:
        """Refuse what is no goal."""
        if not 0 < self.most_lost <= 1:
            must_be = 'more than 0, at most 1'
            raise FilterError('the share of good points that may be lost', must_be, self.most_lost)

    def worth(self, counts: Ints) -> Floats:
        """Say what tallies (..., 4) are worth: the F1, or below 0 beyond the limit."""
        lost = counts[..., LOST] / np.maximum(counts[..., LOST] + counts[..., KEPT], 1)
        value: Floats = np.where(lost <= self.most_lost, np.nan_to_num(f1(counts)), -lost)
        return value


@dataclass(frozen=True)
class Choice:
    """A setting of a detector, and a value of its threshold; the one behind the last is off."""

    setting: int
    value: int


def levels(threshold: Threshold, statistic: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Count for each point the values of a threshold that reject it: those before this number.

    Points are rejected by the value v where their level is larger than v; untested ones never.
    """
    level = np.searchsorted(threshold.criticals(), statistic, side='left')
    return np.where(np.isnan(statistic), 0, level).astype(np.uint16)


def middle_of_best(worth: Floats) -> int:
    """Find the middle of the values around the best that are as good, but for a thousandth.

    The very best is best by chance, and an end of the good values is near the bad ones.
    """
    best = int(np.argmax(worth))
    good = worth >= worth[best] - SLACK * abs(worth[best])
    first = last = best
    while first > 0 and good[first - 1]:
        first -= 1
    while last < len(worth) - 1 and good[last + 1]:
        last += 1
    return (first + last) // 2


class Model:
    """The scores of all points by every setting of every detector."""

    def __init__(
        self,
        data: Training,
        parameters: FilterParameters,
        searches: Sequence[Search],
        goal: Goal,
        progress: Progress = lambda _done, _total, _what: None,
    ) -> None:
        """Run every detector, alone, in each of its settings and near its usual threshold."""
        self._data, self._goal = data, goal
        self._searches = {search.detector: search for search in searches}
        self._needed = max(parameters.vote, 1)
        self._levels: dict[tuple[str, int], NDArray[np.uint16]] = {}
        usual = {item.name: item.default for item in describe()}
        total = sum(len(search.settings) for search in searches)
        for search in searches:
            for number, setting in enumerate(search.settings):
                progress(len(self._levels), total, 'scores')
                alone = {**setting, 'chain': [search.detector], 'vote': 0}

                def score_of(changes: Values, alone: Values = alone) -> NDArray[np.float32]:
                    return data.judge(parameters.changed({**alone, **changes})).score

                threshold = search.threshold
                statistic = threshold.statistic(score_of, usual[threshold.name])
                self._levels[search.detector, number] = levels(threshold, statistic)

    def sweep(
        self,
        level: NDArray[np.uint16],
        most: int,
        points: Bools,
        others: NDArray[np.unsignedinteger],
        needed: int | None = None,
    ) -> Floats:
        """Say what each value of a threshold is worth, and last, what it is worth to be off.

        Parameters
        ----------
        level : (N,)
            See :func:`levels`.
        most : number of values
        points : (N,) bool
            Those that count.
        others : (N,)
            How many other detectors reject each point.
        needed : detectors that must agree; None: as many as the chain needs

        """
        needed = self._needed if needed is None else needed
        sure, undecided = others >= needed, others == needed - 1
        counts = np.empty((most + 1, 4), np.int64)
        for truth, yes, no in ((self._data.bad, FOUND, MISSED), (self._data.good, LOST, KEPT)):
            mine = truth & points
            histogram = np.bincount(level[mine & undecided], minlength=most + 1)
            above = histogram[::-1].cumsum()[::-1]
            counts[:, yes] = np.append(above[1:], 0) + np.count_nonzero(mine & sure)
            counts[:, no] = np.count_nonzero(mine) - counts[:, yes]
        return self._goal.worth(counts)

    def find(self, points: Bools) -> dict[str, object]:
        """Choose settings and thresholds of all detectors for each other, on some points (N,)."""
        alone = {name: self._best(name, points, {}, 1) for name in self._searches}
        # Beginning with the best one, or with all of them at once, as where several must agree.
        order = sorted(alone, key=lambda name: -alone[name][0])
        starts: list[dict[str, Choice]] = [{name: alone[name][1] for name in order}]
        if self._needed == 1:
            starts.insert(0, {})
        found = [self._descend(start, order, points) for start in starts]
        _, chosen = max(found, key=lambda pair: pair[0])
        values: dict[str, object] = {}
        for name, choice in chosen.items():
            search = self._searches[name]
            values |= search.settings[choice.setting]
            # What would better be off rejects as little as it can.
            last = len(search.threshold.values) - 1
            values[search.threshold.name] = search.threshold.values[min(choice.value, last)]
        return values

    def _descend(
        self,
        chosen: dict[str, Choice],
        order: Sequence[str],
        points: Bools,
    ) -> tuple[float, dict[str, Choice]]:
        """Choose for one detector after the other, until nothing changes."""
        worth = -np.inf
        for _ in range(ROUNDS):
            before = worth
            for name in order:
                others = {other: choice for other, choice in chosen.items() if other != name}
                found, choice = self._best(name, points, others, self._needed)
                if found > worth or name not in chosen:
                    chosen, worth = {**others, name: choice}, found
            if worth == before:
                break
        return worth, chosen

    def _best(
        self,
        name: str,
        points: Bools,
        others: Mapping[str, Choice],
        needed: int,
    ) -> tuple[float, Choice]:
        """Find the best setting and value of a detector, beside what others reject."""
        count = np.zeros(len(self._data), np.uint8)
        for other, choice in others.items():
            count += self._levels[other, choice.setting] > choice.value
        most = len(self._searches[name].threshold.values)
        best, chosen = -np.inf, Choice(0, most)
        for number in range(len(self._searches[name].settings)):
            worth = self.sweep(self._levels[name, number], most, points, count, needed)
            value = middle_of_best(worth)
            if worth[value] > best:
                best, chosen = float(worth[value]), Choice(number, value)
        return best, chosen


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
    if not MIN_FOLDS <= folds <= count:
        raise FilterError('the number of folds', f'from {MIN_FOLDS} to the {count} {what}', folds)
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
            data, rejected = self._data, self.judge(values).rejected
            known = data.bad | data.good
            self._counts[key] = tally(
                data.bad[known], rejected[known], data.stretch[known], data.stretches
            )
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
