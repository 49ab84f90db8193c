# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Times that several shots share: of a packet, a column, a line, or of a coarse clock.

The order of the points tells the shots of one time apart, where it is that of the shots.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Ints

MIN_SHOTS = 3  # of a tick: two points of one time may be two returns of a shot
MIN_SHARE_OF_SHOTS = 0.5  # of the shots have the time of the one before: the clock is coarse
FULL_TICKS = 90  # percentile of the shots of ticks: most ticks are full, and rarely two are one


class Clock(NamedTuple):
    """How a coarse clock counts.

    Attributes
    ----------
    share : of the shots that have the time of the one before, 0 to 1
    tick : from one time to the next, nanoseconds; 0 where all times are equal
    shots : of a full tick; 1 where few shots share a time

    """

    share: float
    tick: int
    shots: int


def measure_clock(t: Ints, begins: Bools | None = None) -> Clock:
    """Measure how many shots share a time.

    Parameters
    ----------
    t : (N,) int64
        Nanoseconds, in the order of the shots.
    begins : (N,) bool
        Whether each point is the first return of its shot; None: each one is.

    """
    times = t if begins is None else t[begins]
    if len(times) < 2:  # noqa: PLR2004  no pair
        return Clock(0.0, 0, 1)
    first = np.flatnonzero(np.append([True], times[1:] != times[:-1]))
    share = 1.0 - (len(first) - 1) / (len(times) - 1)
    if share < MIN_SHARE_OF_SHOTS or len(first) == 1:
        return Clock(share, 0, 1 if share < MIN_SHARE_OF_SHOTS else len(times))
    elapsed = np.diff(times[first])
    # Those at the ends may be cut.
    sizes = np.diff(first)[1:] if len(first) > 2 else np.diff(first)  # noqa: PLR2004
    shots = int(np.percentile(sizes, FULL_TICKS, method='nearest'))
    return Clock(share, int(np.median(elapsed[elapsed > 0])), shots)


def spread_times(t: Ints, clock: Clock, begins: Bools | None = None) -> Ints:
    """Spread equal times evenly up to the next tick, in the order given.

    Shots that miss are not known: those of a tick that is not full are farther apart. No shot
    leaves its tick, and all returns of one keep one time.

    Parameters
    ----------
    t, begins : as of :func:`measure_clock`, of any run of points that cuts no tick
    clock : of the whole stream

    """
    if clock.shots < 2 or not len(t):  # noqa: PLR2004  times of their own
        return t
    new = np.append([True], t[1:] != t[:-1])
    number = np.arange(len(t)) if begins is None else np.cumsum(begins | new) - 1
    tick = np.cumsum(new) - 1
    first = number[new]
    count = np.append(first[1:], number[-1] + 1) - first
    spread: Ints = t + (number - first[tick]) * clock.tick // count[tick]
    return spread


class TimeSpreader:
    """Spreads equal times of a stream; the same points cut in any way get the same times.

    The shots of a tick follow each other at the interval of a full one. Shots that miss are not
    known: in a tick that is not full, those behind them come too early, but none leaves its tick.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._time, self._count = -1, 0  # of the tick that may go on

    def spread(self, t: Ints) -> Ints:
        """Return times of their own (N,), of points in the order of their shots, ns."""
        if self.clock.shots < MIN_SHOTS or not len(t):
            return t
        new = np.append([t[0] != self._time], t[1:] != t[:-1])
        tick = np.cumsum(new)
        first = np.append([-self._count], np.flatnonzero(new))
        place = np.minimum(np.arange(len(t)) - first[tick], self.clock.shots - 1)
        self._time, self._count = int(t[-1]), int(len(t) - first[tick[-1]])
        spread: Ints = t + place * self.clock.tick // self.clock.shots
        return spread
