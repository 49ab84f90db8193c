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

from lidar_outlier_filter.core.detectors.quadric.kernels import (
    BEGIN,
    LEAST_VARIANCE,
    LONG,
    MEAN,
    MIDDLE,
    MOMENTS,
    NORMAL,
    QUADRIC,
    ROOT2,
    SIZES,
    WEIGHT,
    Window,
    normalize,
    step,
    sum_normal,
)
from lidar_outlier_filter.core.kernels.jacobi import eigen, find_least
from lidar_outlier_filter.core.kernels.kernels import inner_kernel

ADJUSTMENTS = 10
CONVERGED = 1e-6  # largest change of a parameter


@inner_kernel
def fit_plane(window: Window, begin: int, end: int) -> None:
    """Fit the plane through points begin to end by their weights, at least one of them not 0.

    The normal is the axis of the least moment: the exact solution of (29) for four parameters.
    """
    xyz, weight = window.xyz, window.weight
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
    square = window.square
    square[0, 0] = xx - total * x * x
    square[1, 1] = yy - total * y * y
    square[2, 2] = zz - total * z * z
    square[0, 1] = square[1, 0] = xy - total * x * y
    square[0, 2] = square[2, 0] = xz - total * x * z
    square[1, 2] = square[2, 1] = yz - total * y * z
    eigen(square, window.vectors, 3)
    plane = window.plane
    plane[MEAN], plane[MEAN + 1], plane[MEAN + 2], plane[WEIGHT] = x, y, z, total
    least = find_least(square, 3)
    middle, largest = (least + 1) % 3, (least + 2) % 3
    if square[middle, middle] > square[largest, largest]:
        middle, largest = largest, middle
    for place, k in enumerate((least, middle, largest)):
        plane[MOMENTS + place] = max(square[k, k], 0.0)
        for axis in range(3):
            plane[3 * place + axis] = window.vectors[axis, k]


@inner_kernel
def is_plane(window: Window, floor: float) -> bool:
    """Return a plane from a line: it is wider than the least standard deviation."""
    return bool(window.plane[MOMENTS + 1] > floor * floor * window.plane[WEIGHT])


@inner_kernel
def adjust_plane(window: Window, n: int, floor: float) -> bool:
    """Fit the plane to the kept points; measure all points. False if they lie on a line."""
    for i in range(n):
        window.weight[i] = 1 / window.variance[i] if window.kept[i] else 0.0
    fit_plane(window, BEGIN[0], n)
    if not is_plane(window, floor):
        return False
    measure_plane(window, n)
    return True


@inner_kernel
def measure_heights(window: Window, begin: int, end: int) -> None:
    """Measure the residuals (29) of points begin to end from the plane: heights over it."""
    xyz, plane = window.xyz, window.plane
    x, y, z = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
    zero = x * plane[MEAN] + y * plane[MEAN + 1] + z * plane[MEAN + 2]
    for i in range(begin, end):
        window.residual[i] = x * xyz[0, i] + y * xyz[1, i] + z * xyz[2, i] - zero


@inner_kernel
def measure_plane(window: Window, n: int) -> None:
    """Measure all points against the plane: residual, variance, slope and lever.

    Height and tilts of the plane are uncorrelated in its own axes: Q is diagonal.
    """
    measure_heights(window, BEGIN[0], n)
    xyz, plane = window.xyz, window.plane
    window.slope[:n] = 1.0
    level = 1 / plane[WEIGHT]
    tilt_middle, tilt_long = 1 / plane[MOMENTS + 1], 1 / plane[MOMENTS + 2]
    for i in range(n):
        x, y, z = xyz[0, i] - plane[MEAN], xyz[1, i] - plane[MEAN + 1], xyz[2, i] - plane[MEAN + 2]
        u = plane[MIDDLE] * x + plane[MIDDLE + 1] * y + plane[MIDDLE + 2] * z
        v = plane[LONG] * x + plane[LONG + 1] * y + plane[LONG + 2] * z
        window.lever[i] = level + u * u * tilt_middle + v * v * tilt_long
        window.sigma2[i] = _variance_along(
            window.variance[i], plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
        )


@inner_kernel
def _variance_along(variance: float, x: float, y: float, z: float) -> float:
    """Return A D Aᵀ (30) of one point, with A = (x, y, z) in the frame of the cloud."""
    return variance * (x * x + y * y + z * z)


@inner_kernel
def fill_rows(window: Window, n: int) -> None:
    """Fill B (23) of all points, in the frame of the plane."""
    xyz, plane, rows, root = window.xyz, window.plane, window.rows, ROOT2
    for i in range(n):
        a, b, c = xyz[0, i] - plane[MEAN], xyz[1, i] - plane[MEAN + 1], xyz[2, i] - plane[MEAN + 2]
        x = plane[LONG] * a + plane[LONG + 1] * b + plane[LONG + 2] * c
        y = plane[MIDDLE] * a + plane[MIDDLE + 1] * b + plane[MIDDLE + 2] * c
        z = plane[NORMAL] * a + plane[NORMAL + 1] * b + plane[NORMAL + 2] * c
        rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3] = 1.0, x, y, z
        rows[i, 4], rows[i, 5], rows[i, 6] = x * x, root * x * y, y * y
        rows[i, 7], rows[i, 8], rows[i, 9] = root * x * z, root * y * z, z * z


@inner_kernel
def measure_gradient(window: Window, n: int) -> None:
    """Measure the slope (25)-(27) and the variance (30) of all points.

    Where two sheets of a quadric meet, the gradient vanishes, and with it the variance; it is held
    at a hundredth of the mean of the kept points, or those few would decide all.
    """
    a, plane, rows, sigma2 = window.a, window.plane, window.rows, window.sigma2
    root = ROOT2
    total, count = 0.0, 0
    for i in range(n):
        x, y, z = rows[i, 1], rows[i, 2], rows[i, 3]
        u = a[1] + 2 * a[4] * x + root * (a[5] * y + a[7] * z)
        v = a[2] + 2 * a[6] * y + root * (a[5] * x + a[8] * z)
        w = a[3] + 2 * a[9] * z + root * (a[7] * x + a[8] * y)
        window.slope[i] = np.sqrt(u * u + v * v + w * w)
        sigma2[i] = _variance_along(
            window.variance[i],
            u * plane[LONG] + v * plane[MIDDLE] + w * plane[NORMAL],
            u * plane[LONG + 1] + v * plane[MIDDLE + 1] + w * plane[NORMAL + 1],
            u * plane[LONG + 2] + v * plane[MIDDLE + 2] + w * plane[NORMAL + 2],
        )
        if window.kept[i]:
            total += sigma2[i]
            count += 1
    least = LEAST_VARIANCE * total / count
    for i in range(n):
        sigma2[i] = max(sigma2[i], least)


@inner_kernel
def weigh(window: Window, n: int) -> None:
    """Give the kept points the weight 1/σ², the others none."""
    for i in range(n):
        window.weight[i] = 1 / window.sigma2[i] if window.kept[i] else 0.0


@inner_kernel
def measure_residuals(window: Window, n: int, size: int) -> None:
    """Measure the residuals (29) of all points: B a."""
    for i in range(n):
        value = 0.0
        for j in range(size):
            value += window.rows[i, j] * window.a[j]
        window.residual[i] = value


@inner_kernel
def _measure_levers(window: Window, n: int, size: int) -> None:
    """Measure B Q Bᵀ of all points."""
    rows, cofactor = window.rows, window.cofactor
    for i in range(n):
        value = 0.0
        for j in range(size):
            part = 0.0
            for k in range(size):
                part += cofactor[j, k] * rows[i, k]
            value += part * rows[i, j]
        window.lever[i] = value


@inner_kernel
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
    measure_gradient(window, n)
    measure_residuals(window, n, size)
    _measure_levers(window, n, size)
    return True


@inner_kernel
def start_algebraic(window: Window, n: int) -> float:
    """Set a to the eigenvector of the least eigenvalue of Σ Bᵀ B over the kept points.

    Returns the gap: how many times as far, in the mean of the squares, the second best quadric is
    from the points. Distances are those of the first order, residual ÷ slope, because eigenvalues
    of (19) alone take any quadric for good that is flat everywhere.
    """
    for i in range(n):
        window.weight[i] = 1.0 if window.kept[i] else 0.0
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
    far = mean_square_distance(window, n)
    window.a[:] = vectors[:QUADRIC, least]
    return far / mean_square_distance(window, n)


@inner_kernel
def mean_square_distance(window: Window, n: int) -> float:
    """Return Σ residual² ÷ Σ slope² of the kept points under the quadric a."""
    measure_gradient(window, n)
    measure_residuals(window, n, SIZES[2])
    residuals = slopes = 0.0
    for i in range(n):
        if window.kept[i]:
            residuals += window.residual[i] ** 2
            slopes += window.slope[i] ** 2
    return residuals / slopes
