# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points in cells: sorted by line and phase, with empty cells around each line.

Phase is the angle that the head, or the mirror, has turned.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints, Singles

SAME_SHOT = _kernels.SAME_SHOT  # rad: nearer than that, two returns of a ring are of one beam


class OrderedLines(NamedTuple):
    """Points as given, and their order by line.

    Attributes
    ----------
    xyz, distance : (N, 3), (N,) float64
        As given, metres.
    order : (N,) int64
        The index, as given, of each point sorted by line.
    first : (L + 1,) int64
        Where each line begins in the order.

    """

    xyz: Floats
    distance: Floats
    order: Ints
    first: Ints


def sort_lines(lines: OrderedLines, begin: int, end: int, phase: Floats, up: Floats) -> None:
    """Sort each line by phase; of one phase, by range and position, whatever the order given.

    Lines are nearly sorted, where the head turns steadily: then few returns move, and not far.
    """
    xyz, distance, order, first = lines
    for line in _kernels.sort_nearly(lines, begin, end, phase, up):
        part = slice(first[line], first[line + 1])
        some = order[part]
        rank = np.lexsort((*xyz[some].T[::-1], distance[some], phase[part]))
        order[part], phase[part], up[part] = some[rank], phase[part][rank], up[part][rank]


UNKNOWN_BRIGHTNESS = np.float32(_kernels.UNKNOWN_BRIGHTNESS)
STRETCH = 24  # cells on either side of a point: the reach of windows along a line
PAD = _kernels.LANES + STRETCH  # cells: as many as are read side by side, and their reach
NO_PHASE_RAD = 1e9  # rad: the phase where there is no point
LINES_AT_ONCE = 4  # lines that a thread takes of long work
POINTS_AT_ONCE = 32_768  # points that a thread takes of short work: fewer are done before it wakes


class Pattern(NamedTuple):
    """N points sorted by ring, from below, and azimuth, in M cells.

    Around the rings are ``PAD`` cells without a point, whose phase is far away from any other.

    Attributes
    ----------
    order : (M,) int64
        The index, as given, of each; -1 for none.
    copies : (C, 2) int64
        Indices, as given, of returns that have no cell, because another return of the same shot
        lies at the very same point; and of that.
    first, last : (L,) int64
        Where each ring begins, and the cell behind its end.
    x, y, z, range : (M,) float32
        Metres, about a point near them.
    phase : (M,) float64
        Rad turned, never falling along a ring. Of a spinning sensor their differences are exact.
    bright : (2, M) float32
        Intensity ÷ what is usual at the range, and the share of points with less intensity ×
        range²; -1 where it is not known.
    step, gap : (L,) float32
        Angle between shots of the ring, and to the nearer ring beside it, rad.
    turn : (L,) float32
        How much the head turns while a beam of the ring moves by 1 rad: more the steeper it is.
    beside : (4, L) float32
        Angles to the second ring below, the one below, the one above and the second above, rad; any
        where there is no such ring.
    uneven : (L,) float32
        Angle to the farther ring beside it ÷ that to the nearer.
    noise, apart : (L,) float32
        Metres that are added to range × step, and to range × gap: no range is better, and the
        sensor may have moved from one line to the next.
    level : (L,) float32
        Metres that ranges may differ by, and still be the same.

    """

    order: Ints
    copies: Ints
    first: Ints
    last: Ints
    x: Singles
    y: Singles
    z: Singles
    range: Singles
    phase: Floats
    bright: Singles
    step: Singles
    gap: Singles
    turn: Singles
    beside: Singles
    uneven: Singles
    noise: Singles
    apart: Singles
    level: Singles


def lines_at_once(lines: int, points: int) -> int:
    """Return how many of the lines of so many points a thread takes of short work."""
    return max(lines * POINTS_AT_ONCE // max(points, 1), 1)


def count_points(pattern: Pattern) -> int:
    """Count the points of a pattern, copies included."""
    return int(np.count_nonzero(pattern.order >= 0)) + len(pattern.copies)


def spread(pattern: Pattern, values: NDArray[Any], out: NDArray[Any]) -> None:
    """Write values of cells (M,) to their points (N,), in the order given, copies included."""
    there = pattern.order >= 0
    out[pattern.order[there]] = values[there]
    fill_copies(pattern, out)


def fill_copies(pattern: Pattern, out: NDArray[Any]) -> None:
    """Give copies the values of their originals, in values of N points."""
    out[pattern.copies[:, 0]] = out[pattern.copies[:, 1]]


def make_pattern(sizes: Ints, copies: Ints | None = None, **of_lines: Singles) -> Pattern:
    """Make a pattern of lines of so many points, whose cells have no points yet."""
    begins = PAD + np.concatenate([[0], np.cumsum(sizes + PAD)])[:-1]
    count = int(sizes.sum()) + (len(sizes) + 1) * PAD
    return Pattern(
        order=np.full(count, -1),
        copies=np.empty((0, 2), np.int64) if copies is None else copies,
        first=begins,
        last=begins + sizes,
        x=np.zeros(count, np.float32),
        y=np.zeros(count, np.float32),
        z=np.zeros(count, np.float32),
        range=np.ones(count, np.float32),
        phase=np.full(count, NO_PHASE_RAD),
        bright=np.full((2, count), UNKNOWN_BRIGHTNESS, np.float32),
        **of_lines,
    )


def place(
    lines: OrderedLines, phase: Floats, rank: Ints, begin: int, end: int, placed: Pattern
) -> None:
    """Write a range of the lines, which are of a rank each, from the lowest on."""
    cells = (placed.order, placed.x, placed.y, placed.z, placed.range, placed.phase)
    _kernels.place_lines(lines, phase, rank, begin, end, (placed.first, placed.last, *cells))
