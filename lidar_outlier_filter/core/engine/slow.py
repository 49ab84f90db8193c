# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Detectors that take too long are reported while they still run; no verdict changes."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from lidar_outlier_filter.core.kernels.compile_listeners import listeners
from lidar_outlier_filter.core.points.points import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lidar_outlier_filter.core.points.points import Points

    SaySlow = Callable[['SlowDetector'], object]

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
        begin = f' from {self.begin / SECOND:.3f} s on' if self.begin else ''
        return f'{self.name} takes more than {self.limit:g} s for {self.points} points{begin}'


@contextmanager
def watched(name: str, max_delay: float, points: Points, say: SaySlow | None) -> Iterator[None]:
    """Report a detector from another thread if the enclosed block takes too long.

    Nothing is reported if kernels are compiled meanwhile: that is reported elsewhere, once.

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
    limit, call = SLOW_FACTOR * max_delay, say

    def report() -> None:
        times = points.t[points.valid]
        call(SlowDetector(name, limit, len(times), int(times.min())))

    def compiles(_module: str) -> None:
        timer.cancel()

    timer = threading.Timer(limit, report)
    timer.daemon = True
    timer.start()
    listeners.append(compiles)
    try:
        yield
    finally:
        listeners.remove(compiles)
        timer.cancel()
