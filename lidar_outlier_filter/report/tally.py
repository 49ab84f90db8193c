# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Exact counts of all points at every step of every slider, whether they are drawn or not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools
    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.report.sliders import Slider
    from lidar_outlier_filter.report.sources import ReportCloud


RANGES = (0.0, 5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 75.0, 100.0, 150.0, 200.0)  # metres: begin there
SCORE_BINS, LARGEST_SCORE = 80, 4.0  # the last bin holds what is larger, too


@dataclass(eq=False)
class Counts:
    """What is counted of one step: all points, or those that it rejects.

    Attributes
    ----------
    points : in all
    bad, good : those that the truth says; both 0 without
    by_range : (R,) from each of ``RANGES`` on
    detectors : by who rejects them
    reasons : by the strongest reason, a number of :func:`.reasons`; those without are not in it

    """

    points: int
    bad: int
    good: int
    by_range: NDArray[np.int64]
    detectors: Counter[str] = field(default_factory=Counter)
    reasons: Counter[int] = field(default_factory=Counter)

    def note(self, verdict: Verdict) -> None:
        """Count who rejects points, and why."""
        bits = verdict.detectors[verdict.rejected]
        for one in DETECTORS.values():
            if count := int(np.count_nonzero(bits & one.bit)):
                self.detectors[one.name] += count
        self.reasons.update(positive(np.bincount(verdict.reason[verdict.rejected])))


def positive(counts: NDArray[np.int64]) -> dict[int, int]:
    """List the numbers from 1 on that were counted."""
    return {number: int(counts[number]) for number in np.flatnonzero(counts).tolist() if number}


class Tally:
    """Counts of all points, and of those that each step of each slider rejects."""

    def __init__(self, codes: Codes) -> None:
        """Count nothing yet."""
        self.all = nothing()
        self.given = nothing()
        self.at: list[list[Counts]] = []
        self.clouds: dict[int, int] = {}  # points of each cloud, by its number
        self.by_cloud: list[list[dict[int, int]]] = []
        self.untested = 0
        self.scores = np.zeros((2, SCORE_BINS), np.int64)  # of good or unknown points, and of bad
        self._given_by_cloud: dict[int, int] = {}
        self._codes = codes
        self._truth: list[tuple[NDArray[np.float32], Bools]] = []

    def add(self, cloud: ReportCloud) -> None:
        """Count all points of a cloud, and those rejected at the given settings."""
        score = cloud.verdict.score
        bad, good = self.split(cloud)
        _add(self.all, cloud, np.ones(len(score), np.bool_), bad, good)
        _add(self.given, cloud, cloud.verdict.rejected, bad, good)
        self.given.note(cloud.verdict)
        self.clouds[cloud.number] = len(score)
        self._given_by_cloud[cloud.number] = int(np.count_nonzero(cloud.verdict.rejected))
        known = ~np.isnan(score)
        self.untested += int(np.count_nonzero(~known))
        scaled = np.minimum(score[known], LARGEST_SCORE) * (SCORE_BINS / LARGEST_SCORE)
        bins = np.minimum(scaled.astype(np.int64), SCORE_BINS - 1)
        for row, mask in enumerate((~bad, bad)):
            self.scores[row] += np.bincount(bins[mask[known]], minlength=SCORE_BINS)
        if cloud.code is not None:
            counted = bad | good
            self._truth.append((score[counted], bad[counted]))

    def open(self, sliders: Sequence[Slider]) -> None:
        """Make place for the steps of sliders; what the given one rejects is known."""
        for slider in sliders:
            self.at.append([nothing() for _ in slider.values])
            self.by_cloud.append([{} for _ in slider.values])
            self.put(len(self.at) - 1, slider.given, self.given, self._given_by_cloud)

    def put(self, slider: int, step: int, counts: Counts, by_cloud: dict[int, int]) -> None:
        """Note what a step rejects."""
        self.at[slider][step], self.by_cloud[slider][step] = counts, by_cloud

    def add_step(self, slider: int, step: int, cloud: ReportCloud) -> None:
        """Count the points of a cloud that was judged at a step."""
        bad, good = self.split(cloud)
        rejected, counts = cloud.verdict.rejected, self.at[slider][step]
        _add(counts, cloud, rejected, bad, good)
        counts.note(cloud.verdict)
        self.by_cloud[slider][step][cloud.number] = int(np.count_nonzero(rejected))

    @property
    def has_truth(self) -> bool:
        """Whether any point is an outlier in truth."""
        return self.all.bad > 0

    def truth(self) -> tuple[NDArray[np.float32], Bools]:
        """Give score and truth of all points that count."""
        parts = self._truth or [(np.empty(0, np.float32), np.empty(0, np.bool_))]
        return np.concatenate([one for one, _ in parts]), np.concatenate([one for _, one in parts])

    def of_clouds(self, slider: int, step: int, clouds: Sequence[int]) -> NDArray[np.int64]:
        """Return how many points of each of some clouds a step rejects."""
        counts = self.by_cloud[slider][step]
        return np.array([counts.get(number, 0) for number in clouds], np.int64)

    def split(self, cloud: ReportCloud) -> tuple[Bools, Bools]:
        """Return which points are outliers in truth, and which are good; neither without truth."""
        if cloud.code is None:
            nobody = np.zeros(len(cloud.points), np.bool_)
            return nobody, nobody
        bad, counted = self._codes.bad(cloud.code), self._codes.counted(cloud.code)
        return bad & counted, ~bad & counted


def nothing() -> Counts:
    """Count no point."""
    return Counts(0, 0, 0, np.zeros(len(RANGES), np.int64))


def _add(counts: Counts, cloud: ReportCloud, mask: Bools, bad: Bools, good: Bools) -> None:
    counts.points += int(np.count_nonzero(mask))
    counts.bad += int(np.count_nonzero(mask & bad))
    counts.good += int(np.count_nonzero(mask & good))
    counts.by_range += np.bincount(range_bins(cloud)[mask], minlength=len(RANGES))


def range_bins(cloud: ReportCloud) -> NDArray[np.intp]:
    """Find the one of ``RANGES`` that each point of a cloud lies behind."""
    return np.searchsorted(RANGES, cloud.points.range, side='right') - 1
