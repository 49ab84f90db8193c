# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The detectors as textbook loops: the slow twin that the fast ones are compared with.

Nothing of the package is imported here, so that no mistake can be shared. Equation numbers are
those of Leslar, Wang and Hu, "A comparison of two new methods of outlier detection for mobile
terrestrial lidar data" (2010), section 2.1. Times are int64 nanoseconds unless a name says seconds.
"""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from math import isnan, nan, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SINGULAR = 1e-10
MAD_TO_SIGMA = 1.4826
MIN_RESIDUALS = 10


# Lines and segments ---------------------------------------------------------------------------


def scan_order(t_ns: Sequence[int], line: Sequence[int]) -> list[int]:
    """Sort indices of the points by line, then time; ties stay in their order of arrival."""
    return sorted(range(len(t_ns)), key=lambda i: (line[i], t_ns[i], i))


def shot_interval(t_ns: Sequence[int]) -> float | None:
    """Median of the positive time differences of one sorted line (ns); None without any."""
    positive = [int(b) - int(a) for a, b in pairwise(t_ns) if b > a]
    return float(np.median(positive)) if positive else None


def segments(t_ns: Sequence[int], line: Sequence[int], gap_factor: float) -> list[int]:
    """Ascending number of the segment of each point; points sorted by line, then time.

    A segment ends with its line, and where the time difference is strictly greater than
    ``gap_factor`` × the line's shot interval.
    """
    interval = {
        one: shot_interval([t for t, i in zip(t_ns, line, strict=True) if i == one])
        for one in set(line)
    }
    result = [0] if len(t_ns) else []
    for i in range(1, len(t_ns)):
        usual = interval[line[i]]
        new_line = line[i] != line[i - 1]
        gap = usual is not None and int(t_ns[i]) - int(t_ns[i - 1]) > gap_factor * usual
        result.append(result[-1] + int(new_line or gap))
    return result


def angle_lines(angle: Sequence[float]) -> list[int]:
    """Give each shot the number of its line, from 0, by its angle (radians, in [-π, 2π]).

    A line begins where the angle wraps (steps by more than π), or steps against the sense of
    rotation by more than a twelfth of a turn. A smaller step back is noise: until the angle is
    further than it ever was in this line, nothing begins. The sense is the sign of the sum of the
    steps of a twelfth or less, limited to ±π. Within a twelfth of 0 it is unknown, and only wraps
    count.
    """
    result: list[int] = []
    line, travel, furthest = 0, 0.0, nan
    for i, now in enumerate(angle):
        if i == 0:
            furthest = now
            result.append(line)
            continue
        step = _shorter_way(angle[i - 1], now)
        forwards = travel >= pi / 6
        backwards = travel <= -pi / 6
        jump = (forwards and step < -pi / 6) or (backwards and step > pi / 6)
        lag = -_shorter_way(furthest, now) if forwards else _shorter_way(furthest, now)
        noise = (forwards or backwards) and 0 <= lag <= pi / 6
        if jump or (not noise and abs(now - furthest) > pi):
            line += 1
        if jump or not noise:
            furthest = now
        if -pi / 6 <= step <= pi / 6:
            travel = sorted([-pi, travel + step, pi])[1]
        result.append(line)
    return result


def _shorter_way(a: float, b: float) -> float:
    """Step from one angle to another that is at most half a turn away; half keeps its sign."""
    return min([b - a, b - a - 2 * pi, b - a + 2 * pi], key=abs)


# Windows: positions in a segment of m points, without p itself ---------------------------------


def centred_window(p: int, m: int, before: int, after: int) -> list[int]:
    """From p - before to p + after, shifted inwards at the ends, cut down to a short segment."""
    first, last = p - before, p + after
    if first < 0:
        first, last = 0, last - first
    if last > m - 1:
        first, last = max(0, first - (last - (m - 1))), m - 1
    return [j for j in range(first, last + 1) if j != p]


def before_window(p: int, before: int) -> list[int]:
    """Up to ``before`` positions in front of p."""
    return [j for j in range(p - before, p) if j >= 0]


def after_window(p: int, m: int, after: int) -> list[int]:
    """Up to ``after`` positions behind p."""
    return [j for j in range(p + 1, p + after + 1) if j < m]


# The smoother of one window --------------------------------------------------------------------


def normal_matrix(delta: Sequence[float], variance: Sequence[float], order: int) -> Floats:
    """Sum δ^(r+c) / σ²: the matrix that (14) inverts."""
    sums = [0.0] * (2 * order + 1)
    for d, v in zip(delta, variance, strict=True):
        for power in range(2 * order + 1):
            sums[power] += d**power / v
    size = order + 1
    return np.array([[sums[r + c] for c in range(size)] for r in range(size)])


def smoother_weights(delta: Sequence[float], variance: Sequence[float], order: int) -> list[float]:
    """Weights a_i of the measurements in the position, (11) to (14).

    ``delta`` are the times relative to the point in question, in seconds.
    """
    inverse = np.linalg.inv(normal_matrix(delta, variance, order)).tolist()
    return [
        sum(inverse[j][0] * d**j for j in range(order + 1)) / v
        for d, v in zip(delta, variance, strict=True)
    ]


def is_singular(delta: Sequence[float], variance: Sequence[float], order: int) -> bool:
    """Return whether a window without the tested point cannot predict it (times in any unit)."""
    half_width = max((abs(d) for d in delta), default=0.0)
    if half_width == 0.0:
        return True
    matrix = normal_matrix([d / half_width for d in delta], variance, order)
    return bool(np.linalg.det(matrix) <= SINGULAR * np.prod(np.diag(matrix)))


def predict(
    delta: Sequence[float], z: Floats, variance: Sequence[float], own_variance: float, order: int
) -> tuple[Floats, float]:
    """Predict z at δ = 0 from the other points: (15), and the second term of (16).

    As in the paper the window with the tested point, i = 0, gives the weights; a_0 is then taken
    out of them. Its measurement is not asked for: (15) leaves it out.
    """
    weights = smoother_weights([0.0, *delta], [own_variance, *variance], order)
    rest = 1.0 - weights[0]
    position = np.zeros(3)
    spread = 0.0
    for i in range(len(delta)):
        position += weights[i + 1] * z[i]
        spread += weights[i + 1] ** 2 * variance[i]
    return position / rest, spread / rest**2


# The test of one point --------------------------------------------------------------------------


class Line(NamedTuple):
    """Points by line, then time: times, positions (m), variances, and the σ still to divide by."""

    t_ns: Ints
    xyz: Floats
    variance: Floats
    unit: Floats


class Rule(NamedTuple):
    """The detector's parameters that concern one window or one point."""

    before: int
    after: int
    order: int
    significance: float
    sides: str
    min_window: int


def window_residual(
    points: Line, k: int, window: Sequence[int], rule: Rule
) -> tuple[Floats, float] | None:
    """Give the difference z - z_p (3,) and q of point k from a window; None where it is unusable.

    The weights of (15) add up to 1, so coordinates relative to the tested point give the same
    difference, with all of its digits.
    """
    delta = [(int(points.t_ns[j]) - int(points.t_ns[k])) * 1e-9 for j in window]
    others = [float(points.variance[j]) for j in window]
    if len(window) < rule.min_window or is_singular(delta, others, rule.order):
        return None
    relative = np.array([points.xyz[j] - points.xyz[k] for j in window])
    position, q = predict(delta, relative, others, float(points.variance[k]), rule.order)
    return -position, q


@cache
def critical_value(significance: float) -> float:
    """Two-sided: ``isf(a)`` is ``ppf(1 - a)`` without the loss of a small a's digits."""
    return float(norm.isf(significance / 2))


def window_score(residual: Floats, spread: Floats, significance: float) -> float:
    """Statistic (17) of the worst coordinate over its critical value; ``spread`` (3,) is σ_δz."""
    standardized = [abs(r) / s for r, s in zip(residual, spread, strict=True)]
    return float(max(standardized) / critical_value(significance))


def robust_sigma(residuals: Sequence[Floats], qs: Sequence[float], floor: float) -> Floats:
    """σ of x, y, z from the residuals of one line; NaN where there are fewer than 10 of them."""
    if len(residuals) < MIN_RESIDUALS:
        return np.full(3, nan)
    sigma = []
    for c in range(3):
        reduced = [abs(r[c]) / sqrt(1 + q) for r, q in zip(residuals, qs, strict=True)]
        sigma.append(max(floor, MAD_TO_SIGMA * float(np.median(reduced))))
    return np.array(sigma)


# The detector -----------------------------------------------------------------------------------


def point_score(points: Line, p: int, segment: Sequence[int], rule: Rule) -> tuple[float, float]:
    """Score the point at position p of a segment (NaN where it cannot be tested), and rank it.

    The score says whether a point is an outlier, the rank which of several goes first: the score of
    the window around it, in which no good point stands out more than a single outlier does.
    One-sided windows extrapolate, and have no such guarantee.
    """
    k, m = segment[p], len(segment)

    def of(window: Sequence[int]) -> float:
        result = window_residual(points, k, [segment[j] for j in window], rule)
        if result is None or isnan(points.unit[k, 0]):
            return nan
        spread = points.unit[k] * sqrt(points.variance[k] + result[1])
        return window_score(result[0], spread, rule.significance)

    around = of(centred_window(p, m, rule.before, rule.after))
    if rule.sides == 'either':
        one_sided = [of(before_window(p, rule.before)), of(after_window(p, m, rule.after))]
        # The window around the point stands in for a side that is too short.
        return min(around if isnan(s) else s for s in one_sided), around
    return around, around


def is_peak(p: int, scores: Sequence[float], reach: int) -> bool:
    """Return whether no rank within reach of p is larger, or equal and earlier; NaN: no rival."""
    for j in range(max(0, p - reach), min(len(scores), p + reach + 1)):
        if scores[j] > scores[p] or (j < p and scores[j] == scores[p]):
            return False
    return True


def all_residuals(
    points: Line, members: Sequence[Sequence[int]], rule: Rule
) -> dict[int, tuple[Floats, float]]:
    """Residuals of all points from the windows around them, of those that have one."""
    found = {}
    for segment in members:
        for p, k in enumerate(segment):
            window = centred_window(p, len(segment), rule.before, rule.after)
            result = window_residual(points, k, [segment[j] for j in window], rule)
            if result is not None:
                found[k] = result
    return found


def estimated_unit(found: dict[int, tuple[Floats, float]], line: Ints, floor: float) -> Floats:
    """Estimate σ (N, 3) of each line from the residuals of its points."""
    unit = np.full((len(line), 3), nan)
    for one in sorted(set(line.tolist())):
        of_line = [k for k in range(len(line)) if line[k] == one]
        usable = [found[k] for k in of_line if k in found]
        unit[of_line] = robust_sigma([r for r, _ in usable], [q for _, q in usable], floor)
    return unit


def alpha_beta_gamma(  # noqa: PLR0913  all there is to choose
    t_ns: Ints,
    xyz: Floats,
    segment: Ints,
    line: Ints,
    *,
    before: int,
    after: int,
    order: int,
    significance: float,
    sides: str,
    sigma: float,
    sigma_floor: float,
    min_window: int,
    passes: int,
    own_sigma: Floats | None = None,
) -> tuple[Floats, NDArray[np.bool_], int]:
    """Scores (N,) (NaN: untested), rejected (N,) and the number of passes, the last one included.

    Points are sorted by line, then time. ``own_sigma`` (N,), where given, takes precedence over
    ``sigma``, and ``sigma`` > 0 over the estimate from the line.
    """
    count = len(t_ns)
    rule = Rule(before, after, order, significance, sides, min_window)
    members = [[i for i in range(count) if segment[i] == s] for s in sorted(set(segment.tolist()))]
    points = Line(t_ns, np.asarray(xyz, np.float64), np.ones(count), np.ones((count, 3)))
    if own_sigma is not None:
        points = points._replace(variance=np.asarray(own_sigma, np.float64) ** 2)
    elif sigma > 0:
        points = points._replace(unit=np.full((count, 3), sigma))
    else:
        unit = estimated_unit(all_residuals(points, members, rule), line, sigma_floor)
        points = points._replace(unit=unit)

    scores = np.full(count, nan)
    rejected = np.zeros(count, dtype=np.bool_)
    for number in range(1, passes + 1):
        outliers: list[int] = []
        for one in members:
            survivors = [i for i in one if not rejected[i]]
            now = [point_score(points, p, survivors, rule) for p in range(len(survivors))]
            ranks = [rank if value > 1 else nan for value, rank in now]
            for p, (value, _) in enumerate(now):
                scores[survivors[p]] = value
                if value > 1 and (number == passes or is_peak(p, ranks, before + after)):
                    outliers.append(survivors[p])
        rejected[outliers] = True
        if not outliers:
            return scores, rejected, number
    return scores, rejected, passes
