# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Number the turns of a profile scanner's mirror, by the times of its points."""

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.points.mirror import Mirror

WINDOW_TURNS = 1 / 8  # to either side of where a turn should begin, in which its gap is sought
MIN_GAP_TURNS = 1 / 64  # a shorter pause is no gap
# Of the distance from the gap, by which the next beginning and the period follow: a second-order
# loop, critically damped, that needs some ten turns.
PHASE_GAIN, PERIOD_GAIN = 0.1, 0.0025
MAX_DRIFT = 0.01  # of the period that was decided
MIN_FACET, MAX_FACET = 0.95, 1.1  # periods that a facet takes
KEPT_TURNS = 512  # whose beginnings late points find


class TurnCounter:
    """Numbers turns, from 0; the same points cut in any way get the same numbers.

    The next turn begins a period after the last one, drawn towards the gap that was seen there. So
    only earlier points say where a turn begins, and none waits for its number.
    """

    def __init__(self, mirror: Mirror) -> None:
        """Begin with the turn that time and geometry show."""
        self.mirror = mirror
        self.period = mirror.period
        self._begins = [mirror.begin]
        self._number = 1  # of the first that is kept; points before it are of turn 0
        self._tail = np.empty(0, np.int64)  # times that the next gap may lie between

    def number(self, t: Ints) -> Ints:
        """Return the turn of each point (N,); ``t`` are its times, ns, in any order.

        Points that come later must not be older, but for some: they do not move any beginning.
        """
        if not len(t):
            return np.empty(0, np.int64)
        ordered = t if (t[1:] >= t[:-1]).all() else np.sort(t)
        self._advance(ordered)
        found: Ints = self._number + np.searchsorted(self._begins, t, side='right') - 1
        if len(self._begins) > 2 * KEPT_TURNS:
            self._number += len(self._begins) - KEPT_TURNS
            self._begins = self._begins[-KEPT_TURNS:]
        return found

    def _advance(self, t: Ints) -> None:
        """Find all turns that begin before the last of some times."""
        if len(self._tail) and t[0] < self._tail[-1]:
            t = t[np.searchsorted(t, self._tail[-1]) :]
        times = np.concatenate([self._tail, t])
        if not len(times):
            return
        last = int(times[-1])
        while self._begins[-1] + self.period * WINDOW_TURNS < last:
            self._next_turn(times)
        keep = self._begins[-1] - round(self.period * WINDOW_TURNS)
        self._tail = times[np.searchsorted(times, keep) :]

    def _next_turn(self, times: Ints) -> None:
        begin, wide = self._begins[-1], round(self.period * WINDOW_TURNS)
        low, high = np.searchsorted(times, (begin - wide, begin + wide))
        edges = np.concatenate([[begin - wide], times[low:high], [begin + wide]])
        gaps = np.diff(edges)
        widest = int(gaps.argmax())
        off = 0.0
        # Without a return on one side, where the gap ends does not show.
        if high - low > 0 and gaps[widest] >= MIN_GAP_TURNS * self.period:
            off = (float(edges[widest]) + float(edges[widest + 1])) / 2.0 - begin
        decided = self.mirror.period
        drifted = self.period + PERIOD_GAIN * off
        self.period = min(max(drifted, (1 - MAX_DRIFT) * decided), (1 + MAX_DRIFT) * decided)
        self._begins.append(begin + round(self.period + PHASE_GAIN * off))


class FacetCounter:
    """Numbers the facets of a mirror, from 0; the same points cut in any way get the same numbers.

    A facet begins where the beam jumps, about a period after the last one, or soon after that.
    """

    def __init__(self, mirror: Mirror) -> None:
        """Begin with the facet that time and geometry show."""
        self.mirror = mirror
        self._begins = [mirror.begin - round(mirror.period)]
        self._number = 0  # of the first that is kept
        self._last = np.empty((0, 3))  # the last point

    def number(self, t: Ints, xyz: Floats) -> Ints:
        """Return the facet of each point (N,); ``t`` are times, ns, and ``xyz`` (N, 3) metres."""
        if not len(t):
            return np.empty(0, np.int64)
        order = np.argsort(t, kind='stable')
        path = np.concatenate([self._last, xyz[order]])
        jumps = np.flatnonzero((np.diff(path, axis=0) ** 2).sum(axis=1) > self.mirror.jump**2)
        times = t[order]
        for at in times[jumps + 1 - len(self._last)].tolist():
            self._advance(at)
            if at - self._begins[-1] >= MIN_FACET * self.mirror.period:
                self._begins.append(at)
        self._advance(int(times[-1]))
        self._last = path[-1:]
        found: Ints = self._number + np.searchsorted(self._begins, t, side='right')
        if len(self._begins) > 2 * KEPT_TURNS:
            self._number += len(self._begins) - KEPT_TURNS
            self._begins = self._begins[-KEPT_TURNS:]
        return found

    def _advance(self, last: int) -> None:
        """Begin facets whose jump is not seen."""
        longest = round(MAX_FACET * self.mirror.period)
        while last >= self._begins[-1] + longest:
            self._begins.append(self._begins[-1] + longest)
