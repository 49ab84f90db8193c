# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The predictions of the α-β-γ smoother: the normal equations of (14), summed and solved.

Two kernels give the same figures. The one in tiles adds one offset of the window at a time to many
points at once, which processors do four or eight at a stroke; it needs windows without holes. The
other follows the links of one point at a time, past ends of segments and rejected points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, noalias_kernel

Sums = tuple[float, ...]

CENTRED, BEFORE, AFTER = 0, 1, 2  # the windows of a point
T, X, WEIGHT, RATE = 0, 1, 4, 5  # rows of the columns
SINGULAR = 1e-10  # det N below this part of the product of its diagonal: no prediction
# Points in front of the tested one, and behind it; fewest of a window that predicts; order; whether
# each side of a point is a window of its own, beside the centred one
Windows = tuple[int, int, int, int, bool]
TILE = 128  # points at once: their sums stay in the first-level cache
SUMS = 14  # of one side of the window: 5 powers of time, 3 of them times x, y and z


@dataclass(frozen=True)
class Series:
    """The points of a block along their segments; rejected ones are taken out of the links.

    Attributes
    ----------
    columns : (6, M) float64
        Rows T to RATE of the N points: time after the first one in nanoseconds, x, y, z in metres,
        weight (one over the variance of a coordinate, 1/m²; 1 where σ is common to the line and
        found later), and one over the line's shot interval, which makes time differences small
        numbers. They begin at ``pad`` and have zeros around them.
    pad : int
        Room for the longest reach of a window.
    before, after : (N,) int64
        Neighbours in the segment, -1 at its ends.

    """

    columns: NDArray[np.float64]
    pad: int
    before: NDArray[np.int64]
    after: NDArray[np.int64]

    def __len__(self) -> int:
        """Count the points."""
        return len(self.before)

    def row(self, which: int | slice) -> NDArray[np.float64]:
        """View one or more of the rows, without the padding."""
        return self.columns[which, self.pad : self.pad + len(self)]


def empty_series(pad: int, before: NDArray[np.int64], after: NDArray[np.int64]) -> Series:
    """Allocate for points with these links, in whole tiles, and one tile of zeros behind them."""
    tiles = -(-len(before) // TILE)
    return Series(np.zeros((6, pad + tiles * TILE + pad + TILE)), pad, before, after)


def residuals(
    series: Series, which: NDArray[np.int64], parameters: AlphaBetaGamma
) -> NDArray[np.float64]:
    """Return the standardised differences (17), before division by a σ common to the line.

    Returns
    -------
    (3, 3, M) float64
        For each window (centred, before, after) the x, y and z of the M points ``which``; NaN where
        the window is not usable.

    """
    result = np.empty((3, 3, len(which)))
    before, after = series.before, series.after
    fewest, either = parameters.min_window, parameters.sides == 'either'
    windows = (parameters.before, parameters.after, fewest, parameters.order, either)
    reaches = {BEFORE: parameters.before, AFTER: parameters.after}
    reaches[CENTRED] = sum(reaches.values())
    for side, reach in reaches.items():
        if reach < fewest or not (either or side == CENTRED):
            result[side] = np.nan
    if len(which) == len(series):
        # All of them: nothing is rejected yet, and segments are without holes.
        _in_tiles(series.columns, series.pad, windows, result)
        which = slots = _near_ends(before, after, parameters.before, parameters.after)
    else:
        slots = np.arange(len(which))
    view = series.row(slice(None))
    _one_by_one(view, before, after, which, slots, windows, result)
    return result


@kernel
def _near_ends(
    before: NDArray[np.int64], after: NDArray[np.int64], reach_before: int, reach_after: int
) -> NDArray[np.int64]:
    """Return the points whose window overhangs an end of their segment."""
    count = len(before)
    near = np.zeros(count, np.bool_)
    steps = 0
    for i in range(count):
        steps = steps + 1 if before[i] >= 0 else 0
        near[i] = steps < reach_before
    for i in range(count - 1, -1, -1):
        steps = steps + 1 if after[i] >= 0 else 0
        near[i] = near[i] or steps < reach_after
    return np.flatnonzero(near)


@kernel
def _in_tiles(
    columns: NDArray[np.float64], pad: int, windows: Windows, result: NDArray[np.float64]
) -> None:
    """Predict every point as if segments had no ends.

    The caller does those near an end again. Loops over a tile are of a length known when compiled.
    """
    reach_before, reach_after, fewest, order, either = windows
    nowhere = columns.shape[1] - TILE
    weight = columns[WEIGHT]
    sums = np.empty((SUMS + 6) * TILE)
    both = np.empty((SUMS + 6) * TILE)
    for base in range(0, result.shape[2], TILE):
        here = pad + base
        sums[:] = 0
        for j in range(1, reach_before + 1, 2):
            second = here - j - 1 if j < reach_before else nowhere
            _add_pair(columns, here, here - j, second, order, sums)
        if either:
            both[:] = sums
        if either and reach_before >= fewest:
            _solve_tile(sums, order, weight[here : here + TILE])
            _copy_tile(sums, result[BEFORE], base)
        if either:
            sums[:] = 0
        for j in range(1, reach_after + 1, 2):
            second = here + j + 1 if j < reach_after else nowhere
            _add_pair(columns, here, here + j, second, order, sums)
        if either:
            both += sums
        else:
            # Nobody asks for one side alone: all offsets are in one sum.
            both[:] = sums
        if either and reach_after >= fewest:
            _solve_tile(sums, order, weight[here : here + TILE])
            _copy_tile(sums, result[AFTER], base)
        if reach_before + reach_after >= fewest:
            _solve_tile(both, order, weight[here : here + TILE])
            _copy_tile(both, result[CENTRED], base)


@device_function
def _add_pair(
    columns: NDArray[np.float64], here: int, a: int, b: int, order: int, sums: NDArray[np.float64]
) -> None:
    """Add to each point of the tile that begins at ``here`` its fellows of those at a and b.

    Two at once, because loading and storing the sums costs more than the arithmetic. The rows of
    ``sums`` lie at constant distances, so that the compiler sees them apart: s0 to s4, x0 to x2, y0
    to y2, z0 to z2, and behind them three powers of time for each of the two.
    """
    t_here = columns[T, here : here + TILE]
    t_a, t_b = columns[T, a : a + TILE], columns[T, b : b + TILE]
    rate_here = columns[RATE, here : here + TILE]
    weight_a, weight_b = columns[WEIGHT, a : a + TILE], columns[WEIGHT, b : b + TILE]
    for p in range(TILE):
        u = (t_a[p] - t_here[p]) * rate_here[p]
        v = (t_b[p] - t_here[p]) * rate_here[p]
        u0, v0 = weight_a[p], weight_b[p]
        u1, v1 = u0 * u, v0 * v
        u2, v2 = u1 * u, v1 * v
        sums[p] += u0 + v0
        sums[TILE + p] += u1 + v1
        sums[2 * TILE + p] += u2 + v2
        sums[14 * TILE + p], sums[17 * TILE + p] = u0, v0
        sums[15 * TILE + p], sums[18 * TILE + p] = u1, v1
        sums[16 * TILE + p], sums[19 * TILE + p] = u2, v2
    if order == 2:  # noqa: PLR2004
        for p in range(TILE):
            u = (t_a[p] - t_here[p]) * rate_here[p]
            v = (t_b[p] - t_here[p]) * rate_here[p]
            u3, v3 = sums[16 * TILE + p] * u, sums[19 * TILE + p] * v
            sums[3 * TILE + p] += u3 + v3
            sums[4 * TILE + p] += u3 * u + v3 * v
    for axis in range(3):
        z = columns[X + axis]
        row = (5 + 3 * axis) * TILE
        _add_axis(z[here : here + TILE], z[a : a + TILE], z[b : b + TILE], sums, order, sums[row:])


@device_function
def _add_axis(
    here: NDArray[np.float64],
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    powers: NDArray[np.float64],
    order: int,
    sums: NDArray[np.float64],
) -> None:
    """Add one coordinate, taken relative to the tested point so that large ones lose no digits."""
    for p in range(TILE):
        d, e = a[p] - here[p], b[p] - here[p]
        sums[p] += powers[14 * TILE + p] * d + powers[17 * TILE + p] * e
        sums[TILE + p] += powers[15 * TILE + p] * d + powers[18 * TILE + p] * e
    if order == 2:  # noqa: PLR2004
        for p in range(TILE):
            d, e = a[p] - here[p], b[p] - here[p]
            sums[2 * TILE + p] += powers[16 * TILE + p] * d + powers[19 * TILE + p] * e


@device_function
def _solve_tile(sums: NDArray[np.float64], order: int, weight: NDArray[np.float64]) -> None:
    """Solve as :func:`_solve` does, without branches, into the rows behind the sums."""
    for p in range(TILE):
        s0, s1, s2 = sums[p], sums[TILE + p], sums[2 * TILE + p]
        s3, s4 = sums[3 * TILE + p], sums[4 * TILE + p]
        c0, c1, c2, determinant, diagonal = _cofactors(s0, s1, s2, s3, s4, order)
        scale = 1 / (determinant * np.sqrt(1 / weight[p] + c0 / determinant))
        scale = scale if determinant > SINGULAR * diagonal else np.nan
        for axis in range(3):
            row = (5 + 3 * axis) * TILE + p
            b0, b1, b2 = sums[row], sums[row + TILE], sums[row + 2 * TILE]
            sums[(14 + axis) * TILE + p] = -(c0 * b0 + c1 * b1 + c2 * b2) * scale


@device_function
def _copy_tile(sums: NDArray[np.float64], result: NDArray[np.float64], base: int) -> None:
    size = min(TILE, result.shape[1] - base)
    for axis in range(3):
        row = (14 + axis) * TILE
        result[axis, base : base + size] = sums[row : row + size]


@device_function
def _cofactors(
    s0: float, s1: float, s2: float, s3: float, s4: float, order: int
) -> tuple[float, float, float, float, float]:
    """Return the first row of adj N, det N and the product of N's diagonal."""
    if order == 2:  # noqa: PLR2004
        c0, c1, c2 = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
        return c0, c1, c2, s0 * c0 + s1 * c1 + s2 * c2, s0 * s2 * s4
    return s2, -s1, 0.0, s0 * s2 - s1 * s1, s0 * s2


@kernel
def _one_by_one(
    columns: NDArray[np.float64],
    before: NDArray[np.int64],
    after: NDArray[np.int64],
    which: NDArray[np.int64],
    slots: NDArray[np.int64],
    windows: Windows,
    result: NDArray[np.float64],
) -> None:
    """Predict the points ``which`` and write them at ``slots``."""
    reach_before, reach_after, fewest, order, either = windows
    for m in range(len(which)):
        k, slot = which[m], slots[m]
        weight = columns[WEIGHT, k]
        front, i, in_front = _sums(columns, k, before[k], before, reach_before)
        behind, j, in_behind = _sums(columns, k, after[k], after, reach_after)
        count = in_front + in_behind
        total = _add(front, behind)
        # A window that overhangs an end of the segment is shifted inwards.
        if in_front < reach_before:
            more, j, extra = _sums(columns, k, j, after, reach_before - in_front)
            total = _add(total, more)
            count += extra
        if in_behind < reach_after:
            more, i, extra = _sums(columns, k, i, before, reach_after - in_behind)
            total = _add(total, more)
            count += extra
        _solve(total, count, fewest, order, weight, result[CENTRED], slot)
        if either:
            _solve(front, in_front, fewest, order, weight, result[BEFORE], slot)
            _solve(behind, in_behind, fewest, order, weight, result[AFTER], slot)


@noalias_kernel
def _sums(
    columns: NDArray[np.float64], k: int, start: int, link: NDArray[np.int64], reach: int
) -> tuple[Sums, int, int]:
    """Sum up to ``reach`` points along the links; return the sums, the next point and the count."""
    s0 = s1 = s2 = s3 = s4 = 0.0
    x0 = x1 = x2 = y0 = y1 = y2 = z0 = z1 = z2 = 0.0
    here, rate = columns[T, k], columns[RATE, k]
    x, y, z = columns[X, k], columns[X + 1, k], columns[X + 2, k]
    i, count = start, 0
    while count < reach and i >= 0:
        u = (columns[T, i] - here) * rate
        w0 = columns[WEIGHT, i]
        w1 = w0 * u
        w2 = w1 * u
        dx, dy, dz = columns[X, i] - x, columns[X + 1, i] - y, columns[X + 2, i] - z
        s0 += w0
        s1 += w1
        s2 += w2
        s3 += w2 * u
        s4 += w2 * u * u
        x0 += w0 * dx
        x1 += w1 * dx
        x2 += w2 * dx
        y0 += w0 * dy
        y1 += w1 * dy
        y2 += w2 * dy
        z0 += w0 * dz
        z1 += w1 * dz
        z2 += w2 * dz
        i = link[i]
        count += 1
    return (s0, s1, s2, s3, s4, x0, x1, x2, y0, y1, y2, z0, z1, z2), i, count


@device_function
def _add(a: Sums, b: Sums) -> Sums:
    return (
        *(a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4]),
        *(a[5] + b[5], a[6] + b[6], a[7] + b[7], a[8] + b[8], a[9] + b[9]),
        *(a[10] + b[10], a[11] + b[11], a[12] + b[12], a[13] + b[13]),
    )


@noalias_kernel
def _solve(
    sums: Sums,
    count: int,
    fewest: int,
    order: int,
    weight: float,
    result: NDArray[np.float64],
    slot: int,
) -> None:
    """Solve for the predicted position and write (17); NaN for a window that cannot predict."""
    s0, s1, s2, s3, s4, x0, x1, x2, y0, y1, y2, z0, z1, z2 = sums
    c0, c1, c2, determinant, diagonal = _cofactors(s0, s1, s2, s3, s4, order)
    if count < fewest or not determinant > SINGULAR * diagonal:
        result[0, slot] = result[1, slot] = result[2, slot] = np.nan
        return
    scale = 1 / (determinant * np.sqrt(1 / weight + c0 / determinant))
    result[0, slot] = -(c0 * x0 + c1 * x1 + c2 * x2) * scale
    result[1, slot] = -(c0 * y0 + c1 * y1 + c2 * y2) * scale
    result[2, slot] = -(c0 * z0 + c1 * z1 + c2 * z2) * scale
