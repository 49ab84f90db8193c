# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Eigenvalues and eigenvectors of symmetric 3 × 3 matrices, those of several points side by side.

The rows of the matrices are xx, yy, zz, xy, xz, yz: (6, lanes).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.kernels import inner_kernel

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats

    Vector = tuple[float, float, float, float]  # and its squared length


@inner_kernel
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


@inner_kernel
def eigenvectors(moment: Floats, value: Floats, narrow: float, vector: Floats) -> None:
    """Write one unit eigenvector of each: the longest product of two rows of matrix - eigenvalue.

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


@inner_kernel
def _longer(x: float, y: float, z: float, best: Vector) -> Vector:
    square = x * x + y * y + z * z
    return (x, y, z, square) if square > best[3] else best
