# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""ROC and precision–recall curves: what every threshold of a score would have given.

Untested points (score NaN) are kept by every threshold: they come last in both curves, all
together, below the lowest score. What cannot be distinguished has one point on the curve, so ties
count half in the area under the ROC curve, as in the statistic of Mann and Whitney. With that, all
figures are those of scikit-learn, there of scores whose NaN were replaced by one lowest value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats


MOST_POINTS = 1000  # that a thinned curve keeps: more than a picture can show


@dataclass(frozen=True)
class Curve:
    """Cumulative counts at every threshold that says points apart, from the strictest on.

    Attributes
    ----------
    threshold : (M,) float64
        Points with a score of at least this are rejected, descending. The first is inf: nothing is
        rejected. -inf: even the untested are.
    found, lost : (M,) float64
        Outliers and good points rejected at that threshold; whole numbers.

    """

    threshold: Floats
    found: Floats
    lost: Floats

    @property
    def recall(self) -> Floats:
        """Of the outliers those rejected (M,): true positive rate."""
        share: Floats = self.found / self.found[-1]
        return share

    @property
    def false_rejections(self) -> Floats:
        """Of the good points those rejected (M,): false positive rate."""
        share: Floats = self.lost / self.lost[-1]
        return share

    @property
    def precision(self) -> Floats:
        """Of the rejected points those that are outliers (M,); 1 where none is rejected."""
        rejected = self.found + self.lost
        return np.divide(self.found, rejected, out=np.ones_like(rejected), where=rejected > 0)

    @property
    def best(self) -> float:
        """Largest F1 that a threshold gives: 2 found ÷ (rejected + outliers)."""
        return float(np.max(2 * self.found / (self.found + self.lost + self.found[-1])))

    @property
    def auc(self) -> float:
        """Area under the ROC curve: the chance that an outlier scores above a good point."""
        width, height = np.diff(self.false_rejections), self.recall
        return float(np.sum(width * (height[1:] + height[:-1])) / 2)

    @property
    def average_precision(self) -> float:
        """Area under the steps of the precision–recall curve: Σ (Rₙ - Rₙ₋₁) Pₙ."""
        return float(np.sum(np.diff(self.recall) * self.precision[1:]))

    def thinned(self, most: int = MOST_POINTS) -> Curve:
        """Keep at most so many points, the first and the last among them, evenly along the curve.

        Evenly in recall, in false rejections and in the logarithm of those, one third each, so that
        no scale of a picture shows where points are missing.
        """
        if len(self.threshold) <= most:
            return self
        lost = np.log(np.maximum(self.lost, 0.5))
        axes = [column / column[-1] for column in (self.found, self.lost, lost - lost[0])]
        goals = np.linspace(0.0, 1.0, most // 3)
        index = np.unique([np.searchsorted(axis, goals) for axis in axes])
        return Curve(self.threshold[index], self.found[index], self.lost[index])


def curve(bad: Bools, score: NDArray[np.floating]) -> Curve:
    """Count what every threshold rejects.

    Parameters
    ----------
    bad : (N,) bool
        The outliers in truth.
    score : (N,) float
        The larger, the more of an outlier; NaN for untested points.

    Raises
    ------
    FilterError
        If there are no outliers, or no good points.

    """
    outliers = int(np.count_nonzero(bad))
    if outliers in {0, len(bad)}:
        raise FilterError(
            'the truth behind a curve', 'of outliers and good points', f'{outliers} of {len(bad)}'
        )
    lowered = np.where(np.isnan(score), -np.inf, score).astype(np.float64)
    order = np.argsort(-lowered, kind='stable')
    ordered = lowered[order]
    # The last point of each group of equal scores stands for the group.
    last = np.flatnonzero(np.append(ordered[1:] != ordered[:-1], True))
    found = np.cumsum(bad[order])[last]
    zero, lost = np.zeros(1), last + 1 - found
    return Curve(
        np.concatenate([[np.inf], ordered[last]]),
        np.concatenate([zero, found]),
        np.concatenate([zero, lost]),
    )
