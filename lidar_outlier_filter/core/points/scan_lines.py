# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points → scan lines → line segments (Leslar 2010, section 3)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.points.points import Points

# Radians. Steps up to here may be noise: laser beams of one shot lie side by side, and coordinates
# of near points are rounded.
NOISE_RAD = np.pi / 6
FEW_LINES = 1024  # that go back in time: more are sorted at once
MAX_RETURNS = 15  # of a shot
MAX_SHARED = 1.5  # points of a line ÷ its times, from which on points share times, not shots
INTERLEAVED = 2.0  # lines that are measured at once, on average, from which on a sensor spins


@dataclass(frozen=True)
class Lines:
    """The order of N points along their scan lines.

    Attributes
    ----------
    first : (L + 1,) int64
        Where each line begins in the sorted points; the last entry is N.
    interval : (L,) float64
        Shot interval of each line, nanoseconds: the median of its positive time differences; 0 for
        a line that has none.
    before, after : (N,) int64
        Neighbour of each point in its line segment, in front and behind; -1 at the segment's ends.

    """

    first: NDArray[np.int64]
    interval: NDArray[np.float64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]


def order_by_line(points: Points) -> NDArray[np.int64]:
    """Return the order of the points by line, then time, then arrival."""
    line, t = points.line, points.t
    if not len(t):
        return np.empty(0, np.int64)
    low, high = int(line.min()), int(line.max())
    # Lines are numbered densely in all but odd streams: counting beats sorting there.
    if high - low <= 4 * len(t) + 1024:
        order, first = np.empty(len(t), np.int64), np.empty(high - low + 2, np.int64)
        back = _kernels.sort_by_line(line, t, low, order, first)
        if len(back) <= FEW_LINES:
            # Of rows of a range image, each is in two pieces: numpy joins them.
            for begin, end in zip(first[back], first[back + 1], strict=True):
                part = order[begin:end]
                order[begin:end] = part[np.argsort(t[part], kind='stable')]
            return order
    return np.lexsort((t, line)).astype(np.int64)


def find_lines(points: Points, gap_factor: float) -> Lines:
    """Find lines and segments of points that are sorted by line and time.

    A segment ends where the next shot is more than ``gap_factor`` × the line's own shot interval
    later; a gap of exactly that length does not end it.
    """
    first = line_starts(points.line)
    lines = Lines(
        first,
        interval=np.empty(len(first) - 1),
        before=np.empty(len(points), np.int64),
        after=np.empty(len(points), np.int64),
    )
    _kernels.link_lines(points.t, first, gap_factor, lines.interval, lines.before, lines.after)
    return lines


def line_starts(line: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return where each line begins in points sorted by line, then the number of points."""
    if not len(line):
        return np.zeros(1, np.int64)
    inner = np.flatnonzero(line[1:] != line[:-1]) + 1
    return np.concatenate(([0], inner, [len(line)])).astype(np.int64)


class ShotReturns(NamedTuple):
    """Which points, sorted by line and time, are returns of the same shots.

    Attributes
    ----------
    number : (N,) int64
        Of each point among the returns of its shot, in the order given, from 0.
    shot : (N,) int64
        The first return of its shot.
    original : (N,) int64
        The return of its shot that lies where each point lies; most often the point itself.

    """

    number: NDArray[np.int64]
    shot: NDArray[np.int64]
    original: NDArray[np.int64]


def find_returns(points: Points) -> ShotReturns | None:
    """Find shots with several returns; None where no points of a line share a time.

    Points are sorted by line and time. Where most points of a line share their times with others,
    elsewhere, the clock is too coarse to tell shots apart: then each point is a shot.
    """
    follows = (points.line[1:] == points.line[:-1]) & (points.t[1:] == points.t[:-1])
    if not follows.any():
        return None
    index, begins = np.arange(len(points)), np.append([True], ~follows)
    shot = np.maximum.accumulate(np.where(begins, index, 0))
    original = index.copy()
    line = np.cumsum(np.append([0], points.line[1:] != points.line[:-1]))
    coarse = np.bincount(line, index - shot >= MAX_RETURNS) > 0
    some = np.flatnonzero((index > shot) & ~coarse[line])
    for back in range(1, MAX_RETURNS):
        later = some[index[some] - shot[some] >= back]
        same = later[(points.xyz[later] == points.xyz[later - back]).all(axis=1)]
        original[same] = same - back
    new = original == index
    coarse |= np.bincount(line, new) > MAX_SHARED * np.bincount(line, begins)
    alone = coarse[line]
    shot[alone], original[alone] = index[alone], index[alone]
    number = np.cumsum(original == index)
    return ShotReturns(number - number[shot], shot, original)


def is_interleaved(t: NDArray[np.int64], first: NDArray[np.int64]) -> bool:
    """Return whether the sensor spins, by points that are sorted by line and time.

    A profile scanner measures one line after the other; a spinning sensor, many at once. ``first``
    is where each line begins.
    """
    begins, ends = t[first[:-1]], t[first[1:] - 1]
    return bool((ends - begins).sum() > INTERLEAVED * (ends.max() - begins.min()))


def has_lines(points: Points) -> bool:
    """Return whether points have scan lines: several of them, or one along which time passes."""
    return bool(np.ptp(points.line) > 0 or np.ptp(points.t) > 0) if len(points) else False


class LineCounter:
    """Numbers the scan lines of a sensor that does not number them itself."""

    def __init__(self) -> None:
        self._line = 0
        self.reset()

    def reset(self) -> None:
        """Forget the angles so far: what comes has nothing to do with them."""
        # The last angle, the furthest in the sense of rotation, and the sum of the small steps.
        self._turn = (np.nan, np.nan, 0.0)

    def next_line(self, count: int) -> NDArray[np.int64]:
        """Begin a new line of ``count`` points."""
        self._line += 1
        return np.full(count, self._line)

    def by_angle(self, angle: NDArray[np.float64], valid: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Begin a new line at each turn of the scan angle.

        A line begins where the angle wraps (steps by more than half a turn), or steps back against
        the sense of rotation by more than ``NOISE_RAD`` (after gaps over half a turn). Smaller
        steps back are noise, and do not repeat a wrap. The sense is known once the small steps add
        up to ``NOISE_RAD``; before that, only wraps count.

        Parameters
        ----------
        angle : (N,) float64
            Radians, in order of measurement.
        valid : (N,) bool
            False where the angle means nothing. Such a point belongs to the line it is in, as does
            one whose angle is not finite.

        """
        line = np.empty(len(angle), np.int64)
        self._line, *turn = _kernels.count_turns(
            angle, valid, NOISE_RAD, self._line, self._turn, line
        )
        self._turn = (turn[0], turn[1], turn[2])
        return line
