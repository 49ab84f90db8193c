# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of the neighbourhood, judged as by Pirotti et al. (2018): by their ROC curves."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Index
from lidar_outlier_filter.core.detectors import lof, sor
from lidar_outlier_filter.core.detectors.builtin import Lof, Sor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation.confusion import Confusion, Curve, Share, confusion, curve
from lidar_outlier_filter.evaluation.truth import Cause

Measure = Callable[[Neighbourhood, int], Mapping[str, Floats]]

STATISTICS = ('SOR', 'SOR2', 'LOF', 'LOF2')
CLOSE = 0.001  # false rejections at which statistics are compared; the paper has none to name
NEIGHBOURS = (3, 5, 10, 20, 40, 60, 70, 100, 150, 200)
SHOWN = (3, 10, 20, 60, 200)  # neighbours whose ROC curves are drawn


class AtBest(NamedTuple):
    """What one statistic with one number of neighbours says at its best threshold.

    Attributes
    ----------
    threshold : where recall less false rejections is largest; at least this is rejected
    whole : of all points
    single, clustered : outliers of each kind that are kept, of all of the kind
    below : outliers, of all points, at least as far below the median as the threshold is above it

    """

    threshold: float
    whole: Confusion
    single: Share
    clustered: Share
    below: Share


@dataclass(frozen=True)
class Found:
    """What all statistics with all numbers of neighbours say of one cloud.

    Attributes
    ----------
    auc, best_of : of each statistic, for each k; area under the ROC curve, and what the best
        threshold finds
    clustered, single : of each statistic, for each k; share of these outliers found where
        ``CLOSE`` of the good points are rejected
    median : of SOR and of LOF, for each k
    curves : ROC curves by statistic and k, those of ``SHOWN``

    """

    auc: dict[str, list[float]]
    best_of: dict[str, list[AtBest]]
    clustered: dict[str, list[float]]
    single: dict[str, list[float]]
    median: dict[str, list[float]]
    curves: dict[str, dict[int, Curve]]

    def best(self, name: str) -> int:
        """Return the index of the k with the largest area."""
        return int(np.argmax(self.auc[name]))


def statistics(near: Neighbourhood, k: int) -> dict[str, Floats]:
    """Return the four statistics of every point, (N,) each."""
    distance = sor.measure(near, Sor(k=k))
    factor = lof.measure(near, Lof(min_pts=k))
    return {
        'SOR': distance,
        'SOR2': np.abs(distance - np.median(distance)),
        'LOF': factor,
        'LOF2': np.abs(factor - np.median(factor)),
    }


def explore(
    xyz: Floats,
    code: Bytes,
    clustered: Cause,
    neighbours: Sequence[int] = NEIGHBOURS,
    measure: Measure = statistics,
) -> Found:
    """Compute all statistics of every point, and the ROC curve of each."""
    bad = code != Cause.GOOD
    near = Neighbourhood(xyz, max(neighbours))
    parts: list[Any] = [*(defaultdict(list) for _ in range(5)), defaultdict(dict)]
    found = Found(*parts)
    many, one = code == clustered, code == Cause.SINGLE
    for k in neighbours:
        values = measure(near, k)
        for name in ('SOR', 'LOF'):
            found.median[name].append(float(np.median(values[name])))
        for name, score in values.items():
            roc = curve(bad, score)
            found.auc[name].append(roc.auc)
            found.best_of[name].append(_at_best(roc, bad, score, one, many))
            close = float(np.quantile(score[~bad], 1 - CLOSE))
            found.clustered[name].append(float(np.mean(score[many] > close)))
            found.single[name].append(float(np.mean(score[one] > close)))
            if k in SHOWN:
                found.curves[name][k] = roc
    return found


def _at_best(roc: Curve, bad: Bools, score: Floats, single: Bools, clustered: Bools) -> AtBest:
    """Reject by the threshold of one curve that is best."""
    threshold = float(roc.threshold[int(np.argmax(roc.recall - roc.false_rejections))])
    kept = score < threshold
    below = score <= 2 * float(np.median(score)) - threshold
    return AtBest(
        threshold,
        confusion(bad, ~kept),
        _share(single, kept),
        _share(clustered, kept),
        _share(below, bad),
    )


def _share(of: Bools, which: Bools) -> Share:
    """Return how many of some points are others, too."""
    return Share(int(np.sum(of & which)), int(np.sum(of)))


def measure_pcl(near: Neighbourhood, k: int) -> Floats:
    """Return the factor of every point, (N,) as given; no k points may coincide, k at least 2."""
    others = near.nearest(k - 1).index
    density = _densities(near.xyz, others, near.squared_distances(k - 1))
    factor = np.empty(len(near))
    factor[near.order] = _factors(others, density)
    return factor


def _densities(xyz: Floats, others: Index, square: Floats) -> Floats:
    """Divide 1 by the mean squared reach distance; the first is that of a point from itself."""
    total = square.copy()
    for other in others.T:
        dx, dy, dz = (xyz - xyz[other]).T
        total += np.maximum(square[other], (dx * dx + dy * dy) + dz * dz)
    result: Floats = (others.shape[1] + 1) / total
    return result


def _factors(others: Index, density: Floats) -> Floats:
    """Divide the mean density of the neighbours, the point among them, by its own."""
    total = density.copy()
    for other in others.T:
        total += density[other]
    result: Floats = total / (others.shape[1] + 1) / density
    return result
