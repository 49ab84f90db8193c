# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The position of a profile scanner, estimated from its points, and the angle of its mirror.

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
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats, Ints

SAMPLES = 64  # returns of a line that show where the scanner is
FEWEST = 32  # returns of a line, fewer show nothing
KNOWN = 0.5  # share of the lines whose own returns must show the scanner's position
FITS = 3
NEAREST = 0.5  # m: what is nearer does not weigh more
UNEVEN = 0.5  # steps of the mirror that a typical return may be off its angle
FLAT = 0.02  # rad that a typical return of a typical line may be off its plane
UNSURE = 0.2  # m: standard deviation of the scanner's position
FINEST = 1024.0  # parts of a metre that the scanner's position is rounded to
AWAY = 0.01  # m: least range
TINY = np.finfo(np.float64).tiny
WITHIN = (np.arange(SAMPLES) + np.arange(SAMPLES) * 0.618 % 1.0) / SAMPLES  # of a line
LINES_AT_ONCE = 256  # that a thread fits


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
    some = begins[:, None] + np.arange(SAMPLES) * sizes[:, None] // SAMPLES
    parts = pool.run(
        lambda i, j: fit_lines(xyz[order[some[i:j]]], turned[some[i:j]]),
        *(len(sizes), LINES_AT_ONCE, threads),
    )
    fit = Fit(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    good = (fit.off <= UNEVEN * steps) & (fit.unsure <= UNSURE) & (sizes >= FEWEST)
    if np.count_nonzero(good) < KNOWN * len(sizes):
        return None
    # Unevenly taken, because of rings in turn even steps would take always the same one.
    some = begins[:, None] + (WITHIN * sizes[:, None]).astype(np.int64)
    away = pool.run(
        lambda i, j: off_plane(xyz[order[some[i:j]]] - fit.position[i:j, None], turned[some[i:j]]),
        *(len(sizes), LINES_AT_ONCE, threads),
    )
    if np.median(np.concatenate(away)[good]) > FLAT:
        return None
    known = good[rank]
    when = turns[rank]
    found = np.empty((len(sizes), 3))
    for axis in range(3):
        found[rank, axis] = np.interp(when, when[known], fit.position[rank, axis][known])
    return Scanner(np.rint(found * FINEST) / FINEST, turned)


class Fit(NamedTuple):
    """The scanner's position, as some returns of each of L lines show it.

    Attributes
    ----------
    position : (L, 3) float64
        Metres.
    off : (L,) float64
        Median angle between a return and where the mirror looked, rad; infinite where the returns
        all lie where the scanner is.
    unsure : (L,) float64
        Standard deviation of the position, metres.

    """

    position: Floats
    off: Floats
    unsure: Floats


def fit_lines(xyz: Floats, turned: Floats) -> Fit:
    """Fit the scanner's position to S returns (L, S, 3) of each line, at mirror angles (L, S)."""
    centre = xyz.mean(axis=1)
    at = np.ascontiguousarray(np.moveaxis(xyz - centre[:, None], 2, 0))
    _, axes = np.linalg.eigh(_gram(at))
    across = axes[:, :, 1:]  # the plane of the line
    x, y = ((across[:, :, k].T[..., None] * at).sum(axis=0) for k in range(2))
    # Which side of the plane is seen is not known: the mirror turns one way or the other.
    one, other = (_fit_plane(x, y, np.sin(sense * turned), np.cos(turned)) for sense in (1, -1))
    (east, north), off, unsure = (
        np.where(other.off < one.off, b, a) for a, b in zip(one, other, strict=True)
    )
    position = centre + east[:, None] * across[:, :, 0] + north[:, None] * across[:, :, 1]
    return Fit(position, off, unsure)


def _gram(rows: Floats) -> Floats:
    """Return the sums of products (L, U, U) of rows (U, L, S)."""
    # Each line by itself, whatever lines are beside it.
    return np.moveaxis((rows[:, None] * rows[None]).sum(axis=-1), -1, 0)


def _fit_plane(x: Floats, y: Floats, sine: Floats, cosine: Floats) -> Fit:
    """Fit the position in the plane (2, L) to returns (L, S) there, and mirror angles."""
    said = np.stack([x * sine - y * cosine, x * cosine + y * sine, -sine, cosine])
    weight = np.ones_like(x)
    for _ in range(FITS):
        values, vectors = np.linalg.eigh(_gram(weight * said))
        a, b, c, d = vectors[:, :, 0].T
        square = np.maximum(a * a + b * b, TINY)
        east, north = (c * a - d * b) / square, (c * b + d * a) / square
        far = np.hypot(x - east[:, None], y - north[:, None])
        weight = 1.0 / np.maximum(far, NEAREST)
    error, second = np.maximum(values[:, 0], 0.0), np.maximum(values[:, 1] * square, TINY)
    residual = np.abs((vectors[:, :, 0].T[..., None] * said).sum(axis=0)) * weight
    off = np.median(residual, axis=1) / np.sqrt(square)
    # Points that all lie where the scanner is fit any angle.
    off[~(np.median(far, axis=1) > AWAY)] = np.inf
    return Fit(np.stack([east, north]), off, np.sqrt(error / (x.shape[1] * second)))


def off_plane(xyz: Floats, turned: Floats) -> Floats:
    """Return how far S returns of each line (L, S, 3), from the scanner, are off a plane, rad.

    The median of the distances from the best plane ÷ range. The plane may move steadily along its
    normal as the mirror turns (L, S): a scanner that drives draws a screw.
    """
    far = np.sqrt((xyz**2).sum(axis=2))
    weight = 1.0 / np.maximum(far, NEAREST)
    since = turned - turned.mean(axis=1, keepdims=True)
    rows = np.stack([*np.moveaxis(xyz, 2, 0), np.ones_like(far), since]) * weight
    gram = _gram(rows)
    moved = np.linalg.pinv(gram[:, 3:, 3:]) @ gram[:, 3:, :3]  # what shift and drive explain
    left = gram[:, :3, :3] - gram[:, :3, 3:] @ moved
    normal = np.linalg.eigh(left)[1][:, :, 0]
    plane = np.concatenate([normal, -(moved @ normal[..., None])[..., 0]], axis=1)
    off: Floats = np.median(np.abs((plane.T[..., None] * rows).sum(axis=0)), axis=1)
    return off
