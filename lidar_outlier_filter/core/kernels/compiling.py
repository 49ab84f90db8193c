# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What kernels are compiled with, and how to use only those that are compiled already."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from threading import get_ident
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels.compile_listeners import listeners
from lidar_outlier_filter.core.points.points import Points

if TYPE_CHECKING:
    from collections.abc import Iterator

# The sensors whose points are judged by different kernels.
SENSORS = ('profile', 'spinning')
COUNT = 128  # points: enough for each detector of the defaults to judge them
RINGS = 4


class NotCompiled(Exception):  # noqa: N818  no error: an answer
    """A kernel would have to be compiled."""


@contextmanager
def only_compiled() -> Iterator[None]:
    """Raise :class:`NotCompiled` where this thread calls a kernel that is not on disk."""
    asking = get_ident()

    def refuse(_module: str) -> None:
        if get_ident() == asking:
            raise NotCompiled

    listeners.insert(0, refuse)  # nobody is called for what is not compiled
    try:
        yield
    finally:
        listeners.remove(refuse)


def sample(sensor: str) -> Iterator[Points]:
    """Return small clouds of a sensor, in the layouts of memory that a stream gives."""
    t = np.arange(COUNT) * 1000
    if sensor == 'profile':
        xyz = np.zeros((COUNT, 3))
        xyz[:, 0] = np.arange(COUNT)
        xyz[COUNT // 2, 2] = 10.0
        # Two lines without a scan pattern: these are judged by their nearest neighbours.
        points = Points(xyz, t, np.arange(COUNT) // (COUNT // 2), np.ones(COUNT, np.bool_))
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
