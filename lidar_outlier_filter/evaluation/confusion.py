# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Truth against verdict: counts, the figures that the papers make of them, intervals and curves.

The positive class is the outlier. Two conventions for naming errors are in use. Leslar, Wang and Hu
(2010, tables 2-5) and Sotoodeh (2006, table 3; 2007, table 1) divide by all points of the cloud;
Pirotti et al. (2018) divide false rejections by the good points and misses by the outliers, as ROC
curves do. Both are here, under different names.

A curve has the counts of every threshold of a score. Untested points (score NaN) are kept by every
threshold: they come last, all together. Equal scores have one point on the curve, so ties count
half in the area under the ROC curve, as in scikit-learn.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Reals
from lidar_outlier_filter.errors import FilterError

CONFIDENCE = 0.95
DRAWS = 2000  # of the bootstrap
MIN_STRETCHES = 2  # one stretch alone says nothing of how stretches differ
FOUND, MISSED, LOST, KEPT = range(4)  # columns of a tally
MAX_CURVE_POINTS = 1000  # that a thinned curve keeps: more than a picture can show
# The shares of a :class:`Confusion`: part, of what, and title in the words of the papers.
SHARES = {
    'prevalence': ('outliers', 'total', 'outliers'),
    'recall': ('found', 'outliers', 'outliers identified, recall'),
    'misses': ('missed', 'outliers', 'outliers missed'),
    'false_rejections': ('lost', 'good', 'non-outliers identified'),
    'identified': ('rejected', 'total', 'identified'),
    'alpha_error': ('lost', 'total', 'wrongly identified, α-error'),
    'beta_error': ('missed', 'total', 'missed, β-error'),
    'precision': ('found', 'rejected', 'rightly identified, precision'),
}


class Interval(NamedTuple):
    """Confidence limits of a figure; both NaN if unknown."""

    low: float
    high: float


UNKNOWN = Interval(math.nan, math.nan)


class Share(NamedTuple):
    """A part of a total, as counts."""

    part: int
    total: int

    @property
    def ratio(self) -> float:
        """Part ÷ total; NaN of nothing."""
        return self.part / self.total if self.total else math.nan

    @property
    def interval(self) -> Interval:
        """Wilson's score interval of 95 %, which holds for points that are independent.

        Outliers come in clouds: between whole drives the share varies more.
        """
        n, part = self.total, self.part
        if n == 0:
            return UNKNOWN
        z2 = float(ndtri(0.5 + CONFIDENCE / 2)) ** 2
        middle = part + z2 / 2
        half = math.sqrt(z2 * (part * (n - part) / n + z2 / 4))
        # Rounding must leave no trace at 0 and at n.
        low = 0.0 if part == 0 else (middle - half) / (n + z2)
        high = 1.0 if part == n else (middle + half) / (n + z2)
        return Interval(low, high)


@dataclass(frozen=True)
class Confusion:
    """The four counts of a verdict on points whose truth is known.

    Attributes
    ----------
    found : outliers rejected ("outliers identified", true positives)
    missed : outliers kept (false negatives)
    lost : good points rejected ("non-outliers identified", false positives)
    kept : good points kept (true negatives)

    """

    found: int
    missed: int
    lost: int
    kept: int

    @property
    def outliers(self) -> int:
        """Outliers in truth."""
        return self.found + self.missed

    @property
    def good(self) -> int:
        """Good points in truth."""
        return self.lost + self.kept

    @property
    def rejected(self) -> int:
        """Points rejected."""
        return self.found + self.lost

    @property
    def total(self) -> int:
        """All points."""
        return self.outliers + self.good

    def share(self, name: str) -> Share:
        """Return one of ``SHARES``."""
        part, total, _ = SHARES[name]
        return Share(getattr(self, part), getattr(self, total))

    @property
    def precision(self) -> Share:
        """Of the rejected points those that are outliers."""
        return self.share('precision')

    @property
    def recall(self) -> Share:
        """Of the outliers those rejected: "% of outliers identified", true positive rate."""
        return self.share('recall')

    @property
    def false_rejections(self) -> Share:
        """Of the good points those rejected: false positive rate."""
        return self.share('false_rejections')

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; NaN with nothing to find and nothing rejected."""
        return Share(2 * self.found, 2 * self.found + self.lost + self.missed).ratio


def confusion(bad: Bools, rejected: Bools) -> Confusion:
    """Compare a verdict with the truth, (N,) bool each."""
    (counts,) = tally(bad, rejected)
    return Confusion(*counts.tolist())


def tally(bad: Bools, rejected: Bools, group: Ints | None = None, groups: int = 1) -> Ints:
    """Count found, missed, lost and kept points in each group: (groups, 4).

    Parameters
    ----------
    bad, rejected : (N,) bool
        Truth and verdict.
    group : (N,) int64 or None
        The group of each point, from 0 to ``groups`` - 1; None: all are of one group.
    groups : int

    """
    code = np.where(bad, FOUND, LOST) + ~rejected
    if group is not None:
        code = code + 4 * group
    return np.bincount(code, minlength=4 * groups).reshape(groups, 4)


def f1(counts: Ints) -> Floats:
    """Return the F1 of tallies, (..., 4) to (...); NaN of nothing to find and nothing rejected."""
    twice = 2.0 * counts[..., FOUND]
    below = twice + counts[..., LOST] + counts[..., MISSED]
    result = np.full(below.shape, np.nan)
    np.divide(twice, below, out=result, where=below > 0)
    return result


def f1_interval(counts: Ints, seed: int = 1) -> Interval:
    """Say how far the F1 would vary between recordings like this one.

    Percentile bootstrap: all stretches, resampled with replacement 2000 times; points that lie
    together in a recording, such as a plume, stay together. Draws without any F1 are
    left out.

    Parameters
    ----------
    counts : (S, 4) int64
        Tally of each stretch. Fewer than two give no interval.
    seed : int
        The same seed gives the same interval.

    """
    count = len(counts)
    if count < MIN_STRETCHES:
        return UNKNOWN
    times = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), DRAWS)
    drawn = f1(times @ counts)
    known = drawn[~np.isnan(drawn)]
    if len(known) == 0:
        return UNKNOWN
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(known, [tail, 1 - tail])
    return Interval(float(low), float(high))


@dataclass(frozen=True)
class Curve:
    """Cumulative counts at every threshold that separates points, strictest first.

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
        """Share of the outliers rejected (M,): true positive rate."""
        share: Floats = self.found / self.found[-1]
        return share

    @property
    def false_rejections(self) -> Floats:
        """Share of good points rejected (M,): false positive rate."""
        share: Floats = self.lost / self.lost[-1]
        return share

    @property
    def precision(self) -> Floats:
        """Share of outliers among rejected points (M,); 1 if no point is rejected."""
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

    def thinned(self, most: int = MAX_CURVE_POINTS) -> 'Curve':
        """Keep at most ``most`` points, the first and last included, evenly along the curve.

        One third each is even in recall, in false rejections and in log false rejections, so that
        plots on any scale look complete.
        """
        if len(self.threshold) <= most:
            return self
        lost = np.log(np.maximum(self.lost, 0.5))
        axes = [column / column[-1] for column in (self.found, self.lost, lost - lost[0])]
        goals = np.linspace(0.0, 1.0, most // 3)
        index = np.unique([np.searchsorted(axis, goals) for axis in axes])
        return Curve(self.threshold[index], self.found[index], self.lost[index])


def curve(bad: Bools, score: Reals) -> Curve:
    """Count what every threshold rejects.

    Parameters
    ----------
    bad : (N,) bool
        The outliers in truth.
    score : (N,) float
        The larger, the more of an outlier; NaN for untested points.

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
