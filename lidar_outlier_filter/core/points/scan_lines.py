# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points → scan lines → line segments (Leslar 2010, section 3)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.kernels.kernels import device_function, kernel, median
from lidar_outlier_filter.core.points.points import Points

# Radians. Steps up to here may be noise: laser beams of one shot lie side by side, and coordinates
# of near points are rounded.
NOISE = np.pi / 6
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
        order, first, back = _count_lines(line, t, low, high - low + 1)
        if len(back) <= FEW_LINES:
            # Of rows of a range image, each is in two pieces: numpy joins them.
            for begin, end in zip(first[back], first[back + 1], strict=True):
                part = order[begin:end]
                order[begin:end] = part[np.argsort(t[part], kind='stable')]
            return order
    return np.lexsort((t, line)).astype(np.int64)


@kernel
def is_unchanged(order: NDArray[np.int64]) -> bool:
    """Return whether an order leaves everything where it is."""
    for i in range(len(order)):  # noqa: SIM110  a kernel
        if order[i] != i:
            return False
    return True


def find_lines(points: Points, gap_factor: float) -> Lines:
    """Find lines and segments of points that are sorted by line and time.

    A segment ends where the next shot is more than ``gap_factor`` × the line's own shot interval
    later; a gap of exactly that length does not end it.
    """
    first = line_starts(points.line)
    interval, before, after = _link(points.t, first, gap_factor)
    return Lines(first, interval, before, after)


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


@kernel
def _count_lines(
    line: NDArray[np.int64], t: NDArray[np.int64], low: int, count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Sort stably by line with a counting sort.

    Returns the order, where each line begins in it, and which lines go back in time.
    """
    first = np.zeros(count + 1, np.int64)
    for i in range(len(line)):
        first[line[i] - low + 1] += 1
    for j in range(count):
        first[j + 1] += first[j]
    order, back = np.empty(len(line), np.int64), np.zeros(count, np.bool_)
    rank, latest = first.copy(), np.full(count, t.min())
    for i in range(len(line)):
        j = line[i] - low
        order[rank[j]] = i
        rank[j] += 1
        back[j] |= t[i] < latest[j]
        latest[j] = t[i]
    return order, first, np.flatnonzero(back)


@kernel
def _link(
    t: NDArray[np.int64], first: NDArray[np.int64], gap_factor: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Join neighbours of one line unless a gap parts them."""
    lines = len(first) - 1
    interval = np.zeros(lines)
    before = np.full(len(t), -1, np.int64)
    after = np.full(len(t), -1, np.int64)
    differences = np.empty(len(t))
    for line in range(lines):
        begin, end = first[line], first[line + 1]
        count = 0
        for i in range(begin + 1, end):
            if t[i] > t[i - 1]:
                differences[count] = t[i] - t[i - 1]
                count += 1
        if count:
            interval[line] = median(differences, count)
        longest = gap_factor * interval[line]
        for i in range(begin + 1, end):
            if t[i] - t[i - 1] <= longest:
                after[i - 1] = i
                before[i] = i - 1
    return interval, before, after


class LineCounter:
    """Numbers the scan lines of a sensor that does not number them itself."""

    def __init__(self) -> None:
        """Begin before the first line."""
        self._line = 0
        self.reset()

    def reset(self) -> None:
        """Forget the angles so far: what comes has nothing to do with them."""
        self._turn = (np.nan, np.nan, 0.0)

    def next_line(self, count: int) -> NDArray[np.int64]:
        """Begin a new line of ``count`` points."""
        self._line += 1
        return np.full(count, self._line)

    def by_angle(self, angle: NDArray[np.float64], valid: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Begin a new line at each turn of the scan angle.

        A line begins where the angle wraps (steps by more than half a turn), or steps back against
        the sense of rotation by more than ``NOISE`` (after gaps over half a turn). Smaller steps
        back are noise, and do not repeat a wrap. The sense is known once the small steps add up to
        ``NOISE``; before that, only wraps count.

        Parameters
        ----------
        angle : (N,) float64
            Radians, in order of measurement.
        valid : (N,) bool
            False where the angle means nothing. Such a point belongs to the line it is in, as does
            one whose angle is not finite.

        """
        line, self._line, *turn = _count_turns(angle, valid, self._line, *self._turn)
        self._turn = (turn[0], turn[1], turn[2])
        return line


@kernel
def _count_turns(
    angle: NDArray[np.float64],
    valid: NDArray[np.bool_],
    line: int,
    before: float,
    furthest: float,
    travel: float,
) -> tuple[NDArray[np.int64], int, float, float, float]:
    """Count the turns; ``travel`` is the sum of the small steps so far, within half a turn."""
    result = np.empty(len(angle), np.int64)
    for i in range(len(angle)):
        if valid[i] and np.isfinite(angle[i]):
            # The first angle ever is no wrap: a comparison with NaN is false.
            step = _wrapped(angle[i] - before)
            sense = 0.0 if abs(travel) < NOISE else np.sign(travel)
            ahead = sense * _wrapped(angle[i] - furthest)
            if sense * step < -NOISE:
                line += 1
                furthest = angle[i]
            elif sense == 0 or not -NOISE <= ahead <= 0:
                line += abs(angle[i] - furthest) > np.pi
                furthest = angle[i]
            if abs(step) <= NOISE:
                travel = min(max(travel + step, -np.pi), np.pi)
            before = angle[i]
        result[i] = line
    return result, line, before, furthest, travel


@device_function
def _wrapped(step: float) -> float:
    """Return the shorter way round; half a turn keeps its sign."""
    if step > np.pi:
        return step - 2 * np.pi
    return step + 2 * np.pi if step < -np.pi else step
