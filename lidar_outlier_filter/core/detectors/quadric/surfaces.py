# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a window of points says of each of them: the surfaces it holds, and the test (31).

A surface begins with the points nearest to a robust plane, and grows: it is fitted to the points
kept so far, all points are tested against it, those that pass are kept, until nothing changes. A
point that has left may come back. The model rises only where the lower one leaves a significant
rest: a plane, a paraboloid standing on it, a quadric. A plane is never judged as a quadric, then,
which would be ambiguous: z = 0 times any other plane goes through its points, and z² = 0 too.

What no surface explains is tested against all of them, and the least counts.
"""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.core.detectors.quadric.fits import (
    BEGIN,
    PLANE,
    QUADRIC,
    SIZES,
    Window,
    adjust,
    adjust_plane,
    fill_rows,
    fit_plane,
    is_plane,
    measure_gradient,
    measure_heights,
    measure_residuals,
    step,
    sum_normal,
    weigh,
)
from lidar_outlier_filter.core.detectors.quadric.statistics import (
    CONCENTRATIONS,
    MIN_POINTS,
    NONE,
    FittedSurface,
    Growth,
    Rules,
    describe,
    is_bent,
    is_better,
    is_flat,
    measure_tests,
)
from lidar_outlier_filter.core.kernels.eigen import eigen, find_least
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, select

RUN = 16  # points that follow each other in the window, and suggest a plane
SHARE = 0.3  # of the points that are to lie near a plane that begins a surface
BLUNT = 0.01  # of the least standard deviation: planes that near are equally good
PASSES = 30  # of fit and test; in the second half of them no point comes back
GAP = 4.0  # between the best quadric and the second best, mean squares; below they are ambiguous
THICK = 0.2  # standard deviation of the first surface over the radius of the window
LIKE = 2.0  # most that the standard deviation of another surface is that of the first
PART = 0.25  # of the points left that another surface must explain
MISSING = 3  # a window is undecided if more than a third of it is on no surface


@kernel
def judge(window: Window, n: int, rules: Rules) -> None:
    """Judge the first n points of a window; coordinates are metres, and lost.

    ``window.score`` is, for each point, T ÷ its critical value under the surface it agrees with
    best; NaN for all if the window is undecided: too few points, all in one place, or more than a
    third of them on no surface; of quadrics that are always fitted, all of them.
    """
    window.score[:n] = np.nan
    if n < MIN_POINTS:
        return
    scale = _centre(window, n)
    if not scale > 0:
        return
    window.score[:n] = np.inf
    window.left[:n] = True
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


@device_function
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
        xyz[:, :n] /= scale
    return float(scale)


# The beginning of a surface -----------------------------------------------------------------------


@device_function
def _begin(window: Window, n: int, left: int, floor: float, rules: Rules) -> bool:
    """Choose the points a surface begins with: kept. False if there is no plane to be found.

    Planes are suggested by all points left, and by runs of them without the worse half of each.
    The one that has a share of the points left nearest to it is fitted again to those.
    """
    if rules.always:
        window.kept[:n] = window.left[:n]
        return True
    rank = min(left, max(MIN_POINTS, int(np.ceil(SHARE * left)))) - 1
    first = BEGIN[0]
    window.weight[:n] = window.left[:n]
    fit_plane(window, first, n)
    best = _compare(window, n, rank, floor, np.inf)
    begin, end = first, _end_of_run(window, first, n)
    while end > 0:
        window.weight[begin:end] = window.left[begin:end]
        fit_plane(window, begin, end)
        _drop_worse_half(window, begin, end)
        fit_plane(window, begin, end)
        best = _compare(window, n, rank, floor, best)
        begin, end = end, _end_of_run(window, end, n)
    if not best < np.inf:
        return False
    window.plane[:] = window.best
    for _ in range(CONCENTRATIONS):
        reach = _near(window, n, rank)
        for i in range(n):
            near = window.left[i] and abs(window.residual[i]) <= reach
            window.weight[i] = 1.0 if near else 0.0
        fit_plane(window, first, n)
    window.kept[:n] = window.weight[:n] > 0
    return True


@device_function
def _end_of_run(window: Window, begin: int, n: int) -> int:
    """Return where a run of points left ends; -1 if there is not even half a run."""
    count, end = 0, begin
    while end < n and count < RUN:
        count += window.left[end]
        end += 1
    return end if 2 * count >= RUN else -1


@device_function
def _compare(window: Window, n: int, rank: int, floor: float, best: float) -> float:
    """Remember the plane if the point of that rank is nearer than the best; return the better."""
    if not is_plane(window, floor):
        return best
    near = max(_near(window, n, rank), BLUNT * floor)
    if near < best:
        window.best[:] = window.plane
        return near
    return best


@device_function
def _near(window: Window, n: int, rank: int) -> float:
    """Measure all points from the plane; return the distance of that rank among those left."""
    measure_heights(window, BEGIN[0], n)
    count = 0
    for i in range(n):
        if window.left[i]:
            window.scratch[count] = abs(window.residual[i])
            count += 1
    return select(window.scratch, count, rank)


@device_function
def _drop_worse_half(window: Window, begin: int, end: int) -> None:
    """Take the weight from the points of a run that are farther from the plane than its median."""
    measure_heights(window, begin, end)
    count = 0
    for i in range(begin, end):
        if window.weight[i] > 0:
            window.scratch[count] = abs(window.residual[i])
            count += 1
    reach = select(window.scratch, count, count // 2)
    for i in range(begin, end):
        if abs(window.residual[i]) > reach:
            window.weight[i] = 0.0


# Its growth ---------------------------------------------------------------------------------------


@device_function
def _grow(window: Window, n: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Grow a surface from the kept points, and raise its model as far as that pays."""
    if rules.always:
        window.weight[:n] = window.kept[:n]
        fit_plane(window, BEGIN[0], n)
        fill_rows(window, n)
        return _grow_quadric(window, n, rules, growth)
    plane = _settle(window, n, SIZES[0], rules, growth)
    if plane.size == 0 or plane.deviation <= growth.floor:
        return plane
    kept, test = window.kept[:n].copy(), window.test[:n].copy()
    fill_rows(window, n)
    if is_bent(window, n, rules):
        paraboloid = _settle(window, n, SIZES[1], rules, growth)
        if paraboloid.size > 0:
            return _rise(window, n, paraboloid, rules, growth)
    window.kept[:n], window.test[:n] = kept, test
    return plane


@device_function
def _rise(
    window: Window, n: int, paraboloid: FittedSurface, rules: Rules, growth: Growth
) -> FittedSurface:
    """Raise a paraboloid to a quadric if that pays and is not ambiguous."""
    if paraboloid.deviation <= growth.floor:
        return paraboloid
    kept, test = window.kept[:n].copy(), window.test[:n].copy()
    weigh(window, n)
    before, after = step(window, n, SIZES[2])
    if is_better(before, after, paraboloid.support - (QUADRIC - 1), rules):
        quadric = _grow_quadric(window, n, rules, growth)
        if quadric.size > 0:
            return quadric
    window.kept[:n], window.test[:n] = kept, test
    return paraboloid


@device_function
def _grow_quadric(window: Window, n: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Grow a quadric from the algebraic start, in the rows' frame; none if it is ambiguous.

    Where a quadric is always fitted, every one is taken.
    """
    if _start_algebraic(window, n) > GAP or rules.always:
        quadric = _settle(window, n, SIZES[2], rules, growth)
        if rules.always or (quadric.size > 0 and is_flat(window, n)):
            return quadric
    return NONE


@device_function
def _start_algebraic(window: Window, n: int) -> float:
    """Set a to the eigenvector of the least eigenvalue of Σ Bᵀ B over the kept points.

    Returns the gap: how many times as far, in the mean of the squares, the second best quadric is
    from the points. Distances are those of the first order, residual ÷ slope, because eigenvalues
    of (19) alone take any quadric for good that is flat everywhere.
    """
    window.weight[:n] = window.kept[:n]
    sum_normal(window, n, SIZES[2])
    square, vectors = window.square, window.vectors
    square[:] = window.normal
    eigen(square, vectors, QUADRIC)
    least = find_least(square, QUADRIC)
    second = 1 if least == 0 else 0
    for k in range(QUADRIC):
        if k != least and square[k, k] < square[second, second]:
            second = k
    window.a[:] = vectors[:QUADRIC, second]
    far = _mean_square_distance(window, n)
    window.a[:] = vectors[:QUADRIC, least]
    return far / _mean_square_distance(window, n)


@device_function
def _mean_square_distance(window: Window, n: int) -> float:
    """Return Σ residual² ÷ Σ slope² of the kept points under the quadric a."""
    measure_gradient(window, n)
    measure_residuals(window, n, SIZES[2])
    residuals = slopes = 0.0
    for i in range(n):
        if window.kept[i]:
            residuals += window.residual[i] ** 2
            slopes += window.slope[i] ** 2
    return residuals / slopes


@device_function
def _grow_another(window: Window, n: int, left: int, rules: Rules, growth: Growth) -> FittedSurface:
    """Grow one more surface: freely, or if it runs over what lies beside it, held tight.

    It is none if it explains too little, or is not as exact as the first: a volume, that is.
    """
    start = window.kept[:n].copy()
    for held in (Growth(growth.floor, np.inf, 0), growth):
        window.kept[:n] = start
        surface = _grow(window, n, rules, held)
        enough = surface.size > 0 and surface.support >= PART * left
        if enough and surface.deviation <= LIKE * growth.noise:
            return surface
    return NONE


@device_function
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
            welcome = window.left[i] and (kept[i] or 2 * number < PASSES)
            following[i] = welcome and window.test[i] <= 1
            count += following[i]
            changed = changed or following[i] != kept[i]
        if not changed:
            break
        if count < max(MIN_POINTS, size + 1):
            return NONE
        if number < PASSES - 1:
            kept[:n] = following[:n]
    return describe(window, n, size)
