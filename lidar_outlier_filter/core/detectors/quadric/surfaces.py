# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a window of points says of each of them: the surfaces it holds, and the test (31).

A surface begins with the points nearest to a robust plane, and grows: it is fitted to the points
kept so far, all points are tested against it, those that pass are kept, until nothing changes. A
point that has left may come back. The model rises only where the lower one leaves a significant
rest: a plane, a paraboloid standing on it, a quadric. A plane is never judged as a quadric, then,
which would be ambiguous: z = 0 times any other plane goes through its points, and z² = 0 too.

A point that no surface explains is tested against all; its lowest score counts.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.detectors.quadric.fits import (
    HEIGHT,
    PARABOLOID,
    PLANE,
    QUADRIC,
    SIZES,
    Window,
    adjust,
    adjust_plane,
    fill_rows,
    fit_plane,
    is_plane,
    measure_distances,
    measure_heights,
    measure_residuals,
    normalize,
    step,
    sum_normal,
    weigh,
)
from lidar_outlier_filter.core.kernels.eigen import eigen, find_least
from lidar_outlier_filter.core.kernels.kernels import kernel, noalias_kernel, select

RUN = 16  # points that follow each other in the window, and suggest a plane
SHARE = 0.3  # of the points that are to lie near a plane that begins a surface
BLUNT = 0.01  # of the least standard deviation: planes that near are equally good
PASSES = 30  # of fit and test; in the second half of them no point comes back
GAP = 4.0  # between the best quadric and the second best, mean squares; below they are ambiguous
THICK = 0.2  # standard deviation of the first surface over the radius of the window
LIKE = 2.0  # most that the standard deviation of another surface is that of the first
PART = 0.25  # of the points left that another surface must explain
MISSING = 3  # a window is undecided if more than a third of it is on no surface
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


@kernel
def judge(window: Window, n: int, rules: Rules) -> None:
    """Judge the first n points of a window; coordinates are metres, and lost.

    ``window.score`` is, for each point, T ÷ its critical value under the surface it agrees with
    best; NaN for all if the window is undecided: too few points, all in one place, or more than a
    third of them on no surface (under ``model: always``, all of them).
    """
    score, left_over = window.score, window.left
    score[:n] = np.nan
    if n < MIN_POINTS:
        return
    scale = _centre(window, n)
    if not scale > 0:
        return
    score[:n] = np.inf
    left_over[:n] = True
    floor = rules.floor / scale
    noise, freedom, left = np.inf, 0, n
    for number in range(rules.surfaces):
        if left < MIN_POINTS or not _begin(window, n, left, floor, rules):
            break
        if number > 0:
            surface = _grow_another(window, n, left, rules, Growth(floor, noise, freedom))
        else:
            surface = _grow(window, n, rules, Growth(floor, np.inf, 0))
            noise, freedom = max(surface.deviation, floor), surface.support - (surface.size - 1)
        if surface.size == 0 or (not rules.always and noise > max(THICK, floor)):
            break
        left = 0
        for i in range(n):
            window.score[i] = min(window.score[i], window.test[i])
            window.left[i] = window.score[i] > 1
            left += window.left[i]
    if left == n or (MISSING * left > n and not rules.always):
        window.score[:n] = np.nan


@noalias_kernel
def _centre(window: Window, n: int) -> float:
    """Centre the coordinates at their mean and divide them by their rms radius, which is returned.

    0 if all points coincide.
    """
    xyz = window.xyz
    squares = 0.0
    for axis in range(3):
        # From the first point: the mean of large coordinates would be rounded.
        first = xyz[axis, 0]
        total = 0.0
        for i in range(n):
            total += xyz[axis, i] - first
        mean = total / n
        for i in range(n):
            xyz[axis, i] = (xyz[axis, i] - first) - mean
            squares += xyz[axis, i] * xyz[axis, i]
    scale = np.sqrt(squares / n)
    if scale > 0:
        for axis in range(3):
            for i in range(n):
                xyz[axis, i] /= scale
    return float(scale)


# The beginning of a surface -----------------------------------------------------------------------


@noalias_kernel
def _begin(window: Window, n: int, left: int, floor: float, rules: Rules) -> bool:
    """Choose the points a surface begins with: kept. False if there is no plane to be found.

    Planes are suggested by all points left, and by runs of them without the worse half of each.
    The one that has a share of the points left nearest to it is fitted again to those.
    """
    some, which, weight = window.some, window.which, window.weight
    m = 0
    for i in range(n):
        which[m] = i
        for axis in range(3):
            some[axis, m] = window.xyz[axis, i]
        weight[i] = 1.0
        window.kept[i] = window.left[i]
        m += window.left[i]
    if rules.always:
        return True
    rank = min(left, max(MIN_POINTS, int(np.ceil(SHARE * left)))) - 1
    fit_plane(window, some, 0, left)
    best = _compare(window, left, rank, floor, np.inf)
    for run in range(0, left - RUN // 2 + 1, RUN):
        end = min(run + RUN, left)
        fit_plane(window, some, run, end)
        _drop_worse_half(window, run, end)
        fit_plane(window, some, run, end)
        best = _compare(window, left, rank, floor, best)
    if not best < np.inf:
        return False
    _copy(window.best, len(window.best), window.plane)
    for _ in range(CONCENTRATIONS):
        reach = _near(window, left, rank)
        for i in range(left):
            weight[i] = 1.0 if abs(window.residual[i]) <= reach else 0.0
        fit_plane(window, some, 0, left)
    for i in range(n):
        window.kept[i] = False
    for i in range(left):
        window.kept[which[i]] = weight[i] > 0
    return True


@noalias_kernel
def _compare(window: Window, left: int, rank: int, floor: float, best: float) -> float:
    """Remember the plane if the point of that rank is nearer than the best; return the better."""
    if not is_plane(window, floor):
        return best
    measure_heights(window.plane, window.some, 0, left, window.residual)
    nearer = 0
    for i in range(left):
        nearer += abs(window.residual[i]) < best
    if nearer <= rank:
        return best
    near = max(_near(window, left, rank), BLUNT * floor)
    if near < best:
        _copy(window.plane, len(window.plane), window.best)
        return near
    return best


@noalias_kernel
def _near(window: Window, left: int, rank: int) -> float:
    """Measure the points left from the plane; return the distance of that rank."""
    measure_heights(window.plane, window.some, 0, left, window.residual)
    for i in range(left):
        window.scratch[i] = abs(window.residual[i])
    return select(window.scratch, left, rank)


@noalias_kernel
def _drop_worse_half(window: Window, begin: int, end: int) -> None:
    """Take the weight from the points of a run that are farther from the plane than its median."""
    measure_heights(window.plane, window.some, begin, end, window.residual)
    for i in range(begin, end):
        window.scratch[i] = abs(window.residual[i])
    for i in range(begin, end):
        nearer = 0
        for j in range(begin, end):
            nearer += window.scratch[j] < window.scratch[i]
        window.weight[i] = 1.0 if nearer <= (end - begin) // 2 else 0.0


@noalias_kernel
def _copy(values: Floats | Bools, count: int, target: Floats | Bools) -> None:
    for i in range(count):
        target[i] = values[i]


# Its growth ---------------------------------------------------------------------------------------


@noalias_kernel
def _grow(window: Window, n: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Grow a surface from the kept points, and raise its model as far as that pays."""
    if rules.always:
        _copy(window.kept, n, window.weight)
        fit_plane(window, window.xyz, 0, n)
        fill_rows(window, n)
        return _grow_quadric(window, n, rules, growth)
    plane = _settle(window, n, SIZES[0], rules, growth)
    if plane.size == 0 or plane.deviation <= growth.floor:
        return plane
    _save(window, n, 0)
    fill_rows(window, n)
    if is_bent(window, n, rules):
        paraboloid = _settle(window, n, SIZES[1], rules, growth)
        if paraboloid.size > 0:
            return _rise(window, n, paraboloid, rules, growth)
    _restore(window, n, 0)
    return plane


@noalias_kernel
def _save(window: Window, n: int, model: int) -> None:
    """Save the kept points and the test of a model."""
    for i in range(n):
        window.saved_kept[model, i], window.saved_test[model, i] = window.kept[i], window.test[i]


@noalias_kernel
def _restore(window: Window, n: int, model: int) -> None:
    """Return to a model that was saved."""
    for i in range(n):
        window.kept[i], window.test[i] = window.saved_kept[model, i], window.saved_test[model, i]


@noalias_kernel
def _rise(
    window: Window, n: int, paraboloid: FittedSurface, rules: Rules, growth: Growth
) -> FittedSurface:
    """Raise a paraboloid to a quadric if that pays and is not ambiguous."""
    if paraboloid.deviation <= growth.floor:
        return paraboloid
    _save(window, n, 1)
    weigh(window, n)
    before, after = step(window, n, SIZES[2])
    if is_better(before, after, paraboloid.support - (QUADRIC - 1), rules):
        quadric = _grow_quadric(window, n, rules, growth)
        if quadric.size > 0:
            return quadric
    _restore(window, n, 1)
    return paraboloid


@noalias_kernel
def _grow_quadric(window: Window, n: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Grow a quadric from the algebraic start, in the rows' frame; none if it is ambiguous.

    Where a quadric is always fitted, every one is taken.
    """
    if _start_algebraic(window, n) > GAP or rules.always:
        quadric = _settle(window, n, SIZES[2], rules, growth)
        if rules.always or (quadric.size > 0 and is_flat(window, n)):
            return quadric
    return NONE


@noalias_kernel
def _start_algebraic(window: Window, n: int) -> float:
    """Set a to the eigenvector of the least eigenvalue of Σ Bᵀ B over the kept points.

    Returns the gap: how many times as far, in the mean of the squares, the second best quadric is
    from the points. Distances are those of the first order, residual ÷ slope, because eigenvalues
    of (19) alone take any quadric for good that is flat everywhere.
    """
    _copy(window.kept, n, window.weight)
    sum_normal(window, n, SIZES[2])
    square, vectors, a = window.square, window.vectors, window.a
    for i in range(QUADRIC):
        _copy(window.normal[i], QUADRIC, square[i])
    eigen(square, vectors, QUADRIC)
    least = find_least(square, QUADRIC)
    second = 1 if least == 0 else 0
    for k in range(QUADRIC):
        if k != least and square[k, k] < square[second, second]:
            second = k
    _copy(vectors[:, second], QUADRIC, a)
    far = _mean_square_distance(window, n)
    _copy(vectors[:, least], QUADRIC, a)
    return far / _mean_square_distance(window, n)


@noalias_kernel
def _mean_square_distance(window: Window, n: int) -> float:
    """Return Σ residual² ÷ Σ slope² of the kept points under the quadric a."""
    measure_distances(window, n, SIZES[2])
    residuals = slopes = 0.0
    for i in range(n):
        if window.kept[i]:
            residuals += window.residual[i] ** 2
            slopes += window.slope[i] ** 2
    return residuals / slopes


@noalias_kernel
def _grow_another(window: Window, n: int, left: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Grow one more surface: freely, or if it runs over what lies beside it, held tight.

    It is rejected if it explains too few points, or is less exact than the first: a volume.
    """
    _copy(window.kept, n, window.start)
    for held in (Growth(growth.floor, np.inf, 0), growth):
        _copy(window.start, n, window.kept)
        surface = _grow(window, n, rules, held)
        enough = surface.size > 0 and surface.support >= PART * left
        if enough and surface.deviation <= LIKE * growth.noise:
            return surface
    return NONE


@noalias_kernel
def _settle(window: Window, n: int, size: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Fit and test until no point leaves or comes back; none if the model cannot be had."""
    kept, following = window.kept, window.next
    for number in range(PASSES):
        fitted = adjust_plane(window, n, growth.floor) if size == PLANE else adjust(window, n, size)
        if not fitted or not measure_tests(window, n, size, rules, growth):
            return NONE
        count, changed = 0, False
        for i in range(n):
            # Two points may drive each other out in turn, without end.
            welcome = window.left[i] & (kept[i] | (2 * number < PASSES))
            following[i] = welcome & (window.test[i] <= 1)
            count += following[i]
            changed |= following[i] != kept[i]
        if not changed:
            break
        if count < max(MIN_POINTS, size + 1):
            return NONE
        if number < PASSES - 1:
            _copy(following, n, kept)
    return describe(window, n, size)


# The tests of points (31), and of models against each other ---------------------------------------


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
