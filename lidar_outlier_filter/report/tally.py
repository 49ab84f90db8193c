# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Exact counts of all points at every step of every slider, whether they are drawn or not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.report.sliders import Slider
    from lidar_outlier_filter.report.sources import ReportCloud

    Mask = NDArray[np.bool_]

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

    """

    points: int
    bad: int
    good: int
    by_range: NDArray[np.int64]

    def clear(self) -> None:
        """Count from nothing again."""
        self.points = self.bad = self.good = 0
        self.by_range[:] = 0


class Tally:
    """Counts of all points, and of those that each step of each slider rejects."""

    def __init__(self, sliders: Sequence[Slider], codes: Codes) -> None:
        """Count nothing yet."""
        self.all = _nothing()
        self.at = [[_nothing() for _ in slider.values] for slider in sliders]
        self.clouds: dict[int, int] = {}  # points of each cloud, by its number
        self.by_cloud: list[list[dict[int, int]]] = [[{} for _ in one.values] for one in sliders]
        self.untested = 0
        # Points that are rejected at the given settings, by who rejects them, and by their reasons.
        self.detectors: Counter[str] = Counter()
        self.reasons: Counter[int] = Counter()
        self.scores = np.zeros((2, SCORE_BINS), np.int64)  # of good or unknown points, and of bad
        self._codes = codes
        self._truth: list[tuple[NDArray[np.float32], Mask]] = []

    def add(self, cloud: ReportCloud) -> None:
        """Count all points of a cloud."""
        score = cloud.verdict.score
        bad, good = self._split(cloud)
        _add(self.all, cloud, np.ones(len(score), np.bool_), bad, good)
        self.clouds[cloud.number] = len(score)
        self._count_reasons(cloud.verdict)
        known = ~np.isnan(score)
        self.untested += int(np.count_nonzero(~known))
        scaled = np.minimum(score[known], LARGEST_SCORE) * (SCORE_BINS / LARGEST_SCORE)
        bins = np.minimum(scaled.astype(np.int64), SCORE_BINS - 1)
        for row, mask in enumerate((~bad, bad)):
            self.scores[row] += np.bincount(bins[mask[known]], minlength=SCORE_BINS)
        if cloud.code is not None:
            counted = bad | good
            self._truth.append((score[counted], bad[counted]))

    def _count_reasons(self, verdict: Verdict) -> None:
        bits = verdict.detectors[verdict.rejected]
        for one in DETECTORS.values():
            if count := int(np.count_nonzero(bits & one.bit)):
                self.detectors[one.name] += count
        numbers, counts = np.unique(verdict.reason[verdict.rejected], return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            if number:
                self.reasons[number] += count

    def add_step(self, slider: int, step: int, cloud: ReportCloud, rejected: Mask) -> None:
        """Count the points of a cloud that a step rejects."""
        bad, good = self._split(cloud)
        _add(self.at[slider][step], cloud, rejected, bad, good)
        self.by_cloud[slider][step][cloud.number] = int(np.count_nonzero(rejected))

    @property
    def has_truth(self) -> bool:
        """Whether any point is an outlier in truth."""
        return self.all.bad > 0

    def truth(self) -> tuple[NDArray[np.float32], Mask]:
        """Give score and truth of all points that count."""
        parts = self._truth or [(np.empty(0, np.float32), np.empty(0, np.bool_))]
        return np.concatenate([one for one, _ in parts]), np.concatenate([one for _, one in parts])

    def of_clouds(self, slider: int, step: int, clouds: Sequence[int]) -> NDArray[np.int64]:
        """Return how many points of each of some clouds a step rejects."""
        counts = self.by_cloud[slider][step]
        return np.array([counts.get(number, 0) for number in clouds], np.int64)

    def _split(self, cloud: ReportCloud) -> tuple[Mask, Mask]:
        """Return which points are outliers in truth, and which are good; neither without truth."""
        if cloud.code is None:
            nobody = np.zeros(len(cloud.points), np.bool_)
            return nobody, nobody
        bad, counted = self._codes.bad(cloud.code), self._codes.counted(cloud.code)
        return bad & counted, ~bad & counted


def _nothing() -> Counts:
    return Counts(0, 0, 0, np.zeros(len(RANGES), np.int64))


def _add(counts: Counts, cloud: ReportCloud, mask: Mask, bad: Mask, good: Mask) -> None:
    counts.points += int(np.count_nonzero(mask))
    counts.bad += int(np.count_nonzero(mask & bad))
    counts.good += int(np.count_nonzero(mask & good))
    bins = np.searchsorted(RANGES, cloud.points.range[mask], side='right') - 1
    counts.by_range += np.bincount(bins, minlength=len(RANGES))
