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

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.alpha_beta_gamma.normal_equations import (
    CENTRED,
    RATE,
    WEIGHT,
    Series,
    T,
    X,
    empty_series,
    residuals,
)
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import Lines
from lidar_outlier_filter.parameters.filter import FilterParameters


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
    links = series.before, series.after
    everything = np.arange(len(points), dtype=np.int64)
    standard = residuals(series, everything, parameters)
    precision = _precision(standard, points, lines, parameters)
    critical = critical_value(parameters.significance)
    score, rank = _scores(standard, precision, everything, critical, parameters)
    rejected = np.zeros(len(points), np.bool_)
    failing = np.flatnonzero(score > 1)
    number = 1
    while len(failing) and number < parameters.passes:
        is_worst = np.empty(len(failing), np.bool_)
        _kernels.find_worst(failing, rank, *links, before + after, is_worst)
        worst = failing[is_worst]
        rejected[worst] = True
        spoiled = _kernels.unlink_points(worst, *links, before + after, rejected)
        standard = residuals(series, spoiled, parameters)
        score[spoiled], rank[spoiled] = _scores(standard, precision, spoiled, critical, parameters)
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


def _precision(
    standard: NDArray[np.float64], points: Points, lines: Lines, parameters: AlphaBetaGamma
) -> NDArray[np.float64]:
    """Return 1/σ, (3, N), by which the differences are yet to be multiplied."""
    if points.sigma is not None:
        return np.ones((3, len(points)))
    if parameters.sigma > 0:
        return np.full((3, len(points)), 1 / parameters.sigma)
    precision = np.empty((3, len(points)))
    floor = parameters.sigma_floor
    _kernels.estimate_precision(standard[CENTRED], lines.first, floor, precision)
    return precision


def _scores(
    standard: NDArray[np.float64],
    precision: NDArray[np.float64],
    which: NDArray[np.int64],
    critical: float,
    parameters: AlphaBetaGamma,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scores of points, and the rank of those that fail, which says which goes first."""
    score, rank = np.empty(len(which)), np.empty(len(which))
    either = parameters.sides == 'either'
    _kernels.score_windows(standard, precision, which, critical, either, score, rank)
    return score, rank
