# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps that stand still, at 0 or in whole seconds, or that jitter from sweep to sweep.

A laser cannot measure twice at one time. So messages of one stamp, in which all lasers measure from
the same time to the same time, are sweeps one after the other, in their order of arrival. So is a
message that begins before the end of the one before.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Ints
from lidar_outlier_filter.core.points.points import SECOND

MIN_OVERLAP = 0.8  # of the span of both messages, from which on one repeats the other
MIN_SHARED_LINES = 0.9  # of the lines of both
MIN_SWEEP_NS, MAX_SWEEP_NS = SECOND // 100, SECOND  # a turn takes no less, and no more
MIN_JITTER_NS = SECOND // 1000  # of overlap: what is less harms nothing
COARSEST_NS = SECOND  # that a stamp may be behind: no clock is coarser


class StampCheck:
    """Finds by how much the stamps of one topic are behind."""

    def __init__(self) -> None:
        """Trust stamps until one stands still, or comes too early."""
        self.stands_still = self.jitters = False
        self._stamp: int | None = None
        self._start = 0  # of the last message, nanoseconds
        self._t = self._line = np.empty(0, np.int64)  # its times from its stamp, and lines

    def behind(self, stamp: int, t: Ints, line: Ints) -> int:
        """Return what to add to the times of the next message, nanoseconds.

        Parameters
        ----------
        stamp : of its header, nanoseconds
        t, line : (N,) of its valid points: nanoseconds from the stamp, and line

        """
        if not len(t):
            return 0
        if not self.stands_still:
            self.stands_still = stamp == self._stamp and self._repeats(t, line)
        behind = max(self._start + _turn(self._t) - stamp, 0) if self.stands_still else 0
        if behind > COARSEST_NS and stamp != self._stamp:  # the clock was set back
            self.stands_still, behind = False, 0
        if not self.stands_still and (early := self._early(t + stamp - self._start, line)):
            self.jitters, behind = True, early
        self._stamp, self._start, self._t, self._line = stamp, stamp + behind, t, line
        return behind

    def _repeats(self, t: Ints, line: Ints) -> bool:
        """Return whether the same lasers measure at the same times as in the last message."""
        first, last, first_before, last_before = t.min(), t.max(), self._t.min(), self._t.max()
        overlap = min(last, last_before) - max(first, first_before)
        if not MIN_SWEEP_NS <= overlap <= MAX_SWEEP_NS:
            return False
        longest = max(last - first, last_before - first_before)
        return bool(overlap >= MIN_OVERLAP * longest) and self._has_lines(line)

    def _has_lines(self, line: Ints) -> bool:
        """Return whether the last message is of the same lasers."""
        lines, before = np.unique(line), np.unique(self._line)
        shared = len(np.intersect1d(lines, before, assume_unique=True))
        return shared >= MIN_SHARED_LINES * max(len(lines), len(before))

    def _early(self, t: Ints, line: Ints) -> int:
        """Return by how much a sweep has come too early, ns; 0 if it has not.

        Lasers look to either side of each other, so each is compared with itself. ``t`` counts from
        where that of the last message does.
        """
        if not len(self._t) or self._t.max() - t.min() <= MIN_JITTER_NS:
            return 0
        if len(line) != len(t) or len(self._line) != len(self._t):
            return 0  # lasers are not known
        shortest = min(np.ptp(t), np.ptp(self._t))
        if not MIN_SWEEP_NS <= shortest <= MAX_SWEEP_NS or not self._has_lines(line):
            return 0
        order, before = np.lexsort((t, line)), np.lexsort((self._t, self._line))
        lines, first = np.unique(line[order], return_index=True)
        lines_before, last = np.unique(self._line[before][::-1], return_index=True)
        _, here, there = np.intersect1d(lines, lines_before, return_indices=True)
        overlap = int((self._t[before][::-1][last[there]] - t[order][first[here]]).max())
        if not MIN_JITTER_NS < overlap <= MIN_OVERLAP * shortest:
            return 0
        steps = np.diff(t[order])[np.diff(line[order]) == 0]
        return overlap + int(np.median(steps[steps > 0]))


def _turn(t: Ints) -> int:
    """Return how long after a message the next one begins: its span, and a step more."""
    times = np.unique(t)
    return int(times[-1] - times[0] + np.median(np.diff(times))) if len(times) > 1 else 0
