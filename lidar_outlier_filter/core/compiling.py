# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What kernels are compiled with, and how to use only those that are compiled already."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from threading import get_ident
from typing import TYPE_CHECKING

import numpy as np
from numba.core.event import Event, Listener, install_listener

from lidar_outlier_filter.core.points import Points

if TYPE_CHECKING:
    from collections.abc import Iterator

# The sensors whose points are judged by different kernels.
SENSORS = ('profile', 'spinning')
COUNT = 128  # points: enough for each detector of the defaults to judge them
RINGS = 4


class NotCompiled(Exception):  # noqa: N818  no error: an answer
    """A kernel would have to be compiled."""


class _Refusal(Listener):
    """Stops numba from compiling in the thread that made it."""

    def __init__(self) -> None:
        self._thread = get_ident()

    def on_start(self, _event: Event) -> None:
        if get_ident() == self._thread:
            raise NotCompiled

    def on_end(self, _event: Event) -> None:
        """Do nothing."""


@contextmanager
def only_compiled() -> Iterator[None]:
    """Raise :class:`NotCompiled` where this thread calls a kernel that is not on disk."""
    with install_listener('numba:compile', _Refusal()):
        yield


def sample(sensor: str) -> Iterator[Points]:
    """Return small clouds of a sensor, in the layouts of memory that a stream gives."""
    t = np.arange(COUNT) * 1000
    if sensor == 'profile':
        xyz = np.zeros((COUNT, 3))
        xyz[:, 0] = np.arange(COUNT)
        xyz[COUNT // 2, 2] = 10.0
        points = Points(xyz, t, np.zeros(COUNT, np.int64), np.ones(COUNT, np.bool_))
        for order in (np.arange(COUNT), np.arange(COUNT)[::-1]):
            yield points.take(order)
        # In whole turns, around a scanner that moves on: these have a scan pattern.
        yield replace(_turns(), t=t)
    else:
        bright = np.ones(COUNT, np.float32)
        yield replace(_turns(), t=np.tile(t[: COUNT // RINGS], RINGS), intensity=bright)


def _turns() -> Points:
    """Return lines of one turn each, one above the other, without times."""
    each = COUNT // RINGS
    turned, line = np.linspace(0.0, 6.0, each), np.repeat(np.arange(RINGS), each)
    level = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(each)])
    xyz = np.tile(level, (RINGS, 1))
    xyz[:, 2] = 0.1 * line
    return Points(xyz, np.zeros(COUNT, np.int64), line, np.ones(COUNT, np.bool_))
