# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A weighted sum of features of the scan line, the neighbours and their surface.

Most features are logarithms of a ratio that is about 1 for a good point. Each contributes nothing
up to a least value and no more beyond a largest one, so that none rejects a point alone:

    statistic = Σ weight · (min(max(log ratio, least), most) - least), at least 0

With d3, d5 and d20 the mean distances to so many nearest neighbours, the ratios are

``spacing``
    d3 ÷ what the sensor leads one to expect. For a spinning sensor that is a part of the range, the
    same for all points; for a profile scanner the step along the line or the distance to another
    line, whichever is more, as is usual in this part of the line.
``step``
    Distance to the nearer neighbour in the line ÷ what is usual in this part of it.
``lonely``
    d5 ÷ what is usual in this part of the line.
``amid``
    Median d5 of the 20 neighbours ÷ d20: small at the end or the edge of something, where even good
    points are lonely.
``along``
    Difference from the best of three predictions along the line ÷ the median difference.
``surface``
    No logarithm, because noise ends so abruptly: how many standard deviations the point is from the
    surface of the 20 neighbours, of the typical ones or half their own, whichever is less, from 1
    to 8, less 2, so that a point on it scores lower; times how even the surface is (1.3 × the
    typical standard deviation ÷ their own, at most 1), and how much the point is amidst them: at
    edges the surface is no measure.
``alone``
    9 ÷ (1 + how many of the 8 nearest neighbours are of other lines).
``company``
    No logarithm either, and from the second pass on only: how many of its neighbours were
    rejected ÷ 20, at most 1, less a third. The inside of a dense cloud of outliers follows its
    rim, and a good point does not follow the few outliers beside it.

"Usual" is the median of the points up to eight returns away in the line. A profile scanner and a
spinning sensor have weights of their own, those of a logistic regression on simulated drives;
``company`` and the thresholds were tried on them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.explain.reasons import (
    SLANTED,
    strongest_of_sum,
)
from lidar_outlier_filter.core.detectors.boosted_trees.parameters import (
    BoostedTrees,
    SpinningWeights,
    Weights,
)
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.features import (
    FEATURES,
    compute,
    compute_again,
    see,
    see_without,
    weigh,
)
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.groups import straightness
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.surface import K
from lidar_outlier_filter.core.points.scan_lines import is_interleaved

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bytes, Floats
    from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.features import (
        Features,
        Scan,
    )
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

PARTS = (*FEATURES, 'slanted')  # of a score


class FirstLook(NamedTuple):
    """What the first pass knows of points: the scan, the sensor's weights, the features."""

    scan: Scan
    weights: Weights
    features: Features


def neighbours() -> int:
    """Return the length of the lists of neighbours that :func:`detect` asks for."""
    return K


def detect(
    neighbourhood: Neighbourhood,
    points: Points,
    parameters: FilterParameters,
    reason: Bytes | None = None,
    parts: Floats | None = None,
    first: FirstLook | None = None,
) -> Floats:
    """Score every point by the weighted sum of its features.

    Each further pass computes them again for the points that lost neighbours, without the points
    that the earlier ones rejected. Groups are looked for among what is left at last.

    Parameters
    ----------
    neighbourhood : of the N points
    points : the same, in the order in which they were given
    parameters : ``boosted_trees``, the weights of either sensor, ``gap_factor``
    reason : (N,) is filled with numbers of ``REASON_NAMES``; 0 for points that are not rejected
    parts : (N, 9), of zeros, is filled with what each of ``PARTS`` adds to the score; where their
        sum is negative, the score is 0
    first : what :func:`look_first` finds of these points, if that is known

    Returns
    -------
    (N,) float64
        In that order, statistic ÷ (``boosted_trees.threshold`` · the sensor's threshold); NaN for
        points that have fewer than 20 others.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import detector
    >>> from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.parameters.filter import FilterParameters
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> t = np.arange(900) * 50_000  # nanoseconds
    >>> points = Points(xyz, t, x.astype(np.int64), np.ones(900, np.bool_))
    >>> near = Neighbourhood(xyz, detector.neighbours())
    >>> score = detector.detect(near, points, FilterParameters())
    >>> np.flatnonzero(score > 1).tolist()
    [77]

    """
    score = np.full(len(points), np.nan)
    if len(points) <= K:
        return score
    scan, weights, result = first or look_first(neighbourhood, points, parameters)
    threshold = parameters.of(BoostedTrees).threshold * weights.threshold
    statistic = weigh(result.contributions, _weights(weights)) / threshold
    where = neighbourhood.order
    number = None if reason is None else strongest_of_sum(result.contributions, _weights(weights))
    _note_parts(parts, where, result, _weights(weights) / threshold)
    for _ in range(weights.passes - 1):
        rejected = statistic > 1
        left = np.flatnonzero(~rejected)
        if len(left) == len(where) or len(left) <= K:
            break
        score[where] = statistic
        _note(reason, where, statistic, number)
        nearest = scan.neighbourhood.nearest(K).index
        scan = see_without(scan, rejected, parameters.gap_factor)
        result = compute_again(scan, result, nearest, rejected)
        again = weigh(result.contributions, _weights(weights)) / threshold
        where, statistic = where[left], np.where(result.wanted, again, statistic[left])
        _note_parts(parts, where, result, _weights(weights) / threshold)
        if number is not None:
            newly = strongest_of_sum(result.contributions, _weights(weights))
            number = np.where(result.wanted, newly, number[left])
    if weights.slanted:
        straight = straightness(scan, result.usual.spacing) / parameters.of(BoostedTrees).threshold
        if number is not None:
            number[straight > statistic] = SLANTED
        if parts is not None:
            by_group = np.flatnonzero(straight > statistic)
            parts[where[by_group]] = 0.0
            parts[where[by_group], -1] = straight[by_group]
        statistic = np.fmax(statistic, straight)
    score[where] = statistic
    _note(reason, where, statistic, number)
    return score


def _note_parts(
    parts: Floats | None, where: NDArray[np.intp], result: Features, weights: Floats
) -> None:
    """Note what each feature adds to the scores that were computed, if anyone asks."""
    if parts is not None:
        wanted = np.flatnonzero(result.wanted)
        parts[where[wanted], : len(FEATURES)] = result.contributions[wanted] * weights


def _note(
    reason: Bytes | None, where: NDArray[np.intp], statistic: Floats, number: Bytes | None
) -> None:
    """Note why points are rejected, if anyone asks."""
    if reason is not None and number is not None:
        reason[where] = np.where(statistic > 1, number, np.uint8(0))


def look_first(
    neighbourhood: Neighbourhood, points: Points, parameters: FilterParameters
) -> FirstLook:
    """See more than 20 points, and compute their features; the threshold has no part in it."""
    scan = see(neighbourhood, points, parameters.gap_factor)
    return FirstLook(scan, *compute_first(scan, parameters))


def compute_first(scan: Scan, parameters: FilterParameters) -> tuple[Weights, Features]:
    """Choose the weights of the sensor that saw all points, and compute their features."""
    sensor = parameters.of(BoostedTrees).sensor
    if sensor == 'auto':
        spinning = is_interleaved(scan.ordered.t, scan.lines.first)
    else:
        spinning = sensor in {'spinning', 'free'}
    weights = parameters.of(SpinningWeights) if spinning else parameters.of(Weights)
    return weights, compute(scan, spinning=spinning)


def _weights(weights: Weights) -> Floats:
    return np.array([getattr(weights, name) for name in FEATURES])
