# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sliders: the values that a threshold may have, and exact counts of what each value rejects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Ints
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.detectors.thresholds import threshold
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.sources import ReportCloud

STEP_BITS = 21  # of a point, for the steps of all sliders
MAX_FACTOR = 3.0  # the smallest critical value is the given one ÷ this
MAX_REJECTED = 0.5  # share of the tested points that a step may reject
# Lower edges, m.
RANGE_EDGES_M = (0.0, 5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 75.0, 100.0, 150.0, 200.0)
SCORE_BINS, MAX_SCORE = 80, 4.0  # the last bin also holds larger scores
SCORE_TOLERANCE = 3e-7  # relative, of a score in single precision: closer to a limit is uncertain
NO_TRUTH, GOOD, BAD = range(3)
DETECTOR_BITS, REASONS = 16, 256


@dataclass(frozen=True)
class Slider:
    """The values of one threshold.

    Attributes
    ----------
    detector, name : the detector, and its parameter
    values : from the one that rejects most to the one that rejects least
    given : index of the value that the parameters hold
    limits : critical value of each ÷ that of the given one, ascending; not finite if that is 0
    first : the bit of the first value in the bits of a point

    """

    detector: str
    name: str
    values: tuple[float, ...]
    given: int
    limits: Floats
    first: int = 0

    def changed(self, parameters: FilterParameters, step: int) -> FilterParameters:
        """Return the parameters of a step."""
        if step == self.given:
            return parameters
        return parameters.changed({self.name: self.values[step]})

    def take(self, chosen: Ints, first: int) -> Slider:
        """Return the slider with some of the values, ascending; the given one is among them."""
        values = tuple(self.values[i] for i in chosen)
        given = int(np.searchsorted(chosen, self.given))
        return Slider(self.detector, self.name, values, given, self.limits[chosen], first)


def all_values(parameters: FilterParameters) -> tuple[Slider, ...]:
    """Return a slider with all values of the threshold for each detector of the chain."""
    chain = tuple(dict.fromkeys(parameters.chain))
    return tuple(_all_values(name, parameters) for name in chain[:STEP_BITS])


def _all_values(detector: str, parameters: FilterParameters) -> Slider:
    swept = threshold(DETECTORS[detector], parameters)
    if swept is None:
        return Slider(detector, f'{detector}, no threshold', (np.nan,), 0, np.ones(1))
    given = float(parameters.flat()[swept.name])
    middle = swept.critical(given)
    others = [one for one in swept.values if is_valid(parameters, swept.name, one)]
    stricter = [one for one in others if swept.critical(one) < middle]
    looser = [one for one in others if swept.critical(one) > middle]
    values = (*stricter, given, *looser)
    with np.errstate(divide='ignore', invalid='ignore'):
        limits = np.array([swept.critical(value) for value in values]) / middle
    return Slider(detector, swept.name, values, len(stricter), limits)


def is_valid(parameters: FilterParameters, name: str, value: float) -> bool:
    """Return whether a parameter may have a value beside the others."""
    try:
        parameters.changed({name: value})
    except ParameterError:
        return False
    return True


def choose_steps(
    possible: Sequence[Slider], rejected: Sequence[Ints], tested: int
) -> tuple[Slider, ...]:
    """Choose values of each slider, as far as the bits of a point suffice.

    Each step rejects other points than the one beside it, from half of the points, or a third of
    the critical value, to none.

    Parameters
    ----------
    possible : sliders with all values
    rejected : about how many points each value would reject
    tested : number of points with a score

    """
    bits = STEP_BITS // max(len(possible), 1)
    chosen = [
        _steps(one, counts, tested, (bits - 1) // 2)
        for one, counts in zip(possible, rejected, strict=True)
    ]
    return tuple(
        one.take(steps, number * bits)
        for number, (one, steps) in enumerate(zip(possible, chosen, strict=True))
    )


def _steps(slider: Slider, rejected: Ints, tested: int, half: int) -> Ints:
    """Choose at most ``half`` values on either side of the given one, ascending."""
    stricter = np.arange(slider.given)[::-1]
    looser = np.arange(slider.given + 1, len(slider.values))
    if not np.isfinite(slider.limits[slider.given]):
        # No score is a multiple of a critical value of 0.
        sides = [
            side[np.unique(np.linspace(0, len(side) - 1, half).astype(np.intp))]
            for side in (stricter, looser)
            if len(side)
        ]
    else:
        shown = (slider.limits >= 1 / MAX_FACTOR) & (rejected <= MAX_REJECTED * tested)
        sides = [
            _spread(side, rejected, rejected[slider.given], half)
            for side in (stricter[shown[stricter]], looser)
        ]
    return np.sort(np.concatenate([[slider.given], *sides])).astype(np.int64)


def _spread(side: Ints, rejected: Ints, given: int, half: int) -> Ints:
    """Choose at most ``half`` values, the nearest first, whose counts differ by similar factors."""
    counts = rejected[side]
    changed = np.flatnonzero(np.diff(counts, prepend=given))
    if len(changed) <= half:
        return side[changed]
    size = np.log1p(counts[changed])
    goals = np.linspace(np.log1p(given), size[-1], half + 1)[1:]
    nearest = np.abs(size[:, None] - goals).argmin(axis=0)
    chosen: Ints = side[changed[np.unique(nearest)]]
    return chosen


@dataclass(frozen=True, eq=False)
class Counts:
    """Counts of some points.

    Attributes
    ----------
    points : in all
    bad, good : outliers and good points according to the truth; both 0 without
    by_range : (R,) points from each of ``RANGES`` on
    detectors : points by the detector that rejects them
    reasons : points by the number of the strongest reason, of :func:`.reasons`
    clouds : points by number of the cloud

    """

    points: int
    bad: int
    good: int
    by_range: Ints
    detectors: Mapping[str, int]
    reasons: Mapping[int, int]
    clouds: Mapping[int, int]

    def of_clouds(self, clouds: Iterable[int]) -> int:
        """Count the points of some clouds."""
        return sum(self.clouds.get(number, 0) for number in clouds)


class RowCounts:
    """Counts points of all clouds by row: row 1 of two holds rejected points, for example."""

    def __init__(self, rows: int) -> None:
        self._truth, self._ranges, self._reasons, self._detectors = (
            np.zeros((rows, columns), np.int64)
            for columns in (3, len(RANGE_EDGES_M), REASONS, DETECTOR_BITS)
        )
        self._clouds: dict[int, Ints] = {}

    def add(self, cloud: ReportCloud, row: Ints | Bools) -> None:
        """Count the points of a cloud in the rows (N,)."""
        row, verdict = np.asarray(row, np.int64), cloud.verdict
        rows = len(self._truth)
        self._truth += _crossed(row, cloud.truth, self._truth.shape)
        bins = np.searchsorted(RANGE_EDGES_M, cloud.points.range, side='right') - 1
        self._ranges += _crossed(row, bins, self._ranges.shape)
        self._reasons += _crossed(row, verdict.reason, self._reasons.shape)
        for bit in range(DETECTOR_BITS):
            mine = row[(verdict.detectors >> np.uint16(bit)) & np.uint16(1) != 0]
            self._detectors[:, bit] += np.bincount(mine, minlength=rows)
        self._clouds[cloud.number] = np.bincount(row, minlength=rows)

    def above(self, row: int, detector: str = '') -> Counts:
        """Count the points of this row and of those behind it.

        ``detector`` rejects all of them, if it is given.
        """
        truth = self._truth[row:].sum(axis=0)
        points = int(truth.sum())
        bits = self._detectors[row:].sum(axis=0)
        by_bit = {name: int(bits[one.bit.bit_length() - 1]) for name, one in DETECTORS.items()}
        detectors = {detector: points} if detector else by_bit
        reasons = self._reasons[row:].sum(axis=0)
        reasons[0] = 0
        return Counts(
            points,
            int(truth[BAD]),
            int(truth[GOOD]),
            self._ranges[row:].sum(axis=0),
            {name: count for name, count in detectors.items() if count},
            {number: int(reasons[number]) for number in np.flatnonzero(reasons).tolist()},
            {number: int(one[row:].sum()) for number, one in self._clouds.items()},
        )


def _crossed(rows: Ints, columns: Ints | Bytes, shape: tuple[int, ...]) -> Ints:
    """Count points by row and column of a table."""
    counts = np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1])
    return counts.reshape(shape)


def exceeded(score: Floats, limits: Floats) -> Ints:
    """Count the limits, ascending, that each score is above; NaN is above none."""
    return np.where(np.isnan(score), 0, np.searchsorted(limits, score))


def above(counts: Ints) -> Ints:
    """Sum up, for each limit, what exceeds it: counts begin with what exceeds none."""
    return np.cumsum(counts[::-1])[::-1][1:]


class ScoreCounts(RowCounts):
    """Counts points by the number of limits that their scores exceed.

    Attributes
    ----------
    uncertain : (L,) bool
        Limits within rounding error of a score.

    """

    def __init__(self, limits: Floats) -> None:
        """Count nothing yet; limits ascend."""
        super().__init__(len(limits) + 1)
        self.uncertain = ~np.isfinite(limits)
        self._limits = limits

    def add_scores(self, cloud: ReportCloud) -> None:
        """Count the points of a cloud."""
        score = cloud.verdict.score.astype(np.float64)
        row = exceeded(score, self._limits)
        self.add(cloud, row)
        for beside in (row - 1, row):
            there = (beside >= 0) & (beside < len(self._limits))
            limit = self._limits[beside[there]]
            with np.errstate(invalid='ignore'):  # infinite limits
                close = np.abs(score[there] - limit) <= SCORE_TOLERANCE * limit
            self.uncertain[beside[there][close]] = True

    def rejected(self) -> Ints:
        """Count the points above each limit."""
        return above(self._truth.sum(axis=1))


class Tally:
    """Counts at the given settings, and the scores.

    Attributes
    ----------
    given : kept points in row 0, rejected ones in row 1
    untested : points without a score
    scores : (2, SCORE_BINS) points by score: good or unknown ones, and bad ones

    """

    def __init__(self) -> None:
        self.given = RowCounts(2)
        self.untested = 0
        self.scores = np.zeros((2, SCORE_BINS), np.int64)
        self._truth: list[tuple[Floats, Bools]] = []

    def add(self, cloud: ReportCloud) -> None:
        """Count the points of a cloud that was judged at the given settings."""
        score, truth = cloud.verdict.score, cloud.truth
        self.given.add(cloud, cloud.verdict.rejected)
        known = ~np.isnan(score)
        self.untested += int(np.count_nonzero(~known))
        scaled = np.minimum(score[known], MAX_SCORE) * (SCORE_BINS / MAX_SCORE)
        bins = np.minimum(scaled.astype(np.int64), SCORE_BINS - 1)
        self.scores += _crossed((truth[known] == BAD).astype(np.int64), bins, self.scores.shape)
        counted = truth != NO_TRUTH
        if counted.any():
            self._truth.append((score[counted], truth[counted] == BAD))

    def truth(self) -> tuple[Floats, Bools]:
        """Return score and truth of all points that have one."""
        parts = self._truth or [(np.empty(0), np.empty(0, np.bool_))]
        return np.concatenate([one for one, _ in parts]), np.concatenate([one for _, one in parts])
