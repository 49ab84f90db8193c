# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the sensor was when, by tf; and which source of poses the parameters ask for.

A buffer of tf2 interpolates over any gap and looks up one time after the other. Here each
transform that moves is a track of poses, and points are moved along it at their own times.
"""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.poses import SensorExtrinsics, Track
from lidar_outlier_filter.errors import PoseError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.motion import Odometry, PoseSource
from lidar_outlier_filter.pipeline.statistics import CountsByReason
from lidar_outlier_filter.pipeline.topics import TRANSFORMS

DYNAMIC, STATIC = '/tf', '/tf_static'  # topics
MAX_TF_FRAMES = 10_000
MAX_NAME = 1000  # characters of the name of a frame
NOWHERE = SensorExtrinsics(np.zeros(3), np.eye(3))


def pose_source(parameters: FilterParameters) -> PoseSource | None:
    """Make the pose source that ``motion.source`` names; None for 'none'."""
    kinds: dict[str, Callable[[FilterParameters], PoseSource]] = {'odometry': Odometry, 'tf': Tf}
    make = kinds.get(parameters.motion.source)
    return None if make is None else make(parameters)


class Tf:
    """Moves points from the frame of their cloud to ``motion.fixed_frame``, by tf."""

    topic = ''

    def __init__(self, parameters: FilterParameters) -> None:
        self.refusals = CountsByReason()
        self.listeners = {(DYNAMIC, TRANSFORMS): self.take, (STATIC, TRANSFORMS): self.take_static}
        self._fixed = _name(parameters.motion.fixed_frame)
        self._max_gap, self._jump = parameters.motion.max_gap, parameters.time_jump
        self._lock = threading.RLock()
        self._parents: dict[str, str] = {}  # by child
        self._links: dict[str, SensorExtrinsics | Track] = {}  # poses in the parent, by child

    def take(self, msg: Any) -> None:
        """Add transforms at their times; invalid ones are counted, late ones ignored."""
        for transform in msg.transforms:
            with self._lock:
                self._add(transform)

    def take_static(self, msg: Any) -> None:
        """Add transforms that hold at all times; invalid ones are counted."""
        for transform in msg.transforms:
            try:
                link = SensorExtrinsics.of_pose(_pose(transform))
            except PoseError as err:
                self.refusals.note(err.what)
                continue
            with self._lock:
                if child := self._attach(transform):
                    self._links[child] = link

    def reaches(self, last: int, frame: str) -> bool:
        """Return whether all transforms on the way from ``frame`` are known at ``last`` (ns)."""
        path = self._path(frame)
        if path is None:
            return False
        return all(link.reaches(last) for link, _ in path if isinstance(link, Track))

    def move(self, points: Points, frame: str) -> tuple[Points, Bools]:
        """Move points from ``frame`` to the fixed one, each at its own time.

        A point is moved where no transform on the way has a longer gap than ``motion.max_gap``.
        """
        path = self._path(frame)
        if path is None:
            return points, np.zeros(len(points), np.bool_)
        moved, covered = points, points.valid
        for link, is_inverse in path:
            if isinstance(link, SensorExtrinsics):
                moved = replace(
                    moved, xyz=_moved_once(moved.xyz, _inverse(link) if is_inverse else link)
                )
                continue
            some = replace(moved, valid=covered)
            moved, covered = _move_back(some, link) if is_inverse else link.move(some, NOWHERE)
        if not covered.any():
            return points, covered
        xyz = np.where(covered[:, np.newaxis], moved.xyz, points.xyz)
        return replace(points, xyz=xyz, own=points.in_own_frame.xyz), covered

    def reset(self) -> None:
        """Forget all transforms but static ones, and those of a clock that was set back before."""
        with self._lock:
            for link in self._links.values():
                if isinstance(link, Track):
                    link.reset()

    def _add(self, transform: Any) -> None:
        child = self._attach(transform)
        if not child:
            return
        link = self._links.get(child)
        if not isinstance(link, Track):
            link = self._links[child] = Track(self._max_gap, self._jump)
        stamp = transform.header.stamp
        try:
            if link.add(stamp.sec * SECOND + stamp.nanosec, _pose(transform)):
                self.reset()
        except PoseError as err:
            # The last transform is often repeated.
            if err.what != 'the time of a pose':
                self.refusals.note(err.what)

    def _attach(self, transform: Any) -> str:
        """Note the parent of a frame and return the frame; '' where its name is refused."""
        names = (transform.header.frame_id, transform.child_frame_id)
        parent, child = map(_name, names)
        if max(len(parent), len(child)) > MAX_NAME:
            self.refusals.note('the name of a frame')
            return ''
        if child not in self._parents and len(self._parents) == MAX_TF_FRAMES:
            self.refusals.note('the number of frames')
            return ''
        self._parents[child] = parent
        return child

    def _path(self, frame: str) -> list[tuple[SensorExtrinsics | Track, bool]] | None:
        """List the transforms to the fixed frame, and whether each is inverted; None: no way."""
        with self._lock:
            up, down = self._to_root(_name(frame)), self._to_root(self._fixed)
            common = next((name for name in up if name in down), None)
            if common is None:
                return None
            ahead = [(self._links[name], False) for name in up[: up.index(common)]]
            back = [(self._links[name], True) for name in down[: down.index(common)]]
            return ahead + back[::-1]

    def _to_root(self, frame: str) -> list[str]:
        way = [frame]
        while (parent := self._parents.get(way[-1])) is not None and parent not in way:
            way.append(parent)
        return way


def _name(frame: object) -> str:
    """Return a frame's name as tf2 has it: ROS 1 began some with a slash."""
    return str(frame).removeprefix('/')


def _pose(transform: Any) -> tuple[float, ...]:
    p, q = transform.transform.translation, transform.transform.rotation
    return (p.x, p.y, p.z, q.x, q.y, q.z, q.w)


def _move_back(points: Points, track: Track) -> tuple[Points, Bools]:
    """Move points by the inverse of the pose at each one's time."""
    origin, covered = track.move(replace(points, xyz=np.zeros_like(points.xyz)), NOWHERE)
    rest, turned = points.xyz - origin.xyz, np.empty_like(points.xyz)
    for k in range(3):
        axis = np.zeros_like(points.xyz)
        axis[:, k] = 1
        end, _ = track.move(replace(points, xyz=axis), NOWHERE)
        turned[:, k] = ((end.xyz - origin.xyz) * rest).sum(axis=1)
    return replace(points, xyz=turned), covered


def _inverse(mounting: SensorExtrinsics) -> SensorExtrinsics:
    turn = mounting.matrix.T
    return SensorExtrinsics(-turn @ mounting.position, turn)


def _moved_once(xyz: Floats, mounting: SensorExtrinsics) -> Floats:
    """Move all points alike; by elements, so that it does not depend on how many there are."""
    parts = (xyz[:, k, np.newaxis] * mounting.matrix[:, k] for k in range(3))
    return sum(parts, start=mounting.position)
