# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Times that several shots share: of a packet, a column, a line, or of a coarse clock.

The order of the points tells the shots of one time apart, where it is that of the shots.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Ints

MIN_SHARE = 0.5  # of the shots have the time of the one before: the clock is coarse
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
    if share < MIN_SHARE or len(first) == 1:
        return Clock(share, 0, 1 if share < MIN_SHARE else len(times))
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
