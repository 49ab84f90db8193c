# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The times of the transforms in a tf buffer, which tf2 does not give: it interpolates any gap."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.points.poses import KEPT

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_FRAMES = 10_000  # of a tree: a buffer forgets no name
LONGEST_NAME = 1000  # characters


class Links:
    """Stands before a buffer: notes what is put into it, and hands it on. Any thread may put.

    A buffer of tf2 keeps what was before a clock was set back, among what comes after, and refuses
    what is older than all it keeps. So it is cleared here.
    """

    def __init__(self, buffer: Any, time_jump: float) -> None:
        """Put into ``buffer``, a ``tf2_ros.Buffer``.

        A transform that is older than the last one of its frame by more than ``time_jump`` seconds
        begins anew.
        """
        self.refuse: Callable[[str], object] = str  # is called with what was wrong
        self._buffer = buffer
        self._jump = round(time_jump * SECOND)
        self._is_new = False  # began anew, and no point was moved since
        self._lock = threading.Lock()
        self._parents: dict[str, str] = {}
        self._times: dict[str, list[int]] = {}  # nanoseconds, in order, of what moves

    def __len__(self) -> int:
        """Count the times that are held."""
        with self._lock:
            return sum(map(len, self._times.values()))

    def set_transform(self, transform: Any, authority: str) -> None:
        """Put a transform of one time."""
        # Noted first: what the buffer knows is known here, too.
        if self.note(transform):
            self._buffer.set_transform(transform, authority)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Put a transform that holds for ever."""
        parent, child = _frames(transform)
        with self._lock:
            if not self._link(parent, child):
                return
            self._times.pop(child, None)
        self._buffer.set_transform_static(transform, authority)

    def note(self, transform: Any) -> bool:
        """Note the time of a transform, and the frames that it links; False: it is refused."""
        parent, child = _frames(transform)
        stamp = transform.header.stamp
        t = stamp.sec * SECOND + stamp.nanosec
        with self._lock:
            if not self._link(parent, child):
                return False
            times = self._times.setdefault(child, [])
            if times and t < times[-1] - self._jump:
                self._clear()
                self._is_new = True
                times = self._times.setdefault(child, [])
            if not times or t > times[-1]:
                times.append(t)
            elif times[at := bisect_left(times, t)] != t:  # a clock that stands still adds none
                times.insert(at, t)
            old = bisect_left(times, times[-1] - KEPT)
            if 2 * old > len(times):  # not one by one
                del times[:old]
        return True

    def _link(self, parent: str, child: str) -> bool:
        """Note that a frame hangs on another; under the lock. False where names are too many."""
        if max(len(parent), len(child)) > LONGEST_NAME:
            self.refuse('the name of a frame')
            return False
        if child not in self._parents and len(self._parents) == MOST_FRAMES:
            self.refuse('the number of frames')
            return False
        self._parents[child] = parent
        return True

    def gaps(
        self, target: str, source: str, first: int, last: int, longest: int
    ) -> list[tuple[int, int]]:
        """List the gaps of the transforms on the way between two frames: begin and end, ns.

        Parameters
        ----------
        target, source : frames
        first, last : the stretch of time that matters, nanoseconds, both included
        longest : nanoseconds between two transforms that are no gap

        """
        found: list[tuple[int, int]] = []
        with self._lock:
            links = set(self._to_root(target)) ^ set(self._to_root(source))
            for child in links:
                times = self._times.get(child, [])
                begin = max(bisect_right(times, first) - 1, 0)
                near = times[begin : bisect_left(times, last) + 1]
                found += [pair for pair in pairwise(near) if pair[1] - pair[0] > longest]
        return found

    def begin_anew(self) -> None:
        """Forget all that does not hold for ever, unless it has begun anew by itself."""
        with self._lock:
            if not self._is_new:
                self._clear()

    def caught_up(self) -> None:
        """Note that points were moved: they are of the time of what is held."""
        with self._lock:
            self._is_new = False

    def _clear(self) -> None:
        self._times.clear()
        self._buffer.clear()

    def _to_root(self, frame: str) -> list[str]:
        """List the frames from one upwards, without the root."""
        way: list[str] = []
        while frame in self._parents and frame not in way:
            way.append(frame)
            frame = self._parents[frame]
        return way


def _frames(transform: Any) -> tuple[str, str]:
    """Return parent and child, named as tf2 names them."""
    names = (transform.header.frame_id, transform.child_frame_id)
    parent, child = (str(name).removeprefix('/') for name in names)
    return parent, child
