# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The moving fixed-interval smoother derived from the α-β-γ filter (Leslar, Wang and Hu 2010).

Each point is predicted from its window, the points in front and behind it in its line segment,
under constant velocity or acceleration (``order`` 1 or 2) without process noise (equations 1-4),
and the difference is tested (15-17).

Equations (11)-(16) weigh all points of the window, the tested one too, and then take it out again
by dividing by 1 - a_0. That is the least squares prediction from the other points alone, so the
kernel sums over those: with N their normal matrix (14), the prediction's variance is q = (N⁻¹)₀₀
and (16) is σ_k² + q.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from lidar_outlier_filter.core.detectors.alpha_beta_gamma import kernels as smoother_kernels
from lidar_outlier_filter.core.detectors.alpha_beta_gamma.kernels import (
    AFTER,
    BEFORE,
    CENTRED,
    RATE,
    WEIGHT,
    Series,
    T,
    X,
    empty_series,
)
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, median
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import Lines
from lidar_outlier_filter.parameters.filter import FilterParameters

Residuals = Callable[[Series, NDArray[np.int64], AlphaBetaGamma], NDArray[np.float64]]

MIN_RESIDUALS = 10  # fewer of them in a line give no standard deviation
MAD_TO_SIGMA = 1.4826  # median of |N(0, 1)| is 0.6745


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input, line by line."""
    own = parameters.of(AlphaBetaGamma)
    return seen.along_lines(lambda points, lines: detect(points, lines, own))


def detect(points: Points, lines: Lines, parameters: AlphaBetaGamma) -> Scores:
    """Test every point against the prediction from its window.

    Each pass rejects failing points whose centred score is the largest in their windows' reach;
    the next pass tests neighbours without them. A large outlier makes its neighbours fail, too:
    rejecting all failing points at once would reject good ones. The last allowed pass rejects all
    failing points.

    Parameters
    ----------
    points : N points, sorted by line and time, all of them valid
    lines : their lines and segments
    parameters : see :class:`~.builtin.AlphaBetaGamma`

    Returns
    -------
    Scores
        In the order of the points: statistic ÷ critical value, more than 1 exactly where rejected,
        NaN for untested points; and the passes that were needed.

    References
    ----------
    .. [1] Leslar, Wang and Hu (2010): A comparison of two new methods of outlier detection for
       mobile terrestrial lidar data. ISPRS Commission I, ICWG VI.
    .. [2] Leslar, Wang and Hu (2011): Comprehensive utilization of temporal and spatial domain
       outlier detection methods for mobile terrestrial LiDAR data. Remote Sensing 3(8), 1724-1742.
       https://doi.org/10.3390/rs3081724

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors.alpha_beta_gamma import detector as smoother
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.core.points.scan_lines import find_lines
    >>> from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> t = np.arange(900) * 50_000  # nanoseconds
    >>> points = Points(xyz, t, x.astype(np.int64), np.ones(900, np.bool_))
    >>> scores = smoother.detect(points, find_lines(points, gap_factor=1.5), AlphaBetaGamma())
    >>> np.flatnonzero(scores.score > 1).tolist(), scores.passes
    ([77], 2)

    """
    before, after = parameters.before, parameters.after
    series = _series(points, lines, max(before, after))
    residuals = _engine(parameters)
    everything = np.arange(len(points), dtype=np.int64)
    standard = residuals(series, everything, parameters)
    precision = _precision(standard, points, lines, parameters)
    critical = critical_value(parameters.significance)
    either = parameters.sides == 'either'
    score, rank = _scores(standard, precision, everything, critical, either)
    rejected = np.zeros(len(points), np.bool_)
    failing = np.flatnonzero(score > 1)
    number = 1
    while len(failing) and number < parameters.passes:
        worst = failing[_is_worst(failing, rank, series.before, series.after, before + after)]
        rejected[worst] = True
        spoiled = _unlink(worst, series.before, series.after, before + after, rejected)
        standard = residuals(series, spoiled, parameters)
        score[spoiled], rank[spoiled] = _scores(standard, precision, spoiled, critical, either)
        failing = np.flatnonzero((score > 1) & ~rejected)
        number += 1
    return Scores(score, passes=number)


@lru_cache(maxsize=64)
def critical_value(significance: float) -> float:
    """Return the two-sided quantile of the normal distribution (17)."""
    return -float(ndtri(significance / 2))


def _series(points: Points, lines: Lines, pad: int) -> Series:
    # The links are copied: taking a point out must not be seen by other detectors.
    series = empty_series(pad, lines.before.copy(), lines.after.copy())
    known = lines.interval > 0
    rate = np.where(known, 1 / np.where(known, lines.interval, 1.0), 0.0)
    # Relative to the first point, nanoseconds are whole in a float64 too.
    series.row(T)[:] = points.t - points.t[:1]
    series.row(slice(X, X + 3))[:] = points.xyz.T
    series.row(WEIGHT)[:] = 1.0 if points.sigma is None else points.sigma**-2.0
    series.row(RATE)[:] = np.repeat(rate, np.diff(lines.first))
    return series


def _engine(parameters: AlphaBetaGamma) -> Residuals:
    if parameters.engine == 'kernel':
        return smoother_kernels.residuals
    from lidar_outlier_filter.core.detectors.alpha_beta_gamma import kalman as filterpy_engine  # noqa: PLC0415  optional

    return filterpy_engine.residuals


def _precision(
    standard: NDArray[np.float64], points: Points, lines: Lines, parameters: AlphaBetaGamma
) -> NDArray[np.float64]:
    """Return 1/σ, (3, N), by which the differences are yet to be multiplied."""
    if points.sigma is not None:
        return np.ones((3, len(points)))
    if parameters.sigma > 0:
        return np.full((3, len(points)), 1 / parameters.sigma)
    return _line_precision(standard[CENTRED], lines.first, parameters.sigma_floor)


@kernel
def _line_precision(
    standard: NDArray[np.float64], first: NDArray[np.int64], floor: float
) -> NDArray[np.float64]:
    """Estimate 1/σ of each line and coordinate from its median absolute centred difference.

    A line with too few differences for a median has NaN: its points stay untested.
    """
    result = np.full(standard.shape, np.nan)
    scratch = np.empty(standard.shape[1])
    for axis in range(3):
        for line in range(len(first) - 1):
            begin, end = first[line], first[line + 1]
            result[axis, begin:end] = _one_precision(standard[axis], begin, end, floor, scratch)
    return result


@device_function
def _one_precision(
    standard: NDArray[np.float64], begin: int, end: int, floor: float, scratch: NDArray[np.float64]
) -> float:
    """Estimate 1/σ of points begin to end; NaN of too few."""
    count = 0
    for i in range(begin, end):
        value = abs(standard[i])
        scratch[count] = value
        count += not np.isnan(value)
    if count < MIN_RESIDUALS:
        return np.nan
    return 1 / max(floor, MAD_TO_SIGMA * median(scratch, count))


@kernel
def _scores(
    standard: NDArray[np.float64],
    precision: NDArray[np.float64],
    which: NDArray[np.int64],
    critical: float,
    either: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Score points by the centred window, or by the side they agree with better, and rank them.

    The centred window stands in for a side that is too short. The rank says which of the points
    that fail goes first: it is the score of the centred window, in which no good point stands out
    more than a lone outlier beside it; one-sided windows extrapolate. NaN for points that pass.
    """
    result = np.empty(len(which))
    rank = np.full(len(which), np.nan)
    for m in range(len(which)):
        k = which[m]
        centred = _window_score(standard[CENTRED], m, precision, k, critical)
        score = centred
        if either:
            front = _window_score(standard[BEFORE], m, precision, k, critical)
            behind = _window_score(standard[AFTER], m, precision, k, critical)
            front = centred if np.isnan(front) else front
            score = min(front, centred if np.isnan(behind) else behind)
        result[m] = score
        if score > 1:
            rank[m] = centred
    return result, rank


@device_function
def _window_score(
    standard: NDArray[np.float64], m: int, precision: NDArray[np.float64], k: int, critical: float
) -> float:
    """Divide the worst coordinate's statistic of one window by the critical value."""
    a = abs(standard[0, m]) * precision[0, k]
    b = abs(standard[1, m]) * precision[1, k]
    c = abs(standard[2, m]) * precision[2, k]
    # All three are NaN together, and max() would not show it.
    if np.isnan(a):
        return np.nan
    return float(max(a, b, c) / critical)


@kernel
def _is_worst(
    failing: NDArray[np.int64],
    rank: NDArray[np.float64],
    before: NDArray[np.int64],
    after: NDArray[np.int64],
    reach: int,
) -> NDArray[np.bool_]:
    """Return which points fail worse than every other within reach; of equals the first does.

    The reach is a whole window: near an end of the segment, where windows are shifted, points may
    see each other from that far.
    """
    result = np.ones(len(failing), np.bool_)
    for m in range(len(failing)):
        k = failing[m]
        i, j = before[k], after[k]
        for _ in range(reach):
            # A comparison with NaN is false: points that pass exceed no other.
            if (i >= 0 and rank[i] >= rank[k]) or (j >= 0 and rank[j] > rank[k]):
                result[m] = False
                break
            i = before[i] if i >= 0 else i
            j = after[j] if j >= 0 else j
    return result


@kernel
def _unlink(
    worst: NDArray[np.int64],
    before: NDArray[np.int64],
    after: NDArray[np.int64],
    reach: int,
    rejected: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Take points out of their segments; return others within their reach, once each."""
    marked = rejected.copy()
    spoiled = np.empty(2 * reach * len(worst), np.int64)
    count = 0
    for k in worst:
        for link in (before, after):
            i = link[k]
            for _ in range(reach):
                if i < 0:
                    break
                if not marked[i]:
                    marked[i] = True
                    spoiled[count] = i
                    count += 1
                i = link[i]
    for k in worst:
        if before[k] >= 0:
            after[before[k]] = after[k]
        if after[k] >= 0:
            before[after[k]] = before[k]
    return spoiled[:count]
