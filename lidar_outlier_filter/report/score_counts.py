# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What many thresholds would reject, from one histogram of the scores between their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.report.tally import RANGES, Counts, positive, range_bins

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Bytes
    from lidar_outlier_filter.report.sources import ReportCloud

ROUNDING = 3e-7  # of a score in single precision, relative: what is nearer to a limit is uncertain
NUMBERS = 256  # of reasons


def exceeded(score: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.intp]:
    """Count the limits, ascending, that each score is above; NaN is above none."""
    return np.where(np.isnan(score), 0, np.searchsorted(limits, score))


def above(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum up, for each limit, what exceeds it: counts begin with what exceeds none."""
    return np.cumsum(counts[::-1], axis=0)[::-1][1:]


def _crossed(
    rows: NDArray[np.intp], columns: NDArray[np.intp] | Bytes, shape: tuple[int, ...]
) -> NDArray[np.int64]:
    """Count points by row and column of a table."""
    counts = np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1])
    return counts.reshape(shape)


class ScoreCounts:
    """Counts points by how many limits their scores exceed.

    Attributes
    ----------
    uncertain : (L,) bool
        Limits that some score is as near to as rounding.

    """

    def __init__(self, limits: NDArray[np.float64]) -> None:
        """Count nothing yet; limits ascend."""
        self.uncertain = ~np.isfinite(limits)
        self._limits = limits
        bins = len(limits) + 1
        self._truth = np.zeros((bins, 3), np.int64)  # all, bad, good
        self._ranges = np.zeros((bins, len(RANGES)), np.int64)
        self._reasons = np.zeros((bins, NUMBERS), np.int64)
        self._clouds: dict[int, NDArray[np.int32]] = {}

    def add(self, cloud: ReportCloud, bad: Bools, good: Bools) -> None:
        """Count the points of a cloud."""
        score = cloud.verdict.score.astype(np.float64)
        bins = exceeded(score, self._limits)
        every = np.ones(len(bins), np.bool_)
        for column, mask in enumerate((every, bad, good)):
            self._truth[:, column] += np.bincount(bins[mask], minlength=len(self._truth))
        self._ranges += _crossed(bins, range_bins(cloud), self._ranges.shape)
        self._reasons += _crossed(bins, cloud.verdict.reason, self._reasons.shape)
        self._clouds[cloud.number] = np.bincount(bins).astype(np.int32)
        for beside in (bins - 1, bins):
            there = (beside >= 0) & (beside < len(self._limits))
            limit = self._limits[beside[there]]
            with np.errstate(invalid='ignore'):  # of infinite ones
                close = np.abs(score[there] - limit) <= ROUNDING * limit
            self.uncertain[beside[there][close]] = True

    def rejected(self) -> NDArray[np.int64]:
        """Count the points above each limit."""
        return above(self._truth)[:, 0]

    def over(self, limit: int, detector: str) -> tuple[Counts, dict[int, int]]:
        """Count the points above one limit, which a detector rejects there; and those by cloud."""
        points, bad, good = self._truth[limit + 1 :].sum(axis=0).tolist()
        counts = Counts(points, bad, good, self._ranges[limit + 1 :].sum(axis=0))
        counts.detectors[detector] = points
        counts.reasons.update(positive(self._reasons[limit + 1 :].sum(axis=0)))
        return counts, {number: int(one[limit + 1 :].sum()) for number, one in self._clouds.items()}
