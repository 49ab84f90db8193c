# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Eigenvalues and eigenvectors of symmetric matrices of any size."""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.kernels.kernels import device_function

SWEEPS = 40  # of Jacobi rotations; ten are plenty
NEGLIGIBLE = 1e-31  # of the squares of a diagonal: what is beside it is below its rounding


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
