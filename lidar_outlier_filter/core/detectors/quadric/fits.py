# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The fits of the quadric detector: plane, paraboloid and quadric, (18)-(30) of the paper.

The three are one model with 4, 7 or 10 of the parameters of (18), nested: the columns of B (23) are
1, x, y, z, then x², xy, y², then xz, yz, z², where z is the normal of a plane through the points
(a paraboloid stands on it). Products of two coordinates are multiplied by √2, so that the norm (19)
is the same whichever way the axes point; a4, a5 and a6 of (18) are √2 times the ones here.
"""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.quadric.planes import (
    LONG,
    MEAN,
    MIDDLE,
    NORMAL,
    QUADRIC,
    Window,
)
from lidar_outlier_filter.core.kernels.kernels import noalias_kernel
from lidar_outlier_filter.core.kernels.vectors import ROW, add_row

PLANE, PARABOLOID = 4, 7  # parameters, one of which the norm takes away
# Numba takes elements of a tuple of constants as constants, and compiles what they are given to for
# each of them. That is a fifth of the time to compile, and saves a tenth of the time to run.
SIZES = (PLANE, PARABOLOID, QUADRIC)
ROOT2 = 2**0.5
MIN_VARIANCE = 0.01  # of the mean of all: near an edge the gradient vanishes
HEIGHT = 3  # the column of z
SINGULAR = 1e-12  # a pivot below this part of the matrix: the parameters are ambiguous
ADJUSTMENTS = 10
CONVERGED = 1e-6  # largest change of a parameter


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
