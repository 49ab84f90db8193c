# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The tests of the quadric detector: of the points (31), and of the models against each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.quadric.fits import (
    HEIGHT,
    PARABOLOID,
    PLANE,
    SIZES,
    measure_residuals,
    normalize,
    step,
    weigh,
)
from lidar_outlier_filter.core.detectors.quadric.planes import QUADRIC, Window
from lidar_outlier_filter.core.kernels.kernels import noalias_kernel, select

MIN_POINTS = 12  # of a surface
CONCENTRATIONS = 2  # refits to the half, or the share, of points that agrees best
CURVED = 0.25  # residual over the radius at which a quadric bends; above (20) is no approximation
TIGHT = 1.5  # the same while it grows


class Rules(NamedTuple):
    """Rules of the judgement."""

    critical: Floats  # two-sided quantile of t by degrees of freedom; the last for all beyond
    ratio: Floats  # the same of F for three more parameters, by those of the larger model
    floor: float  # least standard deviation of a residual, metres
    surfaces: int  # at most
    # Nothing but a quadric is fitted, to all points, ambiguous or not, and every window is decided;
    # else a surface begins with the points nearest to a plane.
    always: bool


class FittedSurface(NamedTuple):
    """A surface that has grown; the test of all points under it is in the window."""

    size: int  # parameters of its model; 0: no surface
    support: int  # points in the fit
    deviation: float  # standard deviation of their distances, in the scale of the window


class Growth(NamedTuple):
    """What holds the growth of a surface, in the scale of the window."""

    floor: float  # least standard deviation of a residual
    noise: float  # standard deviation of the first surface, which holds another; inf: free
    freedom: int  # its degrees of freedom; 0: free


NONE = FittedSurface(0, 0, 0.0)


@noalias_kernel
def measure_tests(window: Window, n: int, size: int, rules: Rules, growth: Growth) -> bool:
    """Test all points: T (31) ÷ its critical value. False if there are too few to decide.

    A point outside the fit has the variance of a prediction, and its T is distributed as t(f), with
    the f degrees of freedom of the fit. A point in the fit has its own part in σ̂0; that is taken
    out, which leaves t(f - 1): the test does not depend on whether a point is in. The paper leaves
    it in: a lone outlier among thirty then passes. Here it stays in under ``model: always``, and if
    the first surface limits σ̂0.
    """
    squares, freedom = _squares(window, n, size, growth)
    if freedom < 2:  # noqa: PLR2004  one is left without the point itself
        return False
    apart = not rules.always and growth.freedom == 0
    last = len(rules.critical) - 1
    critical = rules.critical[min(freedom, last)]
    critical_kept = rules.critical[min(freedom - 1, last)] if apart else critical
    for i in range(n):
        kept, square = window.kept[i], window.residual[i] ** 2
        cofactor = window.sigma2[i] + (-window.lever[i] if kept else window.lever[i])
        without = max(squares * cofactor - square, 0.0) / (freedom - 1)
        variance = without if kept and apart else squares / freedom * cofactor
        least = growth.floor * window.slope[i]
        variance = max(variance, least * least)
        statistic = np.sqrt(square / variance) if square > 0 else 0.0
        window.test[i] = statistic / (critical_kept if kept else critical)
    return True


@noalias_kernel
def _squares(window: Window, n: int, size: int, growth: Growth) -> tuple[float, int]:
    """Return Σ v²/σ² of the kept points and its degrees of freedom: σ̂0² is their ratio.

    If the first surface limits this one, the ratio is 1 to ``TIGHT``² times the first's.
    """
    parts = window.scratch
    for i in range(n):
        parts[i] = window.residual[i] ** 2 / window.sigma2[i] if window.kept[i] else 0.0
    squares, count = 0.0, 0
    for i in range(n):
        squares += parts[i]
        count += window.kept[i]
    freedom = count - (size - 1)
    if growth.freedom > 0 and freedom > 0:
        unit = 0.0
        for i in range(n):
            unit += window.slope[i] ** 2 / window.sigma2[i] if window.kept[i] else 0.0
        least = freedom * growth.noise**2 * unit / count
        squares = min(max(squares, least), TIGHT**2 * least)
        squares *= (freedom + growth.freedom) / freedom
        freedom += growth.freedom
    return squares, freedom


@noalias_kernel
def describe(window: Window, n: int, size: int) -> FittedSurface:
    """Describe the surface that was fitted last, by the points kept."""
    squares, count = 0.0, 0
    for i in range(n):
        measured = window.kept[i] & (window.slope[i] > 0)
        squares += (window.residual[i] / window.slope[i]) ** 2 if measured else 0.0
        count += window.kept[i]
    return FittedSurface(size, count, np.sqrt(squares / max(count - (size - 1), 1)))


@noalias_kernel
def is_better(before: float, after: float, freedom: int, rules: Rules) -> bool:
    """Return whether three more parameters lessen a sum of squares significantly (F test)."""
    if freedom < 1:
        return False
    ratio = rules.ratio[min(freedom, len(rules.ratio) - 1)]
    return bool((before - after) / 3 > ratio * after / freedom)


@noalias_kernel
def is_bent(window: Window, n: int, rules: Rules) -> bool:
    """Return whether a paraboloid fits the kept points significantly better than the plane.

    Outliers that the plane could not distinguish from a bend would spoil it. So it is fitted to
    all kept points, then to the half that agrees best. If either is better, it begins with that
    half.
    """
    sigma2, scratch = window.sigma2, window.scratch
    weigh(window, n)
    count = 0
    for i in range(n):
        count += window.kept[i]
    half = (count + 1) // 2
    _rank_squares(window, n, half - 1)
    before_half = _sum(scratch, half)
    before, after = _step_from_plane(window, n)
    bent = is_better(before, after, count - (PARABOLOID - 1), rules)
    for _ in range(CONCENTRATIONS):
        reach = _rank_squares(window, n, half - 1)
        for i in range(n):
            near = window.residual[i] ** 2 / sigma2[i] <= reach
            window.weight[i] = 1 / sigma2[i] if window.kept[i] & near else 0.0
        if np.isnan(_step_from_plane(window, n)[0]):
            return False
    reach = _rank_squares(window, n, half - 1)
    after_half = _sum(scratch, half)
    bent = bent or is_better(before_half, after_half, half - (PARABOLOID - 1), rules)
    if bent:
        for i in range(n):
            near = window.residual[i] ** 2 / sigma2[i] <= reach
            window.kept[i] = window.kept[i] & near
    normalize(window, SIZES[1])
    return bent


@noalias_kernel
def _step_from_plane(window: Window, n: int) -> tuple[float, float]:
    """Fit heights over the plane by a paraboloid with the weights; measure all points.

    Returns the sums of squares of plane and paraboloid, NaN if it is ambiguous.
    """
    for k in range(QUADRIC):
        window.a[k] = 1.0 if k == HEIGHT else 0.0
    before, after = step(window, n, SIZES[1])
    measure_residuals(window, n, SIZES[1])
    return before, after


@noalias_kernel
def _rank_squares(window: Window, n: int, rank: int) -> float:
    """Return the residual² ÷ σ² of that rank among the kept; those up to it are in scratch."""
    count = 0
    for i in range(n):
        window.scratch[count] = window.residual[i] ** 2 / window.sigma2[i]
        count += window.kept[i]
    return select(window.scratch, count, rank)


@noalias_kernel
def _sum(values: Floats, count: int) -> float:
    total = 0.0
    for i in range(count):
        total += values[i]
    return total


@noalias_kernel
def is_flat(window: Window, n: int) -> bool:
    """Return whether (20) approximates a quadric at three of four kept points.

    There the residual is small against the radius at which the surface bends. If not, two sheets
    of the quadric run through the noise of one surface.
    """
    a = window.a
    bend = 0.0
    for k in range(PLANE, QUADRIC):
        bend += a[k] * a[k]
    bend = 2 * np.sqrt(bend)
    count, curved = 0, 0
    for i in range(n):
        if window.kept[i]:
            count += 1
            curved += abs(window.residual[i]) * bend > CURVED * window.slope[i] ** 2
    return 4 * curved <= count
