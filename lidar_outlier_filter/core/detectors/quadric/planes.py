# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Windows of points, and planes through them: (18)-(30) of the paper with four parameters.

The normal is the axis of the least moment, which is the exact solution of (29). Up to eight planes
are fitted side by side, in lanes; a single one is in the first lane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.kernels.eigen import NEGLIGIBLE, SWEEPS
from lidar_outlier_filter.core.kernels.kernels import inlined_kernel, noalias_kernel
from lidar_outlier_filter.core.kernels.vectors import ROW

QUADRIC = 10  # parameters, one of which the norm takes away
LANES = 8
NORMAL, MIDDLE, LONG, MEAN, MOMENTS, WEIGHT = 0, 3, 6, 9, 12, 15  # parts of Window.plane
# Rows of Window.lanes: moments, then eigenvalues; columns of the axes; mean; weight; what turns.
XX, YY, ZZ, XY, XZ, YZ = (LANES * row for row in range(6))
AXES, CENTRE, TOTAL, TURNS, ROWS = 6 * LANES, 15 * LANES, 18 * LANES, 19 * LANES, 20


class Window(NamedTuple):
    """A window of up to M points, and room to work on it; only its first n points count."""

    xyz: Floats  # (3, M)
    variance: Floats  # (M,) of any coordinate of each point; only their ratios count
    rows: Floats  # (M, 12) B (23) in the frame of the plane, and two zeros
    saved_test: Floats  # (2, M) test of the plane, and of the paraboloid
    saved_kept: Bools  # (2, M) kept of the plane, and of the paraboloid
    which: Ints  # (M,) some of the points
    lanes: Floats  # planes side by side, see planes.py
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
        np.zeros(ROWS * LANES),
        *np.zeros((2, 3, room)),
        *np.zeros((8, room)),
        *np.zeros((4, room), np.bool_),
        *np.zeros((2, QUADRIC)),
        *np.zeros((2, 16)),
        *np.zeros((4, ROW, ROW)),
    )


@noalias_kernel
def fit_plane(window: Window, xyz: Floats, n: int) -> None:
    """Fit the plane through n points by their weights, at least one of them not 0."""
    sum_moments(window, xyz, 0, n, 0)
    find_axes(window.lanes, 1)
    take_plane(window, 0)


@noalias_kernel
def sum_moments(window: Window, xyz: Floats, begin: int, end: int, lane: int) -> None:
    """Sum mean and moments of points begin to end by their weights."""
    weight, lanes = window.weight, window.lanes
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
    lanes[XX + lane], lanes[XY + lane] = xx - total * x * x, xy - total * x * y
    lanes[YY + lane], lanes[XZ + lane] = yy - total * y * y, xz - total * x * z
    lanes[ZZ + lane], lanes[YZ + lane] = zz - total * z * z, yz - total * y * z
    lanes[CENTRE + lane], lanes[CENTRE + LANES + lane] = x, y
    lanes[CENTRE + 2 * LANES + lane], lanes[TOTAL + lane] = z, total


@noalias_kernel
def find_axes(lanes: Floats, count: int) -> None:
    """Turn moments into eigenvalues and axes, as :func:`.eigen` does: Jacobi's rotations."""
    for lane in range(count):
        for axis in range(9):
            lanes[AXES + axis * LANES + lane] = 1.0 if axis in (0, 4, 8) else 0.0
    for _ in range(SWEEPS):
        turning = 0
        for lane in range(count):
            xx, yy, zz = lanes[XX + lane], lanes[YY + lane], lanes[ZZ + lane]
            xy, xz, yz = lanes[XY + lane], lanes[XZ + lane], lanes[YZ + lane]
            beside, diagonal = xy * xy + xz * xz + yz * yz, xx * xx + yy * yy + zz * zz
            lanes[TURNS + lane] = 1.0 if beside > NEGLIGIBLE * diagonal else 0.0
            turning += beside > NEGLIGIBLE * diagonal
        if turning == 0:
            return
        for lane in range(count):
            _turn(lanes, lane, XX, YY, XY, XZ, YZ, 0, 1)
        for lane in range(count):
            _turn(lanes, lane, XX, ZZ, XZ, XY, YZ, 0, 2)
        for lane in range(count):
            _turn(lanes, lane, YY, ZZ, YZ, XY, XZ, 1, 2)


@inlined_kernel
def _turn(
    lanes: Floats, lane: int, i: int, j: int, ij: int, ki: int, kj: int, one: int, two: int
) -> None:
    """Turn axes i and j such that their product ij vanishes; k is the third."""
    low, high, beside = lanes[i + lane], lanes[j + lane], lanes[ij + lane]
    turns = lanes[TURNS + lane] * beside != 0
    ratio = (high - low) / (2 * (beside if turns else 1.0))
    tangent = 1 / (abs(ratio) + np.sqrt(ratio * ratio + 1))
    tangent = -tangent if ratio < 0 else tangent
    cosine = 1 / np.sqrt(tangent * tangent + 1)
    sine = tangent * cosine
    lanes[i + lane] = low - tangent * beside if turns else low
    lanes[j + lane] = high + tangent * beside if turns else high
    lanes[ij + lane] = 0.0 if turns else beside
    a, b = lanes[ki + lane], lanes[kj + lane]
    lanes[ki + lane] = cosine * a - sine * b if turns else a
    lanes[kj + lane] = sine * a + cosine * b if turns else b
    for axis in range(3):
        first, second = AXES + (3 * axis + one) * LANES, AXES + (3 * axis + two) * LANES
        a, b = lanes[first + lane], lanes[second + lane]
        lanes[first + lane] = cosine * a - sine * b if turns else a
        lanes[second + lane] = sine * a + cosine * b if turns else b


@noalias_kernel
def take_plane(window: Window, lane: int) -> None:
    """Take the plane of a lane for that of the window."""
    lanes, plane = window.lanes, window.plane
    least = 0
    for k in range(1, 3):
        if lanes[k * LANES + lane] < lanes[least * LANES + lane]:
            least = k
    middle, largest = (least + 1) % 3, (least + 2) % 3
    if lanes[middle * LANES + lane] > lanes[largest * LANES + lane]:
        middle, largest = largest, middle
    for place, k in enumerate((least, middle, largest)):
        plane[MOMENTS + place] = max(lanes[k * LANES + lane], 0.0)
        for axis in range(3):
            plane[3 * place + axis] = lanes[AXES + (3 * axis + k) * LANES + lane]
    for axis in range(3):
        plane[MEAN + axis] = lanes[CENTRE + axis * LANES + lane]
    plane[WEIGHT] = lanes[TOTAL + lane]


@noalias_kernel
def is_plane(window: Window, floor: float) -> bool:
    """Return a plane from a line: it is wider than the least standard deviation."""
    return bool(window.plane[MOMENTS + 1] > floor * floor * window.plane[WEIGHT])


@noalias_kernel
def adjust_plane(window: Window, n: int, floor: float) -> bool:
    """Fit the plane to the kept points; measure all points. False if they lie on a line."""
    for i in range(n):
        window.weight[i] = 1 / window.variance[i] if window.kept[i] else 0.0
    fit_plane(window, window.xyz, n)
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
