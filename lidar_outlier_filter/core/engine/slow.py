# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Detectors that take too long are reported while they still run; no verdict changes."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from time import monotonic, sleep
from typing import NamedTuple

from lidar_outlier_filter.core.points.points import SECOND, Points

SaySlow = Callable[['SlowDetector'], object]

PERIOD_S = 0.1  # between two checks
SLOW_FACTOR = 10.0  # × max_delay: a detector that takes longer for a block is slow


class SlowDetector(NamedTuple):
    """A detector that has not finished a block in time.

    Attributes
    ----------
    name : of the detector
    limit : time limit, seconds
    points : number of points in the block
    begin : time of the earliest point, nanoseconds; 0 if the points have no times

    """

    name: str
    limit: float
    points: int
    begin: int

    def __str__(self) -> str:
        """Describe it in one sentence."""
        begin = f', from sensor time {self.begin / SECOND:.3f} s' if self.begin else ''
        return f'{self.name} takes more than {self.limit:g} s for {self.points} points{begin}'


_due: dict[object, tuple[float, Callable[[], object]]] = {}  # by block: when, and what to call


@cache
def _start_watching() -> None:
    """Start one thread for all watched blocks: one for each costs more than some blocks take."""
    threading.Thread(target=_watch, name='slow detectors', daemon=True).start()


def _watch() -> None:
    while True:
        sleep(PERIOD_S)
        for key, (due, call) in _due.copy().items():
            if due <= monotonic() and _due.pop(key, None) is not None:
                # A thread of its own: whatever it does, the others are still watched.
                threading.Thread(target=call, daemon=True).start()


def _forget() -> None:
    """Forget the thread and its blocks: a forked process has none."""
    _start_watching.cache_clear()
    _due.clear()


os.register_at_fork(after_in_child=_forget)


@contextmanager
def watched(name: str, max_delay: float, points: Points, say: SaySlow | None) -> Iterator[None]:
    """Report a detector from another thread if the enclosed block takes too long.

    Parameters
    ----------
    name : of the detector
    max_delay : seconds that a cloud may wait
    points : the points that the detector judges
    say : called at most once; None disables the watch

    """
    if say is None:
        yield
        return
    key, limit, call = object(), SLOW_FACTOR * max_delay, say

    def report() -> None:
        times = points.t[points.valid]
        call(SlowDetector(name, limit, len(times), int(times.min())))

    _start_watching()
    _due[key] = monotonic() + limit, report
    try:
        yield
    finally:
        _due.pop(key, None)
