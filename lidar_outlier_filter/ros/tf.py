# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the sensor was when, by tf2; and which source of poses the parameters ask for.

tf2 interpolates any gap, and does not give the times of its transforms: they are read here.
"""

from __future__ import annotations

import importlib
import threading
from bisect import bisect_left, bisect_right
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from rclpy.time import Duration, Time

from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.poses import KEPT, Mounting, Track
from lidar_outlier_filter.errors import ParameterError, PoseError
from lidar_outlier_filter.pipeline.motion import Odometry
from lidar_outlier_filter.pipeline.statistics import CountsByReason

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from lidar_outlier_filter.annotations import Bools
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.pipeline.motion import PoseSource

STEP = SECOND // 100  # between two looks into tf: vehicles turn slowly
NOWHERE = Mounting.at((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
MOST_FRAMES = 10_000  # of a tree: a buffer forgets no name
LONGEST_NAME = 1000  # characters


class Tf:
    """tf2: the transform from the frame of the cloud to one that stands still.

    It is looked up every 10 ms and interpolated between, because one look takes 10 µs and a cloud
    has as many times as points. These times are multiples of 10 ms, so that a point is moved by the
    same looks in whatever message it comes. tf2 interpolates over any gap: we look for them.
    """

    def __init__(self, node: Node, parameters: FilterParameters) -> None:
        """Listen to /tf and /tf_static.

        Raises
        ------
        ParameterError
            If tf2_ros is not installed.

        """
        try:
            tf2_ros = importlib.import_module('tf2_ros')
        except ImportError as err:
            must_be = "'none' or 'odometry' where tf2_ros is not installed"
            raise ParameterError('motion.source', must_be, "'tf'") from err
        self.topic = ''
        self._fixed = parameters.motion.fixed_frame
        self.refusals = CountsByReason()
        self._time: Any = lambda t: Time(nanoseconds=t)
        self._jump, self._gap = parameters.time_jump, parameters.motion.max_gap
        self._buffer: Any = tf2_ros.Buffer(cache_time=Duration(seconds=60), node=node)
        self._unknown: Any = tf2_ros.TransformException
        self._links = Links(self._buffer, parameters.time_jump)
        self._links.refuse = self.refusals.note
        self._listener = tf2_ros.TransformListener(self._links, node)

    def take(self, msg: Any) -> None:
        """Do nothing: tf2 has its own subscriptions."""

    def reaches(self, last: int, frame: str) -> bool:
        """Return whether tf knows ``frame`` at the look behind ``last``, or never will."""
        look = _looks(last, last)[-1]
        return look <= 0 or bool(self._buffer.can_transform(self._fixed, frame, self._time(look)))

    def move(self, points: Points, frame: str) -> tuple[Points, Bools]:
        """Move points from ``frame`` to the one that stands still.

        A point is moved where tf knows both looks around it, and has no gap between them.
        """
        known = points.t[points.valid]
        if not len(known):
            return points, points.valid
        looks = _looks(int(known.min()), int(known.max()))
        free = points.valid.copy()
        for begin, end in self._links.gaps(
            self._fixed, frame, looks[0], looks[-1], round(self._gap * SECOND)
        ):
            around = _looks(begin, end)
            free &= (points.t <= around[0]) | (points.t >= around[-1])
        track = self._look_up(looks, frame)
        moved, covered = track.move(replace(points, valid=free), NOWHERE)
        if not covered.any():
            return points, covered
        self._links.caught_up()
        return replace(moved, valid=points.valid), covered

    def _look_up(self, looks: range, frame: str) -> Track:
        """Gather what tf knows at some looks, between which nothing is interpolated but there."""
        track = Track(STEP / SECOND, self._jump)
        wrong: set[str] = set()
        for t in looks:
            if t <= 0:  # to tf2 the latest time, or an error
                continue
            try:
                found = self._buffer.lookup_transform(self._fixed, frame, self._time(t))
                p, q = found.transform.translation, found.transform.rotation
                track.add(t, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))
            except self._unknown:
                continue
            except PoseError as err:
                wrong.add(err.what)
        for what in sorted(wrong):
            self.refusals.note(what)
        return track

    def reset(self) -> None:
        """Forget all transforms but static ones."""
        self._links.begin_anew()


def _looks(first: int, last: int) -> range:
    """List when to look for points from ``first`` to ``last``: from before to behind, ns."""
    begin = first // STEP * STEP
    return range(begin, max(-(-last // STEP) * STEP, begin) + 1, STEP)


def make_motion(node: Node, parameters: FilterParameters) -> PoseSource | None:
    """Make what ``motion.source`` asks for; None for 'none'.

    Raises
    ------
    ParameterError
        If it is not to be had here.

    """
    if parameters.motion.source == 'none':
        return None
    return Odometry(parameters) if parameters.motion.source == 'odometry' else Tf(node, parameters)


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
