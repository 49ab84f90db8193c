# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The chain: detectors in their order, each on what the earlier ones left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core import scanlines
from lidar_outlier_filter.core.detectors import alpha_beta_gamma
from lidar_outlier_filter.core.points import Points

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from lidar_outlier_filter.parameters import FilterParameters

    Scores = tuple[NDArray[np.float64], NDArray[np.bool_], int]  # score, rejected, passes
    Detect = Callable[[Points, FilterParameters], Scores]

# The bit of a detector never changes: recorded clouds carry it in `outlier_detectors`.
BITS = {'alpha_beta_gamma': 1}
# Rounding to float32 must not make a rejected point look kept.
ABOVE_ONE = np.nextafter(np.float32(1), np.float32(2))


@dataclass(frozen=True)
class Verdict:
    """What the chain says of N points.

    Attributes
    ----------
    score : (N,) float32
        The largest score any detector gave; NaN for a point that none could test.
    detectors : (N,) uint16
        The bits of the detectors that rejected the point; 0 for a point that is kept.

    """

    score: NDArray[np.float32]
    detectors: NDArray[np.uint16]

    @classmethod
    def untested(cls, count: int) -> Verdict:
        """Return the verdict of points that nobody has looked at."""
        return cls(np.full(count, np.nan, np.float32), np.zeros(count, np.uint16))

    @property
    def rejected(self) -> NDArray[np.bool_]:
        """Tell which points at least one detector rejected."""
        rejected: NDArray[np.bool_] = self.detectors != 0
        return rejected


class Chain:
    """The detectors of one set of parameters."""

    def __init__(self, parameters: FilterParameters) -> None:
        """Choose the detectors that ``parameters.chain`` names."""
        self.parameters = parameters
        self.passes = 0  # the most that a detector has needed
        self._detectors = [(BITS[name], _DETECTORS[name]) for name in parameters.chain]

    # A score beyond float32 is inf, which is as good.
    @np.errstate(over='ignore')
    def judge(self, points: Points) -> Verdict:
        """Judge valid points that lie together in time; the verdict is in their order."""
        verdict = Verdict.untested(len(points))
        left = np.arange(len(points))
        for bit, detect in self._detectors:
            these = points if len(left) == len(points) else points.take(left)
            score, rejected, passes = detect(these, self.parameters)
            self.passes = max(self.passes, passes)
            rounded = score.astype(np.float32)
            rounded[rejected] = np.maximum(rounded[rejected], ABOVE_ONE)
            verdict.score[left] = np.fmax(verdict.score[left], rounded)
            verdict.detectors[left[rejected]] |= bit
            left = left[~rejected]
        return verdict

    def compile(self) -> None:
        """Run every detector once on a few points, so that its kernels are ready."""
        count = 64
        xyz = np.zeros((count, 3))
        xyz[:, 0] = np.arange(count)
        xyz[count // 2, 2] = 10.0
        t = np.arange(count) * 1000
        line, valid = np.zeros(count, np.int64), np.ones(count, np.bool_)
        for order in (np.arange(count), np.arange(count)[::-1]):
            self.judge(Points(xyz, t, line, valid).take(order))
        self.passes = 0


def _alpha_beta_gamma(points: Points, parameters: FilterParameters) -> Scores:
    """Run the smoother along the lines of the points, and give the answer in their own order."""
    order = scanlines.order_by_line(points)
    # A profile scanner's points come in this order: a copy less.
    ordered = points if scanlines.is_unchanged(order) else points.take(order)
    lines = scanlines.find_lines(ordered, parameters.gap_factor)
    outcome = alpha_beta_gamma.detect(ordered, lines, parameters.alpha_beta_gamma)
    score = np.empty(len(points))
    rejected = np.empty(len(points), np.bool_)
    score[order] = outcome.score
    rejected[order] = outcome.rejected
    return score, rejected, outcome.passes


_DETECTORS: dict[str, Detect] = {'alpha_beta_gamma': _alpha_beta_gamma}
