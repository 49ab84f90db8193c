# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where a profile scanner was, found from its points, and how far its mirror had turned.

The mirror turns evenly, so the angle of each shot is known from its time, up to a constant; and
seen from the scanner, all points of a line are where these angles say, however far they are.

With x and y in the plane of a line, the scanner at s and a mirror angle φ + δ, each point says

    (x - s_x) sin(φ + δ) = (y - s_y) cos(φ + δ)

which is linear in sin δ, cos δ and two products of them with s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.jacobi import eigen, find_least
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel, median
from lidar_outlier_filter.core.scan_pattern.placed_pattern import lines_at_once
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Ints

SAMPLES = 64  # returns of a line that show where the scanner is
FEWEST = 32  # returns of a line, fewer show nothing
KNOWN = 0.5  # share of the lines whose own returns must show the scanner's position
FITS = 3
NEAREST = 0.5  # m: what is nearer does not weigh more
UNEVEN = 0.5  # steps of the mirror that a typical return may be off its angle
UNSURE = 0.2  # m: standard deviation of the scanner's position
FINEST = 1024.0  # parts of a metre that the scanner's position is rounded to
AWAY = 0.01  # m: least range
TINY = np.finfo(np.float64).tiny
UNKNOWNS = 4


class Scanner(NamedTuple):
    """Where a profile scanner was.

    Attributes
    ----------
    position : (L, 3) float64
        Of each line, metres.
    turned : (N,) float64
        Mirror angle of each point, sorted by line and time, since the same constant, rad.

    """

    position: Floats
    turned: Floats


def find_scanner(
    xyz: Floats, t: Ints, order: Ints, first: Ints, rank: Ints, threads: int = 0
) -> Scanner | None:
    """Find where the scanner was, None where that does not show.

    Parameters
    ----------
    xyz : (N, 3) of points as given, metres
    t : (N,) of points in order, nanoseconds
    order : (N,) by line and time
    first : (L + 1,) where lines begin
    rank : (L,) the order of the lines in time
    threads : at most so many at once; 0 for as many as there are cores

    """
    begins, sizes = first[:-1], np.diff(first)
    if np.count_nonzero(sizes >= FEWEST) < KNOWN * len(sizes):
        return None
    period = float(np.median(np.diff(t[begins][rank])))
    if not period > 0.0:
        return None
    middle = t[begins + sizes // 2]
    # A line without returns leaves out a turn.
    turns = np.empty(len(sizes))
    turns[rank] = np.cumsum([0.0, *np.maximum(np.rint(np.diff(middle[rank]) / period), 1.0)])
    since = (t - t[begins[rank[0]]]).astype(np.float64) - np.repeat(turns * period, sizes)
    turned = since * (TURN / period)
    turned -= turned.min()
    passed = np.diff(t)
    steps = np.median(passed[passed > 0]) * (TURN / period) if len(t) > 1 else 0.0
    fit = Fit(np.empty((len(sizes), 3)), np.empty(len(sizes)), np.empty(len(sizes)))
    pool.run(
        lambda i, j: fit_lines(xyz, turned, order, first, i, j, fit),
        len(sizes),
        lines_at_once(len(sizes), len(t)),
        threads,
    )
    good = (fit.off <= UNEVEN * steps) & (fit.unsure <= UNSURE)
    if np.count_nonzero(good) < KNOWN * len(sizes):
        return None
    known = good[rank]
    when = turns[rank]
    found = np.empty((len(sizes), 3))
    for axis in range(3):
        found[rank, axis] = np.interp(when, when[known], fit.position[rank, axis][known])
    return Scanner(np.rint(found * FINEST) / FINEST, turned)


class Fit(NamedTuple):
    """What some returns of each line show.

    Attributes
    ----------
    position : (L, 3) float64
        Where the scanner is, metres.
    off : (L,) float64
        Median angle between a return and where the mirror looked, rad; infinite where the line has
        too few returns, or where they all lie where the scanner is.
    unsure : (L,) float64
        Standard deviation of the position, metres.

    """

    position: Floats
    off: Floats
    unsure: Floats


class Room(NamedTuple):
    """Room to work in, for one thread: of ``SAMPLES`` returns each.

    Attributes
    ----------
    at : (3, SAMPLES) float64
        Metres from their centre.
    x, y : (SAMPLES,) float64
        The same, in the plane of the line.
    sine, cosine : (SAMPLES,) float64
        Of the angle of the mirror.
    far, weight : (SAMPLES,) float64
        Metres from the scanner, and how much each counts.
    normal, vectors : (UNKNOWNS, UNKNOWNS) float64

    """

    at: Floats
    x: Floats
    y: Floats
    sine: Floats
    cosine: Floats
    far: Floats
    weight: Floats
    normal: Floats
    vectors: Floats


@kernel
def fit_lines(
    xyz: Floats, turned: Floats, order: Ints, first: Ints, begin: int, end: int, found: Fit
) -> None:
    """Fit the scanner's position to some returns of each of the lines begin to end."""
    row, square = np.empty((6, SAMPLES)), np.empty((2, UNKNOWNS, UNKNOWNS))
    x, y, sine, cosine, far, weight = row[0], row[1], row[2], row[3], row[4], row[5]
    room = Room(np.empty((3, SAMPLES)), x, y, sine, cosine, far, weight, square[0], square[1])
    for line in range(begin, end):
        low, size = first[line], first[line + 1] - first[line]
        found.position[line], found.off[line], found.unsure[line] = 0.0, np.inf, np.inf
        if size < FEWEST:
            continue
        some = order[low + np.arange(SAMPLES) * size // SAMPLES]
        for s in range(SAMPLES):
            angle = turned[low + s * size // SAMPLES]
            sine[s], cosine[s] = np.sin(angle), np.cos(angle)
        centre = _centre(xyz, some, room.at)
        across = _lay_flat(room)
        # Which side of the plane is seen is not known: the mirror turns one way or the other.
        for _ in range(2):
            east, north, off, unsure = _fit_plane(room)
            if off < found.off[line]:
                found.off[line], found.unsure[line] = off, unsure
                for axis in range(3):
                    along = east * across[0, axis] + north * across[1, axis]
                    found.position[line, axis] = centre[axis] + along
            for s in range(SAMPLES):
                sine[s] = -sine[s]


@inner_kernel
def _centre(xyz: Floats, some: Ints, at: Floats) -> Floats:
    """Write some points, from the mean of them all; return that."""
    centre = np.zeros(3)
    for i in some:
        for axis in range(3):
            centre[axis] += xyz[i, axis]
    for axis in range(3):
        centre[axis] /= len(some)
        for s in range(len(some)):
            at[axis, s] = xyz[some[s], axis] - centre[axis]
    return centre


@inner_kernel
def _lay_flat(room: Room) -> Floats:
    """Write where returns are in the plane that fits them best; return its two axes."""
    at, normal, vectors = room.at, room.normal, room.vectors
    for i in range(3):
        for j in range(3):
            total = 0.0
            for s in range(SAMPLES):
                total += at[i, s] * at[j, s]
            normal[i, j] = total
    eigen(normal, vectors, 3)
    least = find_least(normal, 3)
    across = np.empty((2, 3))
    for axis in range(3):
        across[0, axis] = vectors[axis, (least + 1) % 3]
        across[1, axis] = vectors[axis, (least + 2) % 3]
    for s in range(SAMPLES):
        x, y, z = at[0, s], at[1, s], at[2, s]
        room.x[s] = x * across[0, 0] + y * across[0, 1] + z * across[0, 2]
        room.y[s] = x * across[1, 0] + y * across[1, 1] + z * across[1, 2]
    return across


@inner_kernel
def _fit_plane(room: Room) -> tuple[float, float, float, float]:
    """Return the scanner's x and y, how far returns are off, and how unsure the position is."""
    x, y, sine, cosine, far, weight = room.x, room.y, room.sine, room.cosine, room.far, room.weight
    normal, vectors = room.normal, room.vectors
    east = north = square = 0.0
    least = 0
    weight[:] = 1.0
    for _ in range(FITS):
        _sum_normal(room)
        eigen(normal, vectors, UNKNOWNS)
        least = find_least(normal, UNKNOWNS)
        a, b, c, d = vectors[0, least], vectors[1, least], vectors[2, least], vectors[3, least]
        square = max(a * a + b * b, TINY)
        east, north = (c * a - d * b) / square, (c * b + d * a) / square
        for s in range(SAMPLES):
            far[s] = np.sqrt((x[s] - east) ** 2 + (y[s] - north) ** 2)
            weight[s] = 1.0 / max(far[s], NEAREST)
    second = np.inf
    for i in range(UNKNOWNS):
        if i != least:
            second = min(second, normal[i, i])
    error = max(normal[least, least], 0.0)
    unsure = np.sqrt(error / (SAMPLES * max(second * square, TINY)))
    # Points that all lie where the scanner is fit any angle.
    if not median(far, SAMPLES) > AWAY:
        return east, north, np.inf, unsure
    for s in range(SAMPLES):
        one, other = x[s] * sine[s] - y[s] * cosine[s], x[s] * cosine[s] + y[s] * sine[s]
        far[s] = abs(a * one + b * other - c * sine[s] + d * cosine[s]) * weight[s]
    return east, north, median(far, SAMPLES) / np.sqrt(square), unsure


@inner_kernel
def _sum_normal(room: Room) -> None:
    """Sum up what the weighted returns say of the four unknowns."""
    normal = room.normal
    normal[:] = 0.0
    for s in range(SAMPLES):
        w, sine, cosine = room.weight[s], room.sine[s], room.cosine[s]
        row = (
            w * (room.x[s] * sine - room.y[s] * cosine),
            w * (room.x[s] * cosine + room.y[s] * sine),
            w * -sine,
            w * cosine,
        )
        for i in range(UNKNOWNS):
            for j in range(i + 1):
                normal[i, j] += row[i] * row[j]
    for i in range(UNKNOWNS):
        for j in range(i):
            normal[j, i] = normal[i, j]
