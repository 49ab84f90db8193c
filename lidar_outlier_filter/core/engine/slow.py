# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Detectors that take too long: it is said while they still run, and changes no verdict."""

from __future__ import annotations

import os
import threading
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from lidar_outlier_filter.core.kernels.compile_listeners import listeners
from lidar_outlier_filter.core.points.points import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lidar_outlier_filter.core.points.points import Points

    SaySlow = Callable[['SlowDetector'], object]

PATIENCE = 10.0  # × max_delay that a detector may take for a block


class SlowDetector(NamedTuple):
    """A detector that has not finished a block in time.

    Attributes
    ----------
    name : of the detector
    limit : seconds that it may take
    points : how many it was given
    begin : time of the earliest of them, nanoseconds; 0 where they have none

    """

    name: str
    limit: float
    points: int
    begin: int

    def __str__(self) -> str:
        """Say so in one sentence."""
        begin = f' from {self.begin / SECOND:.3f} s on' if self.begin else ''
        return f'{self.name} takes more than {self.limit:g} s for {self.points} points{begin}'


class _Watcher:
    """A thread that sleeps until something that has begun should have ended."""

    def __init__(self) -> None:
        self.renew()

    def renew(self) -> None:
        """Forget the thread: a process that was forked off has none."""
        self._changed = threading.Condition()
        self._due: dict[object, tuple[float, Callable[[], object]]] = {}
        self._wakes = float('-inf')  # when the thread looks again; it has not begun

    def add(self, key: object, due: float, call: Callable[[], object]) -> None:
        with self._changed:
            self._due[key] = (due, call)
            if self._wakes == float('-inf'):
                threading.Thread(target=self._work, name='slow detectors', daemon=True).start()
                self._wakes = due
            elif due < self._wakes:
                self._changed.notify()

    def remove(self, key: object) -> None:
        with self._changed:
            self._due.pop(key, None)

    def _work(self) -> None:
        with self._changed:
            while True:
                now = monotonic()
                for key in [key for key, (due, _) in self._due.items() if due <= now]:
                    _, call = self._due.pop(key)
                    # A thread of its own: whatever it does, the next one is watched.
                    threading.Thread(target=call, daemon=True).start()
                self._wakes = min((due for due, _ in self._due.values()), default=float('inf'))
                self._changed.wait(None if not self._due else self._wakes - now)


_watcher = _Watcher()
os.register_at_fork(after_in_child=_watcher.renew)


@contextmanager
def watched(name: str, max_delay: float, points: Points, say: SaySlow | None) -> Iterator[None]:
    """Say, from another thread, if what is done within takes a detector too long.

    Nothing is said where kernels are compiled within: that is said elsewhere, and once.

    Parameters
    ----------
    name : of the detector
    max_delay : seconds that a cloud may wait
    points : that the detector judges
    say : is called at most once; None: nobody wants to know

    """
    if say is None:
        yield
        return
    key, limit, call = object(), PATIENCE * max_delay, say

    def late() -> None:
        times = points.t[points.valid]
        call(SlowDetector(name, limit, len(times), int(times.min())))

    def compiles(_module: str) -> None:
        _watcher.remove(key)

    _watcher.add(key, monotonic() + limit, late)
    listeners.append(compiles)
    try:
        yield
    finally:
        listeners.remove(compiles)
        _watcher.remove(key)
