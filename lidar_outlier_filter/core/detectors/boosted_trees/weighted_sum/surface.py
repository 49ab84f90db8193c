# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the nearest neighbours of a point say of it: distances, other lines, and their surface.

The surface is the plane through the neighbours, the point left out, or the straight line where they
lie on one. It is fitted twice, the second time with weights (Cauchy's, squared) that fall with the
distance from the first one, so that it is that of most of them.

Arrays are [quantity, neighbour, lane]: many points are measured side by side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels.eigen import (
    eigenvalues,
    eigenvectors,
)
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel
from lidar_outlier_filter.core.kernels.lanes import LANES, fill, network, sort

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Floats, Index, Ints

K = 20  # neighbours
FEW, SOME, NEAR = 3, 5, 8  # of them
FITS = 2
REACH = 3.0  # standard deviations at which a neighbour weighs a quarter
LEAST = 1e-4  # metres that are added to the scale of residuals, which may be 0
MAD_TO_SIGMA = 1.4826
NARROW = 1e-6  # ratio of variances across and along, below which neighbours lie on a line
AMIDST = 1.5
BEYOND = 1.2  # times the distance of the farthest neighbour, where none is of another line
MIDDLE = network(K, range(K // 2 - 1, K // 2 + 1))  # the two whose mean is the median of K


class Surroundings(NamedTuple):
    """What is measured of N points, (N,) float64 each, in tree order, metres.

    Attributes
    ----------
    few, some, all : mean distance to the 3, 5 and 20 nearest
    other : distance to the nearest of the 20 that is of another line
    others : how many of the 8 nearest are of other lines
    off : distance from the surface
    scale : standard deviation of the neighbours from it
    amidst : from 1, where neighbours lie all around the point, to 0, where on one side: 1.5 × (1 -
        distance of their mean from it ÷ their root mean square distance from that mean), both along
        the plane through them

    """

    few: Floats
    some: Floats
    all: Floats
    other: Floats
    others: Floats
    off: Floats
    scale: Floats
    amidst: Floats


def empty(count: int) -> Surroundings:
    """Allocate for so many points."""
    return Surroundings(*np.empty((len(Surroundings._fields), count)))


@kernel
def lost(nearest: Index, rejected: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Count the rejected neighbours of each point."""
    result = np.zeros(len(nearest), np.int64)
    for i in range(len(nearest)):
        count = 0
        for m in range(K):
            count += rejected[nearest[i, m]]
        result[i] = count
    return result


@kernel
def measure(
    begin: int,
    end: int,
    wanted: NDArray[np.bool_],
    xyz: Floats,
    nearest: Index,
    line: Ints,
    out: Surroundings,
) -> None:
    """Measure the wanted of a range of points from their lists of neighbours, nearest first."""
    points = np.empty(LANES, np.int64)
    near, weight, residual = np.empty((3, K, LANES)), np.empty((K, LANES)), np.empty((K, LANES))
    plane, aside = np.empty((4, LANES)), np.empty(LANES)
    while begin < end:
        count, begin = fill(points, wanted, begin, end)
        if count > 0:
            _gather(points, xyz, nearest, near)
            _distances(points, near, nearest, line, residual, out)
            _fit(points, near, weight, residual, plane, aside, out)


@inner_kernel
def _gather(points: Ints, xyz: Floats, nearest: Index, near: Floats) -> None:
    """Put the neighbours side by side, relative to their points."""
    for lane in range(len(points)):
        i = points[lane]
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        for m in range(K):
            j = nearest[i, m]
            near[0, m, lane] = xyz[j, 0] - x
            near[1, m, lane] = xyz[j, 1] - y
            near[2, m, lane] = xyz[j, 2] - z


@inner_kernel
def _distances(
    points: Ints,
    near: Floats,
    nearest: Index,
    line: Ints,
    distance: Floats,
    out: Surroundings,
) -> None:
    total = np.zeros(len(points))
    for m in range(K):
        for lane in range(near.shape[2]):
            x, y, z = near[0, m, lane], near[1, m, lane], near[2, m, lane]
            distance[m, lane] = np.sqrt((x * x + y * y) + z * z)
        for lane in range(distance.shape[1]):
            total[lane] += distance[m, lane]
        if m == FEW - 1:
            for lane in range(len(points)):
                out.few[points[lane]] = total[lane] / FEW
        elif m == SOME - 1:
            for lane in range(len(points)):
                out.some[points[lane]] = total[lane] / SOME
    for lane in range(len(points)):
        i = points[lane]
        first, others = K, 0
        for m in range(K):
            is_other = line[nearest[i, m]] != line[i]
            first = min(first, m if is_other else K)
            others += is_other and m < NEAR
        out.all[i], out.others[i] = total[lane] / K, others
        out.other[i] = distance[first, lane] if first < K else BEYOND * distance[K - 1, lane]


@inner_kernel
def _fit(
    points: Ints,
    near: Floats,
    weight: Floats,
    residual: Floats,
    plane: Floats,
    aside: Floats,
    out: Surroundings,
) -> None:
    """Fit surfaces to the neighbours, and measure how far each point is from its own."""
    scale = np.empty(len(points))
    weight[:] = 1.0
    for fit in range(FITS):
        _fit_weighted(near, weight, plane, aside)
        if fit == 0:
            for lane in range(len(points)):
                out.amidst[points[lane]] = min(max(AMIDST * (1 - aside[lane]), 0.0), 1.0)
        _residuals(near, plane, residual, weight)
        sort(residual, MIDDLE)
        for lane in range(len(points)):
            middle = (residual[K // 2 - 1, lane] + residual[K // 2, lane]) / 2
            scale[lane] = MAD_TO_SIGMA * middle + LEAST
        if fit < FITS - 1:
            _weigh(weight, scale)
    for lane in range(len(points)):
        i = points[lane]
        out.off[i], out.scale[i] = abs(plane[3, lane]), scale[lane]


@inner_kernel
def _residuals(near: Floats, plane: Floats, residual: Floats, copy: Floats) -> None:
    """Write distances from the surface twice, because the search for their median reorders one."""
    for m in range(K):
        for lane in range(near.shape[2]):
            x, y, z = near[0, m, lane], near[1, m, lane], near[2, m, lane]
            height = x * plane[0, lane] + y * plane[1, lane] + z * plane[2, lane]
            residual[m, lane] = copy[m, lane] = abs(height + plane[3, lane])


@inner_kernel
def _weigh(weight: Floats, scale: Floats) -> None:
    """Turn residuals into weights."""
    for m in range(K):
        for lane in range(len(scale)):
            ratio = weight[m, lane] / (REACH * scale[lane])
            weight[m, lane] = 1 / (1 + ratio * ratio) ** 2


@inner_kernel
def _fit_weighted(near: Floats, weight: Floats, plane: Floats, aside: Floats) -> None:
    """Write the normals of the weighted neighbours, and the heights of the points above them.

    And how far their mean is aside of the point, in parts of their spread along the surface.
    """
    lanes = near.shape[2]
    total, mean = np.zeros(lanes), np.zeros((3, lanes))
    for m in range(K):
        for lane in range(lanes):
            w = weight[m, lane]
            total[lane] += w
            mean[0, lane] += w * near[0, m, lane]
            mean[1, lane] += w * near[1, m, lane]
            mean[2, lane] += w * near[2, m, lane]
    for axis in range(3):
        for lane in range(lanes):
            mean[axis, lane] /= total[lane]
    moment, value = np.zeros((6, lanes)), np.empty((3, lanes))
    for m in range(K):
        for lane in range(lanes):
            w = weight[m, lane] / total[lane]
            x = near[0, m, lane] - mean[0, lane]
            y = near[1, m, lane] - mean[1, lane]
            z = near[2, m, lane] - mean[2, lane]
            moment[0, lane] += w * x * x
            moment[1, lane] += w * y * y
            moment[2, lane] += w * z * z
            moment[3, lane] += w * x * y
            moment[4, lane] += w * x * z
            moment[5, lane] += w * y * z
    eigenvalues(moment, value)
    eigenvectors(moment, value, NARROW, plane)
    _heights(mean, value, plane, aside)


@inner_kernel
def _heights(mean: Floats, value: Floats, plane: Floats, aside: Floats) -> None:
    for lane in range(len(aside)):
        if not value[1, lane] > NARROW * value[2, lane]:
            _turn(lane, mean, plane)
    for lane in range(len(aside)):
        sx, sy, sz = mean[0, lane], mean[1, lane], mean[2, lane]
        height = sx * plane[0, lane] + sy * plane[1, lane] + sz * plane[2, lane]
        plane[3, lane] = -height
        spread = value[1, lane] + value[2, lane]
        along = max((sx * sx + sy * sy + sz * sz) - height * height, 0.0)
        aside[lane] = np.sqrt(along / spread) if spread > 0 else 0.0


@inner_kernel
def _turn(lane: int, mean: Floats, plane: Floats) -> None:
    """Replace the direction of a line by that of its normal that the point lies on."""
    sx, sy, sz = mean[0, lane], mean[1, lane], mean[2, lane]
    a, b, c = plane[0, lane], plane[1, lane], plane[2, lane]
    along = a * sx + b * sy + c * sz
    a, b, c = sx - along * a, sy - along * b, sz - along * c
    length = np.sqrt(a * a + b * b + c * c)
    if length > 0:
        plane[0, lane], plane[1, lane], plane[2, lane] = a / length, b / length, c / length
    else:
        plane[0, lane], plane[1, lane], plane[2, lane] = 0.0, 0.0, 1.0
