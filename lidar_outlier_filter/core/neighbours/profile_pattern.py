# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The scan pattern of a profile scanner, whose lines are revolutions of its mirror.

The lines stand for a spinning sensor's rings, and the angle of the mirror for the
azimuth. Points may be in any frame: the scanner's position is found from the points. The mirror
turns evenly, so the angle of each shot is known from its time, up to a constant; and seen from the
scanner, all points of a line are where these angles say, however far they are.

With x and y in the plane of a line, the scanner at s and a mirror angle φ + δ, each point says

    (x - s_x) sin(φ + δ) = (y - s_y) cos(φ + δ)

which is linear in sin δ, cos δ and two products of them with s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.neighbours.placed_pattern import (
    LINES_AT_ONCE,
    Pattern,
    Spacing,
    make_pattern,
    place,
)
from lidar_outlier_filter.core.neighbours.scan_pattern import TURN
from lidar_outlier_filter.core.neighbours.sorted_lines import OrderedLines, sort_lines
from lidar_outlier_filter.core.points.scan_lines import (
    is_interleaved,
    line_starts,
    order_by_line,
)

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Ints, Singles
    from lidar_outlier_filter.core.points.points import Points

FEWEST_LINES = 2
SAMPLES = 64  # returns of a line that show where the scanner is
FEWEST = 32  # returns of a line, fewer show nothing
KNOWN = 0.5  # share of the lines whose own returns must show the scanner's position
FITS = 3
NEAREST = 0.5  # m: what is nearer does not weigh more
UNEVEN = 0.5  # steps of the mirror that a typical return may be off its angle
UNSURE = 0.2  # m: standard deviation of the scanner's position
# Of a step, in which angles are measured: no return is exactly as far as windows reach.
MORE = 1.01
FINEST = 1024.0  # parts of a metre that the scanner's position is rounded to
MAD_TO_SIGMA = 1.4826
SIGMA_FLOOR = 0.002  # metres
NOISE, LEVEL = 2.0, 4.0  # standard deviations of ranges
AWAY = 0.01  # m: least range


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


def find_profile_pattern(points: Points, threads: int = 0) -> Pattern | None:
    """Sort points by line and mirror angle.

    Parameters
    ----------
    points : valid ones, in any frame
    threads : at most so many at once; 0 for as many as there are cores

    Returns
    -------
    Pattern or None
        None where the points have no such pattern: there are too few lines, several are measured
        at once, or the points do not lie where an evenly turning mirror sees them.

    """
    order = order_by_line(points)
    first = line_starts(points.line[order])
    t = points.t[order]
    lines = len(first) - 1
    if lines < FEWEST_LINES or is_interleaved(t, first):
        return None
    # Lines in order of time, whatever their numbers.
    rank = np.argsort(t[first[:-1]], kind='stable')
    scanner = find_scanner(points.xyz, t, order, first, rank)
    if scanner is None:
        return None
    distance, phase = np.empty(len(points)), scanner.turned
    ordered = OrderedLines(points.xyz, distance, order, first)

    def prepare(begin: int, end: int) -> None:
        _look(points.xyz, scanner.position, order, first, begin, end, distance)
        # Only returns of one time change cells, and their angles are the same.
        sort_lines(ordered, begin, end, phase, phase)

    pool.run(prepare, lines, LINES_AT_ONCE, threads)
    steps = phase[1:] - phase[:-1]
    steps = steps[steps > 0.0]
    step = np.full(lines, MORE * np.median(steps) if len(steps) else TURN, np.float32)
    noise = np.full(lines, NOISE * _sigma(distance[order], phase, first), np.float32)
    found = make_pattern(
        np.diff(first)[rank],
        _space_out(step),
        noise,
        noise + _moved(scanner.position[rank]).astype(np.float32),
        noise * np.float32(LEVEL / NOISE),
    )
    pool.run(
        lambda i, j: place(ordered, phase, rank, i, j, found),
        lines,
        LINES_AT_ONCE,
        threads,
    )
    return found


def _space_out(step: Singles) -> Spacing:
    """Return the spacing of lines that are as far apart as their shots."""
    one = np.ones_like(step)
    return Spacing(step, step, one, np.stack([2 * step, step, step, 2 * step]), one)


def find_scanner(xyz: Floats, t: Ints, order: Ints, first: Ints, rank: Ints) -> Scanner | None:
    """Find where the scanner was, None where that does not show.

    Parameters
    ----------
    xyz : (N, 3) of points as given, metres
    t : (N,) of points in order, nanoseconds
    order : (N,) by line and time
    first : (L + 1,) where lines begin
    rank : (L,) the order of the lines in time

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
    some = begins[:, None] + np.arange(SAMPLES) * sizes[:, None] // SAMPLES
    steps = np.median(np.diff(t)[t[1:] > t[:-1]]) * (TURN / period) if len(t) > 1 else 0.0
    fit = _fit(xyz[order[some]], turned[some])
    good = (sizes >= FEWEST) & (fit.off <= UNEVEN * steps) & (fit.unsure <= UNSURE)
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
        Median angle between a return and where the mirror looked, rad.
    unsure : (L,) float64
        Standard deviation of the position, metres.

    """

    position: Floats
    off: Floats
    unsure: Floats


def _fit(xyz: Floats, turned: Floats) -> Fit:
    """Fit the scanner's position to S returns of L lines: (L, S, 3), (L, S)."""
    centre = xyz.mean(axis=1)
    about = xyz - centre[:, None]
    _, vector = np.linalg.eigh(about.swapaxes(1, 2) @ about)
    first, second = vector[:, :, 2], vector[:, :, 1]
    along = about @ vector
    x, y = along[:, :, 2], along[:, :, 1]
    sine, cosine = np.sin(turned), np.cos(turned)
    # Which side of the plane is seen is not known: the mirror turns one way or the other. Both are
    # tried at once, because each call takes its time however few lines there are.
    twice = np.concatenate([x, x]), np.concatenate([y, y])
    fits = _fit_plane(*twice, np.concatenate([sine, -sine]), np.concatenate([cosine, cosine]))
    count = len(xyz)
    better = fits[2][:count] <= fits[2][count:]
    east, north, off, unsure = (np.where(better, fit[:count], fit[count:]) for fit in fits)
    position = centre + east[:, None] * first + north[:, None] * second
    return Fit(position, off, unsure)


def _fit_plane(
    x: Floats, y: Floats, sine: Floats, cosine: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the scanner's x and y, how far returns are off, and how unsure the position is."""
    rows = np.stack([x * sine - y * cosine, x * cosine + y * sine, -sine, cosine], axis=2)
    weight = np.ones_like(x)
    count = x.shape[1]
    for _ in range(FITS):
        weighted = rows * weight[:, :, None]
        value, vector = np.linalg.eigh(weighted.swapaxes(1, 2) @ weighted)
        a, b, c, d = vector[:, :, 0].T
        square = np.maximum(a * a + b * b, np.finfo(float).tiny)
        east, north = (c * a - d * b) / square, (c * b + d * a) / square
        far = np.sqrt((x - east[:, None]) ** 2 + (y - north[:, None]) ** 2)
        weight = 1.0 / np.maximum(far, NEAREST)
    residual = (rows @ vector[:, :, :1])[:, :, 0] * weight
    off = _medians(np.abs(residual)) / np.sqrt(square)
    # Points that all lie where the scanner is fit any angle.
    off = np.where(_medians(far) > AWAY, off, np.inf)
    least = np.maximum(value[:, 1] * square, np.finfo(float).tiny)
    return east, north, off, np.sqrt(np.maximum(value[:, 0], 0.0) / (count * least))


def _medians(rows: Floats) -> Floats:
    """Return the median of each row, as numpy's, which takes twice as long for short ones."""
    low, high = (rows.shape[1] - 1) // 2, rows.shape[1] // 2
    ranked = np.partition(rows, (low, high), axis=1)
    found: Floats = (ranked[:, low] + ranked[:, high]) / 2.0
    return found


def _moved(where: Floats) -> Floats:
    """Return how far the scanner moved to the nearer of the lines before and after, metres."""
    away = np.sqrt(((where[1:] - where[:-1]) ** 2).sum(axis=1))
    nearer: Floats = np.minimum(np.append(away, np.inf), np.append(np.inf, away))
    return nearer


def _sigma(reach: Floats, phase: Floats, first: Ints) -> float:
    """Return the standard deviation of ranges, metres, typical of all lines.

    By the differences from what the neighbours in the line predict, of some returns.
    """
    sizes = np.diff(first)
    inner = first[:-1, None] + 1 + np.arange(SAMPLES) * (sizes[:, None] - 2) // SAMPLES
    some = inner[sizes >= FEWEST].ravel()
    span = phase[some + 1] - phase[some - 1]
    part = (phase[some] - phase[some - 1]) / np.where(span > 0.0, span, 1.0)
    value = (1.0 - part) / reach[some - 1] + part / reach[some + 1]
    # Of a plane, the inverse range is a sine: between two others it is more than a line.
    curved = part * (1.0 - part) * span**2 / 2.0
    size = np.sqrt(1.0 + (1.0 - part) ** 2 + part**2)
    off = np.abs(reach[some] * (1.0 - reach[some] * value - curved)) / size
    return max(MAD_TO_SIGMA * float(np.median(off)), SIGMA_FLOOR)


@kernel
def _look(
    xyz: Floats,
    where: Floats,
    order: Ints,
    first: Ints,
    begin: int,
    end: int,
    distance: Floats,
) -> None:
    """Write the ranges of the points of lines begin to end, in the order given."""
    for line in range(begin, end):
        x, y, z = where[line]
        for k in range(first[line], first[line + 1]):
            i = order[k]
            dx, dy, dz = xyz[i, 0] - x, xyz[i, 1] - y, xyz[i, 2] - z
            distance[i] = max(np.sqrt(dx * dx + dy * dy + dz * dz), AWAY)
