# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the quadric detector works on, and its linear algebra."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Bools, Floats

PLANE, PARABOLOID, QUADRIC = 4, 7, 10  # parameters, one of which the norm takes away
# Numba takes elements of a tuple of constants as constants, and compiles what they are given to for
# each of them. That is a fifth of the time to compile, and saves a tenth of the time to run.
SIZES = (PLANE, PARABOLOID, QUADRIC)
BEGIN = (0,)
ROOT2 = 2**0.5
LEAST_VARIANCE = 0.01  # of the mean of all: near an edge the gradient vanishes
HEIGHT = 3  # the column of z
BORDERED = QUADRIC + 1
NORMAL, MIDDLE, LONG, MEAN, MOMENTS, WEIGHT = 0, 3, 6, 9, 12, 15  # parts of Window.plane
SINGULAR = 1e-12  # a pivot below this part of the matrix: the parameters are ambiguous


class Window(NamedTuple):
    """A window of points, and room to work on it; only the first n of every row count.

    Attributes
    ----------
    xyz : (3, M) float64
        Coordinates.
    variance : (M,) float64
        Variance of any coordinate of each point; only their ratios count.
    rows : (M, 10) float64
        B (23) of each point in the frame of the plane.
    residual, sigma2, slope, lever : (M,) float64
        v (29), σ² (30), the length of the gradient (25)-(27), and B Q Bᵀ of each point.
    weight : (M,) float64
        Of each point in the next fit.
    test, score, scratch : (M,) float64
        T ÷ its critical value under the last surface, the least of all surfaces, and room.
    left, kept, next : (M,) bool
        On no surface so far; in the fit; in the next one.
    a, step : (10,) float64
        Parameters, and what (29) is to change of them.
    plane, best : (16,) float64
        The plane fitted last, and the best one to begin with: normal, axes of the middle and the
        largest moment, mean, the three moments, sum of the weights.
    normal, cofactor, square, vectors : (11, 11) float64
        Bᵀ P B, Q of the parameters, and room.

    """

    xyz: Floats
    variance: Floats
    rows: Floats
    residual: Floats
    sigma2: Floats
    slope: Floats
    lever: Floats
    weight: Floats
    test: Floats
    score: Floats
    scratch: Floats
    left: Bools
    kept: Bools
    next: Bools
    a: Floats
    step: Floats
    plane: Floats
    best: Floats
    normal: Floats
    cofactor: Floats
    square: Floats
    vectors: Floats


def empty_window(room: int) -> Window:
    """Allocate for windows of up to ``room`` points."""
    return Window(
        np.zeros((3, room)),
        np.ones(room),
        np.zeros((room, QUADRIC)),
        *np.zeros((8, room)),
        *np.zeros((3, room), np.bool_),
        *np.zeros((2, QUADRIC)),
        *np.zeros((2, 16)),
        *np.zeros((4, BORDERED, BORDERED)),
    )


@inner_kernel
def sum_normal(window: Window, n: int, size: int) -> None:
    """Sum the normal matrix Bᵀ P B."""
    rows, normal = window.rows, window.normal
    normal[:size] = 0.0
    for i in range(n):
        weight = window.weight[i]
        if weight == 0:
            continue
        for j in range(size):
            part = weight * rows[i, j]
            for k in range(j + 1):
                normal[j, k] += part * rows[i, k]
    for j in range(size):
        for k in range(j):
            normal[k, j] = normal[j, k]


@inner_kernel
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
        for j in range(size + 1):
            square[i, j] = window.normal[i, j] if i < size and j < size else 0.0
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(size):
        # The border is as large as the rest: the choice of pivots shall not depend on weights.
        square[i, size] = square[size, i] = window.a[i] * largest
    if not _eliminate(square, inverse, size + 1, SINGULAR * largest):
        return False
    for i in range(size):
        for j in range(size):
            window.cofactor[i, j] = (inverse[i, j] + inverse[j, i]) / 2
    return True


@inner_kernel
def _eliminate(square: Floats, inverse: Floats, size: int, least: float) -> bool:
    """Turn the unit matrix ``inverse`` into the inverse of ``square``, by Gauss and Jordan."""
    for i in range(size):
        pivot = i
        for j in range(i + 1, size):
            if abs(square[j, i]) > abs(square[pivot, i]):
                pivot = j
        if not abs(square[pivot, i]) > least:
            return False
        for k in range(size):
            square[i, k], square[pivot, k] = square[pivot, k], square[i, k]
            inverse[i, k], inverse[pivot, k] = inverse[pivot, k], inverse[i, k]
        factor = 1 / square[i, i]
        for k in range(size):
            square[i, k] *= factor
            inverse[i, k] *= factor
        for j in range(size):
            factor = square[j, i]
            if j != i and factor != 0:
                for k in range(size):
                    square[j, k] -= factor * square[i, k]
                    inverse[j, k] -= factor * inverse[i, k]
    return True


@kernel
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


@inner_kernel
def normalize(window: Window, size: int) -> None:
    """Give the parameters the norm 1 (19)."""
    norm = 0.0
    for i in range(size):
        norm += window.a[i] * window.a[i]
    norm = np.sqrt(norm)
    for i in range(size):
        window.a[i] /= norm
