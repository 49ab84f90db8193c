# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Windows of points, and fits to them: plane, paraboloid and quadric, (18)-(30) of the paper.

The three are one model with 4, 7 or 10 of the parameters of (18), nested: the columns of B (23) are
1, x, y, z, then x², xy, y², then xz, yz, z², where z is the normal of a plane through the points
(a paraboloid stands on it). Products of two coordinates are multiplied by √2, so that the norm (19)
is the same whichever way the axes point; a4, a5 and a6 of (18) are √2 times the ones here.

The normal of a plane is the axis of the least moment, which is the exact solution of (29).
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.kernels.eigen import eigen, find_least
from lidar_outlier_filter.core.kernels.kernels import noalias_kernel
from lidar_outlier_filter.core.kernels.vectors import ROW, add_row

NORMAL, MIDDLE, LONG, MEAN, MOMENTS, WEIGHT = 0, 3, 6, 9, 12, 15  # parts of Window.plane
PLANE, PARABOLOID, QUADRIC = 4, 7, 10  # parameters, one of which the norm takes away
# Numba takes elements of a tuple of constants as constants, and compiles what they are given to for
# each of them. That is a fifth of the time to compile, and saves a tenth of the time to run.
SIZES = (PLANE, PARABOLOID, QUADRIC)
ROOT2 = 2**0.5
MIN_VARIANCE = 0.01  # of the mean of all: near an edge the gradient vanishes
HEIGHT = 3  # the column of z
SINGULAR = 1e-12  # a pivot below this part of the matrix: the parameters are ambiguous
ADJUSTMENTS = 10
CONVERGED = 1e-6  # largest change of a parameter


class Window(NamedTuple):
    """A window of up to M points, and room to work on it; only its first n points count."""

    xyz: Floats  # (3, M)
    variance: Floats  # (M,) of any coordinate of each point; only their ratios count
    rows: Floats  # (M, 12) B (23) in the frame of the plane, and two zeros
    saved_test: Floats  # (2, M) test of the plane, and of the paraboloid
    saved_kept: Bools  # (2, M) kept of the plane, and of the paraboloid
    which: Ints  # (M,) some of the points
    local: Floats  # (3, M) coordinates in the frame of the plane
    some: Floats  # (3, M) the points on no surface so far
    residual: Floats  # (M,) v (29)
    sigma2: Floats  # (M,) σ² (30)
    slope: Floats  # (M,) the length of the gradient (25)-(27)
    lever: Floats  # (M,) B Q Bᵀ
    weight: Floats  # (M,) in the next fit
    test: Floats  # (M,) T ÷ its critical value under the last surface
    score: Floats  # (M,) the least of all surfaces
    scratch: Floats  # (M,)
    left: Bools  # (M,) on no surface so far
    kept: Bools  # (M,) in the fit
    next: Bools  # (M,) in the next one
    start: Bools  # (M,) in the first fit of a surface
    a: Floats  # (10,) parameters
    step: Floats  # (10,) what (29) is to change of them
    plane: Floats  # (16,) normal, axes of the middle and the largest moment, mean, moments, weight
    best: Floats  # (16,) the best one to begin with
    normal: Floats  # (12, 12) Bᵀ P B
    cofactor: Floats  # (12, 12) Q of the parameters
    square: Floats  # (12, 12)
    vectors: Floats  # (12, 12)


def empty_window(room: int) -> Window:
    """Allocate for windows of up to ``room`` points."""
    return Window(
        np.zeros((3, room)),
        np.ones(room),
        np.zeros((room, ROW)),
        np.zeros((2, room)),
        np.zeros((2, room), np.bool_),
        np.zeros(room, np.int64),
        *np.zeros((2, 3, room)),
        *np.zeros((8, room)),
        *np.zeros((4, room), np.bool_),
        *np.zeros((2, QUADRIC)),
        *np.zeros((2, 16)),
        *np.zeros((4, ROW, ROW)),
    )


@noalias_kernel
def fit_plane(window: Window, xyz: Floats, begin: int, end: int) -> None:
    """Fit the plane through points begin to end by their weights, at least one of them not 0."""
    weight, square, vectors, plane = window.weight, window.square, window.vectors, window.plane
    total = x = y = z = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(begin, end):
        p = weight[i]
        a, b, c = xyz[0, i], xyz[1, i], xyz[2, i]
        total += p
        x += p * a
        y += p * b
        z += p * c
        xx += p * a * a
        xy += p * a * b
        xz += p * a * c
        yy += p * b * b
        yz += p * b * c
        zz += p * c * c
    x, y, z = x / total, y / total, z / total
    plane[MEAN], plane[MEAN + 1], plane[MEAN + 2], plane[WEIGHT] = x, y, z, total
    square[0, 0], square[1, 1] = xx - total * x * x, yy - total * y * y
    square[2, 2], square[0, 1] = zz - total * z * z, xy - total * x * y
    square[0, 2], square[1, 2] = xz - total * x * z, yz - total * y * z
    square[1, 0], square[2, 0], square[2, 1] = square[0, 1], square[0, 2], square[1, 2]
    eigen(square, vectors, 3)
    least = find_least(square, 3)
    middle, largest = (least + 1) % 3, (least + 2) % 3
    if square[middle, middle] > square[largest, largest]:
        middle, largest = largest, middle
    for place, k in enumerate((least, middle, largest)):
        plane[MOMENTS + place] = max(square[k, k], 0.0)
        for axis in range(3):
            plane[3 * place + axis] = vectors[axis, k]


@noalias_kernel
def is_plane(window: Window, floor: float) -> bool:
    """Return a plane from a line: it is wider than the least standard deviation."""
    return bool(window.plane[MOMENTS + 1] > floor * floor * window.plane[WEIGHT])


@noalias_kernel
def adjust_plane(window: Window, n: int, floor: float) -> bool:
    """Fit the plane to the kept points; measure all points. False if they lie on a line."""
    for i in range(n):
        window.weight[i] = 1 / window.variance[i] if window.kept[i] else 0.0
    fit_plane(window, window.xyz, 0, n)
    if not is_plane(window, floor):
        return False
    measure_plane(window, n)
    return True


@noalias_kernel
def measure_heights(plane: Floats, xyz: Floats, begin: int, end: int, heights: Floats) -> None:
    """Measure the residuals (29) of points begin to end from a plane: heights over it."""
    x, y, z = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
    zero = x * plane[MEAN] + y * plane[MEAN + 1] + z * plane[MEAN + 2]
    for i in range(begin, end):
        heights[i] = x * xyz[0, i] + y * xyz[1, i] + z * xyz[2, i] - zero


@noalias_kernel
def measure_plane(window: Window, n: int) -> None:
    """Measure all points against the plane: residual, variance, slope and lever.

    Height and tilts of the plane are uncorrelated in its own axes: Q is diagonal.
    """
    measure_heights(window.plane, window.xyz, 0, n, window.residual)
    xyz, plane = window.xyz, window.plane
    level = 1 / plane[WEIGHT]
    squared = plane[NORMAL] ** 2 + plane[NORMAL + 1] ** 2 + plane[NORMAL + 2] ** 2  # 1, rounded
    tilt_middle, tilt_long = 1 / plane[MOMENTS + 1], 1 / plane[MOMENTS + 2]
    for i in range(n):
        x, y, z = xyz[0, i] - plane[MEAN], xyz[1, i] - plane[MEAN + 1], xyz[2, i] - plane[MEAN + 2]
        u = plane[MIDDLE] * x + plane[MIDDLE + 1] * y + plane[MIDDLE + 2] * z
        v = plane[LONG] * x + plane[LONG + 1] * y + plane[LONG + 2] * z
        window.lever[i] = level + u * u * tilt_middle + v * v * tilt_long
        window.sigma2[i] = window.variance[i] * squared
        window.slope[i] = 1.0


# Paraboloids and quadrics -------------------------------------------------------------------------


@noalias_kernel
def sum_normal(window: Window, n: int, size: int) -> None:
    """Sum the normal matrix Bᵀ P B: part = P B; normal[j] += part[j] B, for each of the points."""
    rows, weight, normal, which = window.rows, window.weight, window.normal, window.which
    for j in range(size):
        for k in range(ROW):
            normal[j, k] = 0.0
    count = 0
    for i in range(n):
        which[count] = i
        count += weight[i] != 0
    for m in range(count):
        p = np.uint64(which[m])
        for j in range(size):
            # Of the upper triangle only what comes with the lower one.
            add_row(normal, j, weight[p] * rows[p, j], rows, p, j + 1)
    for j in range(size):
        for k in range(j):
            normal[k, j] = normal[j, k]


@noalias_kernel
def _invert_bordered(window: Window, size: int) -> bool:
    """Find Q: the inverse of the normal matrix bordered by a, without the border.

    That is the cofactor matrix of the parameters under aᵀ δa = 0. False if the parameters are
    ambiguous: the points lie on more than one such surface.
    """
    square, inverse = window.square, window.vectors
    largest = 0.0
    for i in range(size):
        largest = max(largest, window.normal[i, i])
    for i in range(size + 1):
        for j in range(ROW):
            square[i, j] = window.normal[i, j] if i < size and j < size else 0.0
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(size):
        # The border is as large as the rest: the choice of pivots shall not depend on weights.
        square[i, size] = square[size, i] = window.a[i] * largest
    if not _eliminate(square, inverse, size, SINGULAR * largest):
        return False
    for i in range(size):
        for j in range(size):
            window.cofactor[i, j] = (inverse[i, j] + inverse[j, i]) / 2
    return True


@noalias_kernel
def _eliminate(square: Floats, inverse: Floats, size: int, least: float) -> bool:
    """Turn the unit matrix ``inverse`` into that of ``square``, which has one row more than size.

    By Gauss and Jordan; False if a pivot is not larger than the least.
    """
    bordered = size + 1
    for i in range(bordered):
        pivot, most = i, abs(square[i, i])
        for j in range(i + 1, bordered):
            if abs(square[j, i]) > most:
                pivot, most = j, abs(square[j, i])
        if not most > least:
            return False
        if pivot != i:
            for k in range(ROW):
                square[i, k], square[pivot, k] = square[pivot, k], square[i, k]
                inverse[i, k], inverse[pivot, k] = inverse[pivot, k], inverse[i, k]
        factor = 1 / square[i, i]
        for k in range(ROW):
            square[i, k] *= factor
            inverse[i, k] *= factor
        for j in range(bordered):
            if j != i:
                factor = -square[j, i]
                add_row(square, j, factor, square, i, bordered)
                add_row(inverse, j, factor, inverse, i, bordered)
    return True


@noalias_kernel
def step(window: Window, n: int, size: int) -> tuple[float, float]:
    """Solve (29) once, by the weights: δa = -Q Bᵀ P w is added to a.

    Returns
    -------
    before, after : float
        The sums of the squares of the residuals over σ²; NaN if the parameters are ambiguous.

    """
    sum_normal(window, n, size)
    if not _invert_bordered(window, size):
        return np.nan, np.nan
    normal, cofactor, a, change = window.normal, window.cofactor, window.a, window.step
    gradient = window.vectors[0]
    before = 0.0
    for i in range(size):
        gradient[i] = 0.0
        for j in range(size):
            gradient[i] += normal[i, j] * a[j]
        before += gradient[i] * a[i]
    after = before
    for i in range(size):
        change[i] = 0.0
        for j in range(size):
            change[i] -= cofactor[i, j] * gradient[j]
        after += gradient[i] * change[i]
    for i in range(size):
        a[i] += change[i]
    return before, max(after, 0.0)


@noalias_kernel
def normalize(window: Window, size: int) -> None:
    """Give the parameters the norm 1 (19)."""
    squared = 0.0
    for i in range(size):
        squared += window.a[i] * window.a[i]
    length = np.sqrt(squared)
    for i in range(size):
        window.a[i] /= length


@noalias_kernel
def fill_rows(window: Window, n: int) -> None:
    """Fill the coordinates of all points in the frame of the plane, and B (23)."""
    xyz, plane, local, rows, root = window.xyz, window.plane, window.local, window.rows, ROOT2
    for i in range(n):
        a, b, c = xyz[0, i] - plane[MEAN], xyz[1, i] - plane[MEAN + 1], xyz[2, i] - plane[MEAN + 2]
        local[0, i] = plane[LONG] * a + plane[LONG + 1] * b + plane[LONG + 2] * c
        local[1, i] = plane[MIDDLE] * a + plane[MIDDLE + 1] * b + plane[MIDDLE + 2] * c
        local[2, i] = plane[NORMAL] * a + plane[NORMAL + 1] * b + plane[NORMAL + 2] * c
    for i in range(n):
        x, y, z = local[0, i], local[1, i], local[2, i]
        rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3] = 1.0, x, y, z
        rows[i, 4], rows[i, 5], rows[i, 6] = x * x, root * x * y, y * y
        rows[i, 7], rows[i, 8], rows[i, 9] = root * x * z, root * y * z, z * z


@noalias_kernel
def measure_gradient(window: Window, n: int) -> None:
    """Measure the gradient (25)-(27) of all points: its square, and the variance (30).

    Where two sheets of a quadric meet, the gradient and the variance vanish. The variance is at
    least 1 % of the mean of the kept points; else these points would decide all.
    """
    a, plane, local, sigma2 = window.a, window.plane, window.local, window.sigma2
    root = ROOT2
    for i in range(n):
        x, y, z = local[0, i], local[1, i], local[2, i]
        u = a[1] + 2 * a[4] * x + root * (a[5] * y + a[7] * z)
        v = a[2] + 2 * a[6] * y + root * (a[5] * x + a[8] * z)
        w = a[3] + 2 * a[9] * z + root * (a[7] * x + a[8] * y)
        window.slope[i] = u * u + v * v + w * w
        squared = 0.0  # A Aᵀ (30), with A in the frame of the cloud
        for k in range(3):
            squared += (u * plane[LONG + k] + v * plane[MIDDLE + k] + w * plane[NORMAL + k]) ** 2
        sigma2[i] = window.variance[i] * squared
    total, count = 0.0, 0
    for i in range(n):
        total += sigma2[i] if window.kept[i] else 0.0
        count += window.kept[i]
    least = MIN_VARIANCE * total / count
    for i in range(n):
        sigma2[i] = max(sigma2[i], least)


@noalias_kernel
def weigh(window: Window, n: int) -> None:
    """Give the kept points the weight 1/σ², the others none."""
    for i in range(n):
        window.weight[i] = 1 / window.sigma2[i] if window.kept[i] else 0.0


@noalias_kernel
def measure_distances(window: Window, n: int, size: int) -> None:
    """Measure residual, variance and slope of all points under the surface a."""
    measure_gradient(window, n)
    for i in range(n):
        window.slope[i] = np.sqrt(window.slope[i])
    measure_residuals(window, n, size)


@noalias_kernel
def measure_residuals(window: Window, n: int, size: int) -> None:
    """Measure the residuals (29) of all points: B a."""
    for i in range(n):
        value = 0.0
        for j in range(size):
            value += window.rows[i, j] * window.a[j]
        window.residual[i] = value


@noalias_kernel
def _measure_levers(window: Window, n: int, size: int) -> None:
    """Measure B Q Bᵀ of all points."""
    rows, product = window.rows, window.square
    for i in range(n):
        for k in range(ROW):
            product[0, k] = 0.0
        for k in range(size):
            add_row(product, 0, rows[i, k], window.cofactor, k, size)
        value = 0.0
        for j in range(size):
            value += product[0, j] * rows[i, j]
        window.lever[i] = value


@noalias_kernel
def adjust(window: Window, n: int, size: int) -> bool:
    """Repeat the adjustment of the kept points from a until it stands; measure all points.

    False if the parameters are ambiguous.
    """
    for _ in range(ADJUSTMENTS):
        measure_gradient(window, n)
        weigh(window, n)
        before, _after = step(window, n, size)
        if np.isnan(before):
            return False
        normalize(window, size)
        largest = 0.0
        for i in range(size):
            largest = max(largest, abs(window.step[i]))
        if largest < CONVERGED:
            break
    measure_distances(window, n, size)
    _measure_levers(window, n, size)
    return True
