# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Eigenvalues and eigenvectors of symmetric matrices: 3 × 3 in lanes, or one of any size.

Those of several points side by side are (6, lanes); their rows are xx, yy, zz, xy, xz, yz.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.kernels.kernels import device_function

Vector = tuple[float, float, float, float]  # and its squared length

SWEEPS = 40  # of Jacobi rotations; ten are plenty
NEGLIGIBLE = 1e-31  # of the squares of a diagonal: what is beside it is below its rounding


@device_function
def eigenvalues(moment: Floats, value: Floats) -> None:
    """Write the eigenvalues, ascending: (3, lanes) (Smith 1961)."""
    lanes = moment.shape[1]
    size, half = np.empty(lanes), np.empty(lanes)
    for lane in range(lanes):
        xx, yy, zz = moment[0, lane], moment[1, lane], moment[2, lane]
        xy, xz, yz = moment[3, lane], moment[4, lane], moment[5, lane]
        mean = (xx + yy + zz) / 3
        a, b, c = xx - mean, yy - mean, zz - mean
        s = np.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
        a, b, c, d, e, f = a / s, b / s, c / s, xy / s, xz / s, yz / s
        size[lane] = s
        half[lane] = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2
    # By themselves, because there are no such functions for several lanes.
    for lane in range(lanes):
        angle = np.arccos(min(max(half[lane], -1.0), 1.0)) / 3
        value[0, lane], value[2, lane] = np.cos(angle + 2 * np.pi / 3), np.cos(angle)
    for lane in range(lanes):
        mean = (moment[0, lane] + moment[1, lane] + moment[2, lane]) / 3
        high = mean + 2 * size[lane] * value[2, lane]
        low = mean + 2 * size[lane] * value[0, lane]
        equal = size[lane] == 0
        value[0, lane] = mean if equal else low
        value[1, lane] = mean if equal else 3 * mean - low - high
        value[2, lane] = mean if equal else high


@device_function
def eigenvectors(moment: Floats, value: Floats, narrow: float, vector: Floats) -> None:
    """Write a unit eigenvector each: the longest cross product of two rows of matrix - eigenvalue.

    That of the lowest eigenvalue; but of the highest, where the middle one is not greater than
    ``narrow`` × that. 0 0 1 where all are equal. ``vector`` may have more than three rows.
    """
    for lane in range(moment.shape[1]):
        of = value[0, lane] if value[1, lane] > narrow * value[2, lane] else value[2, lane]
        xy, xz, yz = moment[3, lane], moment[4, lane], moment[5, lane]
        a, b, c = moment[0, lane] - of, moment[1, lane] - of, moment[2, lane] - of
        best = 0.0, 0.0, 1.0, 0.0
        best = _longer(xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy, best)
        best = _longer(xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz, best)
        best = _longer(b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz, best)
        length = np.sqrt(best[3]) if best[3] != 0 else 1.0
        vector[0, lane] = best[0] / length
        vector[1, lane] = best[1] / length
        vector[2, lane] = best[2] / length


@device_function
def _longer(x: float, y: float, z: float, best: Vector) -> Vector:
    square = x * x + y * y + z * z
    return (x, y, z, square) if square > best[3] else best


@device_function
def eigen(matrix: Floats, vectors: Floats, size: int) -> None:
    """Turn a symmetric matrix into its eigenvalues, on its diagonal; vectors are the columns.

    Jacobi's rotations, row by row, in no order of the values.
    """
    for i in range(size):
        for j in range(size):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        beside, diagonal = 0.0, 0.0
        for i in range(size):
            diagonal += matrix[i, i] * matrix[i, i]
            for j in range(i):
                beside += matrix[i, j] * matrix[i, j]
        if not beside > NEGLIGIBLE * diagonal:
            return
        for i in range(size - 1):
            for j in range(i + 1, size):
                if matrix[i, j] != 0:
                    _rotate(matrix, vectors, size, i, j)


@device_function
def find_least(matrix: Floats, size: int) -> int:
    """Return the place of the least eigenvalue on the diagonal, the first of those that tie."""
    least = 0
    for i in range(1, size):
        if matrix[i, i] < matrix[least, least]:
            least = i
    return least


@device_function
def _rotate(matrix: Floats, vectors: Floats, size: int, i: int, j: int) -> None:
    """Turn axes i and j such that their product vanishes."""
    beside = matrix[i, j]
    ratio = (matrix[j, j] - matrix[i, i]) / (2 * beside)
    tangent = 1 / (abs(ratio) + np.sqrt(ratio * ratio + 1))
    if ratio < 0:
        tangent = -tangent
    cosine = 1 / np.sqrt(tangent * tangent + 1)
    sine = tangent * cosine
    matrix[i, i] -= tangent * beside
    matrix[j, j] += tangent * beside
    matrix[i, j] = matrix[j, i] = 0
    for k in range(size):
        if k not in (i, j):
            one, other = matrix[k, i], matrix[k, j]
            matrix[k, i] = matrix[i, k] = cosine * one - sine * other
            matrix[k, j] = matrix[j, k] = sine * one + cosine * other
        one, other = vectors[k, i], vectors[k, j]
        vectors[k, i] = cosine * one - sine * other
        vectors[k, j] = sine * one + cosine * other
