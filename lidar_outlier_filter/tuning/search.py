# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Search the parameters of a chain by cross-validation over stretches of recordings.

Every detector is scored alone, once for each of its settings; thresholds are swept over these
scores, and verdicts are combined as the chain combines them. The chain itself then decides: each
threshold is swept again with the others fixed, and kept if the chain improves. The expected
F1 is measured on stretches that a search has not seen: the search is repeated without each fold.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Progress, Reals, Singles
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.thresholds import Threshold
from lidar_outlier_filter.core.detectors.thresholds import threshold as threshold_of
from lidar_outlier_filter.core.verdict import ALL, Verdict
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.confusion import FOUND, KEPT, LOST, MISSED, f1, tally
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import as_yaml
from lidar_outlier_filter.tuning.output import Tuned
from lidar_outlier_filter.tuning.search_space import Search, Values, searches
from lidar_outlier_filter.tuning.training import Training

MAX_ROUNDS = 5  # over all detectors, or until nothing changes
TOLERANCE = 1e-3  # relative: values that are worth this much less are as good
MAX_VERDICTS = 8  # kept in memory
MIN_FOLDS = 2
MIN_TRIED = 3  # values of a parameter whose ends are limits of the search


Choice = tuple[int, int]  # index of a setting, and of a value of the threshold; one beyond: off


def value_of(counts: Ints, most_lost: float) -> Floats:
    """Return the F1 of tallies (..., 4), or minus the share lost where it exceeds the limit."""
    lost = counts[..., LOST] / np.maximum(counts[..., LOST] + counts[..., KEPT], 1)
    value: Floats = np.where(lost <= most_lost, np.nan_to_num(f1(counts)), -lost)
    return value


def levels(threshold: Threshold, statistic: Reals) -> NDArray[np.uint16]:
    """Return for each point the number of threshold values that reject it: the first ones.

    Points are rejected by the value v where their level is larger than v; untested ones never.
    """
    level = np.searchsorted(threshold.criticals(), statistic, side='left')
    return np.where(np.isnan(statistic), 0, level).astype(np.uint16)


def sweep(  # noqa: PLR0913  what a threshold depends on
    level: NDArray[np.uint16],
    values: int,
    bad: Bools,
    good: Bools,
    others: NDArray[np.unsignedinteger],
    needed: int,
) -> Ints:
    """Tally the verdicts at each value of a threshold, and last, with the detector off.

    Parameters
    ----------
    level : (N,)
        See :func:`levels`.
    values : number of values, V
    bad, good : (N,) bool
        Truth; points that are neither do not count.
    others : (N,)
        How many other detectors reject each point.
    needed : detectors that must agree

    Returns
    -------
    counts : (V + 1, 4) int64
        See :func:`~lidar_outlier_filter.evaluation.confusion.tally`.

    """
    sure, undecided = others >= needed, others == needed - 1
    counts = np.empty((values + 1, 4), np.int64)
    for mine, yes, no in ((bad, FOUND, MISSED), (good, LOST, KEPT)):
        histogram = np.bincount(level[mine & undecided], minlength=values + 1)
        above = histogram[::-1].cumsum()[::-1]
        counts[:, yes] = np.append(above[1:], 0) + np.count_nonzero(mine & sure)
        counts[:, no] = np.count_nonzero(mine) - counts[:, yes]
    return counts


def middle_of_best(worth: Floats) -> int:
    """Find the middle of the values around the best that are as good, within ``TOLERANCE``.

    The very best is best by chance, and an end of the good values is near the bad ones.
    """
    best = int(np.argmax(worth))
    worse = np.flatnonzero(worth < worth[best] - TOLERANCE * abs(worth[best]))
    first = int(worse[worse < best].max(initial=-1)) + 1
    last = int(worse[worse > best].min(initial=len(worth))) - 1
    return (first + last) // 2


def tune(  # noqa: PLR0913  what the command line offers
    data: Training,
    parameters: FilterParameters,
    most_lost: float = 0.01,
    folds: int = 5,
    *,
    requested: Mapping[str, Sequence[object]] | None = None,
    kept: Iterable[str] = (),
    progress: Progress = lambda _done, _total, _what: None,
) -> Tuned:
    """Search for the best parameters of a chain, and estimate their F1 by cross-validation.

    Parameters
    ----------
    data : points whose truth is known
    parameters : the chain, and all that is not searched; also where the search begins
    most_lost : share of the good points that may be rejected; beyond it, the fewer the better
    folds : number of folds, held out in turn: contiguous parts of the recording, or, of several
        recordings, whole ones
    requested : values to try, by parameter, which replace the usual ones
    kept : parameters to leave as they are
    progress : is called before every run with the steps done, all steps, and their name; an
        exception that it raises ends the search

    """
    if not 0 < most_lost <= 1:
        must_be = 'more than 0, at most 1'
        raise FilterError('the share of good points that may be lost', must_be, most_lost)
    fold = fold_of_each(data, folds)
    listed = searches(parameters, requested, kept)
    searcher = Searcher(data, parameters, listed, most_lost, progress)
    held_out = np.zeros((data.stretches, 4), np.int64)
    found = []
    for number in range(folds):
        searcher.report = partial(progress, number, folds + 1, 'folds')
        out = fold == number
        found.append(searcher.find(~out))
        held_out[out] = searcher.measure(found[-1])[out]
    searcher.report = partial(progress, folds, folds + 1, 'folds')
    values = searcher.find(np.ones(data.stretches, np.bool_))
    return Tuned(
        parameters.changed(values),
        values,
        searcher.measure({}),
        searcher.measure(values),
        held_out,
        tuple(found),
        _alone(data, searcher.judge(values), parameters.chain),
        _tally_default(data, parameters),
        _notes(listed, values, searcher.judge(values)),
    )


def fold_of_each(data: Training, folds: int) -> Ints:
    """Return the fold of every stretch (S,).

    Several recordings are never cut across folds: drives differ more from each other than
    stretches of one drive do.
    """
    sources = int(data.sources[-1]) + 1
    count, what = (data.stretches, 'stretches') if sources == 1 else (sources, 'recordings')
    if not MIN_FOLDS <= folds <= count:
        raise FilterError('the number of folds', f'from {MIN_FOLDS} to the {count} {what}', folds)
    unit = np.arange(data.stretches) if sources == 1 else data.sources
    return unit * folds // count


def _alone(data: Training, verdict: Verdict, chain: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Count the outliers and good points that each detector, and no other, rejects."""
    result = {}
    for name in chain:
        mine = verdict.rejected & (verdict.detectors & ALL == DETECTORS[name].bit)
        outliers, good = np.count_nonzero(mine & data.bad), np.count_nonzero(mine & data.good)
        result[name] = int(outliers), int(good)
    return result


def _tally_default(data: Training, parameters: FilterParameters) -> Ints | None:
    """Tally the default chain and threshold by stretch; None if the search began with them."""
    defaults = FilterParameters()
    thresholds = [threshold_of(DETECTORS[name], defaults) for name in defaults.chain]
    names = ['chain', 'vote', *(one.name for one in thresholds if one is not None)]
    default = parameters.changed({name: defaults.flat()[name] for name in names})
    return None if default == parameters else _tally(data, data.judge(default).rejected)


def _tally(data: Training, rejected: Bools) -> Ints:
    """Tally a verdict by stretch, (S, 4)."""
    known = data.bad | data.good
    return tally(data.bad[known], rejected[known], data.stretch[known], data.stretches)


def _notes(listed: Sequence[Search], values: Values, verdict: Verdict) -> tuple[str, ...]:
    """Name values at an end of the values tried, and detectors that reject nothing."""
    notes = []
    for search in listed:
        tried = {name: {one[name] for one in search.settings} for name in search.settings[0]}
        for name, choices in {search.threshold.name: search.threshold.values, **tried}.items():
            value: Any = values.get(name)
            ends: dict[Any, str] = {min(choices): 'smallest', max(choices): 'largest'}
            if len(choices) >= MIN_TRIED and value in ends and not isinstance(value, str):
                end = f'{as_yaml(value)} is the {ends[value]} value tried'
                notes.append(f'{name}: {end}. --search tries others.')
        if not (verdict.detectors & DETECTORS[search.detector].bit).any():
            notes.append(f'{search.detector} rejects no point with the parameters found.')
    return tuple(notes)


class Searcher:
    """Searches on some stretches or on all, and caches the runs of detectors and of the chain.

    Attributes
    ----------
    report : is called before every run of the chain

    """

    def __init__(
        self,
        data: Training,
        parameters: FilterParameters,
        listed: Sequence[Search],
        most_lost: float,
        progress: Progress,
    ) -> None:
        """Run every detector, alone, in each of its settings and near its usual threshold."""
        self._data, self._parameters, self._most_lost = data, parameters, most_lost
        self._searches = {search.detector: search for search in listed}
        self._needed = max(parameters.vote, 1)
        self._verdict = lru_cache(MAX_VERDICTS)(self._run_chain)
        self._count = cache(lambda values: _tally(data, self._verdict(values).rejected))
        self._levels: dict[tuple[str, int], NDArray[np.uint16]] = {}
        usual = {item.name: item.default for item in describe()}
        total = sum(len(search.settings) for search in listed)
        for search in listed:
            for number, setting in enumerate(search.settings):
                self.report: Callable[[], object] = partial(
                    progress, len(self._levels), total, 'scores'
                )
                default = usual[search.threshold.name]
                self._levels[search.detector, number] = self._run(search, setting, default)

    def _run(
        self, search: Search, setting: Values, value: Any, seen: Bools | None = None
    ) -> NDArray[np.uint16]:
        """Run a detector alone near a value of its threshold; return the levels of the points."""
        alone = {**setting, 'chain': [search.detector], 'vote': 0}

        def score_of(changes: Values) -> Singles:
            self.report()
            parameters = self._parameters.changed({**alone, **changes})
            return self._data.judge(parameters, seen).score

        return levels(search.threshold, search.threshold.statistic(score_of, value))

    def _run_chain(self, values: tuple[tuple[str, object], ...]) -> Verdict:
        self.report()
        return self._data.judge(self._parameters.changed(dict(values)))

    def judge(self, values: Values) -> Verdict:
        """Run the chain with some parameters changed."""
        return self._verdict(tuple(sorted(values.items())))

    def measure(self, values: Values) -> Ints:
        """Run the chain with some parameters changed; tally by stretch, (S, 4)."""
        return self._count(tuple(sorted(values.items())))

    def find(self, train: Bools) -> dict[str, object]:
        """Search on the stretches (S,) given; return the changed parameters."""
        points = train[self._data.stretch]
        bad, good = self._data.bad & points, self._data.good & points

        def worth(candidate: Values) -> float:
            return float(value_of(self.measure(candidate)[train].sum(axis=0), self._most_lost))

        values = self._propose(bad, good)
        for _ in range(MAX_ROUNDS):
            before = values
            for detector in self._parameters.chain:
                candidate = self._swept_again(detector, values, bad, good)
                values = candidate if worth(candidate) > worth(values) else values
            if values == before:
                break
        # The parameters at the start stay where nothing is better.
        return values if worth(values) > worth({}) else {}

    def _propose(self, bad: Bools, good: Bools) -> dict[str, object]:
        """Choose settings and thresholds of all detectors for each other by their cached scores."""
        alone = {name: self._best(name, bad, good, {}, 1) for name in self._searches}
        order = sorted(alone, key=lambda name: -alone[name][0])
        # Begin with the best one; where several must agree, with all of them at once.
        chosen = {} if self._needed == 1 else {name: alone[name][1] for name in order}
        worth = -np.inf
        for _ in range(MAX_ROUNDS):
            before = worth
            for name in order:
                others = {other: choice for other, choice in chosen.items() if other != name}
                found, choice = self._best(name, bad, good, others, self._needed)
                if found > worth or name not in chosen:
                    chosen, worth = {**others, name: choice}, found
            if worth == before:
                break
        values: dict[str, object] = {}
        for name, (setting, number) in chosen.items():
            search = self._searches[name]
            tried = search.threshold.values
            # A detector that would better be off rejects as little as it can.
            values |= {
                **search.settings[setting],
                search.threshold.name: (*tried, tried[-1])[number],
            }
        return values

    def _best(
        self, name: str, bad: Bools, good: Bools, others: Mapping[str, Choice], needed: int
    ) -> tuple[float, Choice]:
        """Find the best setting and value of a detector beside the rejections of others."""
        count = np.zeros(len(self._data), np.uint8)
        for other, (setting, number) in others.items():
            count += self._levels[other, setting] > number
        search = self._searches[name]
        most = len(search.threshold.values)
        best, chosen = -np.inf, (0, most)
        for setting in range(len(search.settings)):
            counts = sweep(self._levels[name, setting], most, bad, good, count, needed)
            worth = value_of(counts, self._most_lost)
            number = middle_of_best(worth)
            if worth[number] > best:
                best, chosen = float(worth[number]), (setting, number)
        return best, chosen

    def _swept_again(
        self, detector: str, values: dict[str, object], bad: Bools, good: Bools
    ) -> dict[str, object]:
        """Sweep a threshold over the scores that its detector gives in the chain as it is now."""
        search, chain = self._searches[detector], self._parameters.chain
        threshold, bits = search.threshold, self.judge(values).detectors
        others = np.zeros(len(bits), np.uint8)
        for name in chain:
            if name != detector:
                others += (bits & DETECTORS[name].bit) != 0
        seen = None
        if self._parameters.vote == 0:
            earlier = sum(DETECTORS[name].bit for name in chain[: chain.index(detector)])
            seen = (bits & earlier) == 0
        now = self._parameters.changed(values).flat()[threshold.name]
        level = self._run(search, values, now, seen)
        counts = sweep(level, len(threshold.values), bad, good, others, self._needed)
        worth = value_of(counts[:-1], self._most_lost)
        return {**values, threshold.name: threshold.values[middle_of_best(worth)]}
