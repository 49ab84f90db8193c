# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the nearest neighbours of a point tell of it: distances, other lines, and their surface.

The surface is the plane through the neighbours, the point left out, or the straight line where they
lie on one. It is fitted twice, the second time with weights (Cauchy's, squared) that fall with the
distance from the first one, so that it is that of most of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels import kernel, median_of_few

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Index = NDArray[np.int32]

K = 20  # neighbours
FEW, SOME, NEAR = 3, 5, 8  # of them
FITS = 2
REACH = 3.0  # standard deviations at which a neighbour weighs a quarter
LEAST = 1e-4  # metres that are added to the scale of residuals, which may be 0
MAD_TO_SIGMA = 1.4826
NARROW = 1e-6  # ratio of variances across and along, below which neighbours lie on a line
AMIDST = 1.5
BEYOND = 1.2  # times the distance of the farthest neighbour, where none is of another line


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
    """Make room for so many points."""
    return Surroundings(*np.empty((len(Surroundings._fields), count)))


@kernel
def has_lost(nearest: Index, rejected: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which points have rejected neighbours."""
    result = np.zeros(len(nearest), np.bool_)
    for i in range(len(nearest)):
        for m in range(K):
            result[i] |= rejected[nearest[i, m]]
    return result


@kernel
def measure(
    begin: int,
    end: int,
    xyz: Floats,
    nearest: Index,
    line: NDArray[np.int64],
    wanted: NDArray[np.bool_],
    out: Surroundings,
) -> None:
    """Measure the wanted of a range of points from their lists of neighbours, nearest first."""
    near = np.empty((3, K))
    room = np.empty((2, K))
    plane = np.empty(6)
    for i in range(begin, end):
        if not wanted[i]:
            continue
        for m in range(K):
            j = nearest[i, m]
            for axis in range(3):
                near[axis, m] = xyz[j, axis] - xyz[i, axis]
        _distances(i, near, nearest, line, out)
        _fit(near, room, plane)
        out.off[i], out.scale[i], out.amidst[i] = abs(plane[3]), plane[4], plane[5]


@kernel
def _distances(
    i: int, near: Floats, nearest: Index, line: NDArray[np.int64], out: Surroundings
) -> None:
    total, other, others = 0.0, -1.0, 0
    for m in range(K):
        x, y, z = near[0, m], near[1, m], near[2, m]
        distance = np.sqrt((x * x + y * y) + z * z)
        total += distance
        if line[nearest[i, m]] != line[i]:
            others += m < NEAR
            if other < 0:
                other = distance
        if m == FEW - 1:
            out.few[i] = total / FEW
        elif m == SOME - 1:
            out.some[i] = total / SOME
    out.all[i] = total / K
    out.other[i] = other if other >= 0 else BEYOND * distance
    out.others[i] = others


@kernel
def _fit(near: Floats, room: Floats, plane: Floats) -> None:
    """Fit the surface to the neighbours, given relative to the point.

    Writes its normal, the height of the point above it, the scale of the residuals, and how much
    the point is amidst its neighbours.
    """
    weight, residual = room[0], room[1]
    weight[:] = 1.0
    for fit in range(FITS):
        aside = _fit_weighted(near, weight, plane)
        if fit == 0:
            plane[5] = min(max(AMIDST * (1 - aside), 0.0), 1.0)
        for m in range(K):
            height = near[0, m] * plane[0] + near[1, m] * plane[1] + near[2, m] * plane[2]
            residual[m] = abs(height + plane[3])
            weight[m] = residual[m]
        scale = MAD_TO_SIGMA * median_of_few(residual, len(residual)) + LEAST
        if fit < FITS - 1:
            for m in range(K):
                ratio = weight[m] / (REACH * scale)
                weight[m] = 1 / (1 + ratio * ratio) ** 2
    plane[4] = scale


@kernel
def _fit_weighted(near: Floats, weight: Floats, plane: Floats) -> float:
    """Write the normal of the weighted neighbours, and the height of the point above them.

    Returns how far their mean is aside of the point, in parts of their spread along the surface.
    """
    total = sx = sy = sz = 0.0
    for m in range(K):
        w = weight[m]
        total += w
        sx += w * near[0, m]
        sy += w * near[1, m]
        sz += w * near[2, m]
    sx, sy, sz = sx / total, sy / total, sz / total
    xx = yy = zz = xy = xz = yz = 0.0
    for m in range(K):
        x, y, z, w = near[0, m] - sx, near[1, m] - sy, near[2, m] - sz, weight[m] / total
        xx += w * x * x
        yy += w * y * y
        zz += w * z * z
        xy += w * x * y
        xz += w * x * z
        yz += w * y * z
    low, middle, high = _eigenvalues(xx, yy, zz, xy, xz, yz)
    if middle > NARROW * high:
        plane[0], plane[1], plane[2] = _eigenvector(xx, yy, zz, xy, xz, yz, low)
    else:
        # The neighbours lie on a line: its normal is the one that the point lies on.
        a, b, c = _eigenvector(xx, yy, zz, xy, xz, yz, high)
        along = a * sx + b * sy + c * sz
        a, b, c = sx - along * a, sy - along * b, sz - along * c
        length = np.sqrt(a * a + b * b + c * c)
        if length > 0:
            plane[0], plane[1], plane[2] = a / length, b / length, c / length
        else:
            plane[0], plane[1], plane[2] = 0.0, 0.0, 1.0
    height = sx * plane[0] + sy * plane[1] + sz * plane[2]
    plane[3] = -height
    spread = middle + high
    if not spread > 0:
        return 0.0
    aside = max((sx * sx + sy * sy + sz * sz) - height * height, 0.0)
    return float(np.sqrt(aside / spread))


@kernel
def _eigenvalues(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float]:
    """Return the eigenvalues of a symmetric matrix, ascending (Smith 1961)."""
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    size = np.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if size == 0:
        return mean, mean, mean
    a, b, c, d, e, f = a / size, b / size, c / size, xy / size, xz / size, yz / size
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2
    angle = np.arccos(min(max(half, -1.0), 1.0)) / 3
    high = mean + 2 * size * np.cos(angle)
    low = mean + 2 * size * np.cos(angle + 2 * np.pi / 3)
    return low, 3 * mean - low - high, high


@kernel
def _eigenvector(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float, value: float
) -> tuple[float, float, float]:
    """Return the unit eigenvector of a symmetric matrix: the longest product of two rows."""
    a, b, c = xx - value, yy - value, zz - value
    x, y, z, best = 0.0, 0.0, 1.0, 0.0
    for rows in range(3):
        if rows == 0:
            u, v, w = xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy
        elif rows == 1:
            u, v, w = xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz
        else:
            u, v, w = b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz
        square = u * u + v * v + w * w
        if square > best:
            x, y, z, best = u, v, w, square
    if best == 0:
        return 0.0, 0.0, 1.0
    length = np.sqrt(best)
    return x / length, y / length, z / length
