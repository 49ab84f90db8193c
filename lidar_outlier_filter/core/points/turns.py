# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Number the turns of a profile scanner's mirror, by the times of its points."""

from collections.abc import Callable

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.mirror import (
    MAX_RESEMBLANCE,
    STRETCH_NS,
    Mirror,
    find_mirror,
    nearest_returns,
)

WINDOW_TURNS = 1 / 8  # to either side of where a turn should begin, in which its gap is sought
MIN_GAP_TURNS = 1 / 64  # a shorter pause is no gap
# Of the distance from the gap, by which the next beginning and the period follow: a second-order
# loop, critically damped, that needs some ten turns.
PHASE_GAIN, PERIOD_GAIN = 0.1, 0.0025
MAX_DRIFT = 0.01  # of the period that was decided
MIN_FACET, MAX_FACET = 0.95, 1.1  # periods that a facet takes
KEPT_TURNS = 512  # whose beginnings late points find
# Of a mirror that swings: places beside where it should reverse, at which it may, in turns; and how
# long before and after it the beam is compared.
REVERSAL_OFFSETS = np.linspace(-1 / 32, 1 / 32, 17)
BESIDE_REVERSAL = np.linspace(1 / 64, 1 / 12, 12)
MIN_BESIDE = 8  # of them with returns on both sides
KEPT_PERIODS = 4  # before the next turn, whose points are kept
CHECK_TURNS = 32  # after so many, the last turn is compared with the one before
CHECK_PAIRS, MIN_CHECK_PAIRS = 64, 24  # points of a turn that are compared; with returns in both
MAX_NEAR_TURNS = 1 / 256  # of a time, a return there
FAILED_CHECKS = 3  # more than passed: the mirror turns otherwise


class TurnCounter:
    """Numbers turns, from 0; the same points cut in any way get the same numbers.

    The next turn begins a period after the last one, drawn towards the gap that was seen there, or,
    of a mirror that swings, to where the beam comes back as it went. So only earlier points say
    where a turn begins, and none waits for its number.

    Where turns do not resemble each other any more, the mirror has another rate: after a stretch of
    time the period is found anew. Where none is found, all goes on as before.
    """

    def __init__(
        self, mirror: Mirror, say: Callable[[Mirror | None], object] = lambda _: None
    ) -> None:
        """Begin with the turn that time and geometry show.

        ``say`` is called where turns have lost their resemblance: with the mirror that was found
        then, or None.
        """
        self.mirror = mirror
        self.period = mirror.period
        self._say = say
        self._begins = [mirror.begin]
        self._number = 1  # of the first that is kept; points before it are of turn 0
        # Points that the next turns may be compared with.
        self._times, self._xyz = np.empty(0, np.int64), np.empty((0, 3))
        self._turns, self._failed = 0, 0  # since the period was found; failed checks
        self._lost: int | None = None  # when turns lost their resemblance

    def number(self, t: Ints, xyz: Floats) -> Ints:
        """Return the turn of each point (N,); ``t`` are times, ns, and ``xyz`` (N, 3) metres.

        They are in any order. Points that come later must not be older, but for some: they do not
        move any beginning.
        """
        if not len(t):
            return np.empty(0, np.int64)
        if (t[1:] >= t[:-1]).all():
            self._advance(t, xyz)
        else:
            order = np.argsort(t, kind='stable')
            self._advance(t[order], xyz[order])
        found: Ints = self._number + np.searchsorted(self._begins, t, side='right') - 1
        if len(self._begins) > 2 * KEPT_TURNS:
            self._number += len(self._begins) - KEPT_TURNS
            self._begins = self._begins[-KEPT_TURNS:]
        return found

    def _advance(self, t: Ints, xyz: Floats) -> None:
        """Find all turns that begin before the last of some times."""
        if len(self._times) and t[0] < self._times[-1]:
            late = int(np.searchsorted(t, self._times[-1]))
            t, xyz = t[late:], xyz[late:]
        if not len(t):
            return
        self._times = np.concatenate([self._times, t])
        self._xyz = np.concatenate([self._xyz, xyz])
        last = int(t[-1])
        while self._begins[-1] + self.period * WINDOW_TURNS < last:
            self._next_turn()
        keep = self._begins[-1] - round(KEPT_PERIODS * self.period)
        keep = keep if self._lost is None else min(keep, self._lost)
        kept = int(np.searchsorted(self._times, keep))
        self._times, self._xyz = self._times[kept:].copy(), self._xyz[kept:].copy()

    def _next_turn(self) -> None:
        begin = self._begins[-1]
        off = self._reversal(begin) if self.mirror.swings else self._gap(begin)
        decided = self.mirror.period
        drifted = self.period + PERIOD_GAIN * off
        self.period = min(max(drifted, (1 - MAX_DRIFT) * decided), (1 + MAX_DRIFT) * decided)
        self._begins.append(max(begin + round(self.period + PHASE_GAIN * off), begin + 1))
        self._turns += 1
        if self._lost is not None and begin >= self._lost + STRETCH_NS:
            self._find_anew(self._lost)
        elif self._lost is None and self._turns % CHECK_TURNS == 0:
            self._failed = max(self._failed + (-1 if self._is_alike(begin) else 1), 0)
            self._lost = begin if self._failed == FAILED_CHECKS else None

    def _gap(self, begin: int) -> float:
        """Return how much later than expected a turn begins, ns, by its gap; 0: it shows none."""
        wide = round(self.period * WINDOW_TURNS)
        low, high = np.searchsorted(self._times, (begin - wide, begin + wide))
        edges = np.concatenate([[begin - wide], self._times[low:high], [begin + wide]])
        gaps = np.diff(edges)
        widest = int(gaps.argmax())
        # Without a return on one side, where the gap ends does not show.
        if high - low > 0 and gaps[widest] >= MIN_GAP_TURNS * self.period:
            return (float(edges[widest]) + float(edges[widest + 1])) / 2.0 - begin
        return 0.0

    def _reversal(self, begin: int) -> float:
        """Return how much later than expected a mirror swings back, ns; 0 if it does not show."""
        at, beside = self.period * REVERSAL_OFFSETS[:, None], self.period * BESIDE_REVERSAL
        ahead, there = self._find(begin, at + beside)
        back, here = self._find(begin, at - beside)
        apart = np.sqrt(((self._xyz[ahead] - self._xyz[back]) ** 2).sum(axis=2))
        known = there & here
        count = known.sum(axis=1)
        mean = np.where(known, apart, 0.0).sum(axis=1) / np.maximum(count, 1)
        mean[count < MIN_BESIDE] = np.inf
        if not np.isfinite(mean).any():
            return self._gap(begin)
        return float(self.period * REVERSAL_OFFSETS[mean.argmin()])

    def _is_alike(self, begin: int) -> bool:
        """Return whether the last turn lies where the one before does; true if none can tell."""
        last = self.period * (np.arange(CHECK_PAIRS) + 0.5) / -CHECK_PAIRS
        # What swings comes back as it went.
        before = -2.0 * self.period - last if self.mirror.swings else last - self.period
        (one, here), (other, there) = self._find(begin, last), self._find(begin, before)
        known = np.flatnonzero(here & there)
        if len(known) < MIN_CHECK_PAIRS:
            return True
        late, early = self._xyz[one[known]], self._xyz[other[known]]
        apart, typical = (
            float(np.median(np.sqrt(((late - beside) ** 2).sum(axis=1))))
            for beside in (early, np.roll(early, len(known) // 3, axis=0))
        )
        return apart <= MAX_RESEMBLANCE * typical

    def _find(self, begin: int, after: Floats) -> tuple[Ints, Bools]:
        """Return which returns are nearest to some times after one, and whether at these, ns."""
        return nearest_returns(self._times, begin, after, MAX_NEAR_TURNS * self.period)

    def _find_anew(self, lost: int) -> None:
        """Go on with the period of the points since turns lost their resemblance."""
        low, high = np.searchsorted(self._times, (lost, lost + STRETCH_NS))
        found = find_mirror(self._times[low:high], self._xyz[low:high])
        if found is not None and (found.swings != self.mirror.swings or found.jump > 0.0):
            found = None
        if found is not None:
            self.mirror, self.period = found, found.period
            late = self._begins[-1] - found.begin
            self._begins[-1] = found.begin + round(np.ceil(late / found.period) * found.period)
        self._lost, self._failed, self._turns = None, 0, 0
        self._say(found)


class FacetCounter:
    """Numbers the facets of a mirror, from 0; the same points cut in any way get the same numbers.

    A facet begins where the beam jumps, about a period after the last one, or soon after that.
    """

    def __init__(self, mirror: Mirror) -> None:
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
