# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A buffer of transforms with tf2's interface, which is not on PyPI: what is needed of it."""

from __future__ import annotations

import sys
from bisect import bisect_left, bisect_right, insort
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from geometry_msgs.msg import TransformStamped
from scipy.spatial.transform import Rotation, Slerp

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.ros.tf import Tf

if TYPE_CHECKING:
    import pytest
    from rclpy.node import Node

    from lidar_outlier_filter.annotations import Floats
    from lidar_outlier_filter.parameters.filter import FilterParameters


class UnknownTransformError(Exception):
    """A transform that is not known."""


class Buffer:
    """Frames in a tree; poses of a frame in its parent are interpolated, or hold for ever."""

    def __init__(self, **_given: object) -> None:
        self.looks = 0
        self._parents: dict[str, str] = {}
        self._poses: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        self._static: dict[str, tuple[float, ...]] = {}

    def set_transform(self, transform: Any, _authority: str) -> None:
        """Take a pose at its time."""
        child = self._place(transform)
        stamp = transform.header.stamp
        pose = (stamp.sec * SECOND + stamp.nanosec, _pose(transform))
        poses = self._poses.setdefault(child, [])
        if pose not in poses:
            insort(poses, pose)

    def set_transform_static(self, transform: Any, _authority: str) -> None:
        """Take a pose that holds for ever."""
        self._static[self._place(transform)] = _pose(transform)

    def clear(self) -> None:
        """Forget what does not hold for ever."""
        self._poses.clear()

    def can_transform(self, target: str, source: str, time: Any) -> bool:
        """Return whether it can be looked up."""
        try:
            self.lookup_transform(target, source, time)
        except UnknownTransformError:
            return False
        return True

    def lookup_transform(self, target: str, source: str, time: Any) -> TransformStamped:
        """Return the transform from the source frame to the target frame."""
        self.looks += 1
        to_root, root = self._to_root(source, time.nanoseconds)
        other, same = self._to_root(target, time.nanoseconds)
        if root != same:
            raise UnknownTransformError(f'{target} and {source}')
        return _message(target, source, time.nanoseconds, np.linalg.inv(other) @ to_root)

    def _place(self, transform: Any) -> str:
        child = str(transform.child_frame_id).removeprefix('/')
        self._parents[child] = str(transform.header.frame_id).removeprefix('/')
        return child

    def _to_root(self, frame: str, t: int) -> tuple[Floats, str]:
        matrix = np.eye(4)
        while frame in self._parents:
            matrix = self._at(frame, t) @ matrix
            frame = self._parents[frame]
        return matrix, frame

    def _at(self, frame: str, t: int) -> Floats:
        if frame in self._static:
            return _matrix(self._static[frame])
        times = [time for time, _ in self._poses.get(frame, [])]
        if not times or not times[0] <= t <= times[-1]:
            raise UnknownTransformError(f'{frame} at {t}')
        before, after = bisect_right(times, t) - 1, bisect_left(times, t)
        first, second = (self._poses[frame][i][1] for i in (before, after))
        if before == after:
            return _matrix(first)
        share = (t - times[before]) / (times[after] - times[before])
        between = Slerp([0, 1], Rotation.from_quat([first[3:], second[3:]]))(share)
        position = (1 - share) * np.array(first[:3]) + share * np.array(second[:3])
        return _matrix((*position, *between.as_quat()))


class Listener:
    """Puts what it is given into a buffer, as that of tf2 does with what comes on /tf."""

    def __init__(self, buffer: Any, _node: object) -> None:
        self.buffer = buffer


def make_tf(monkeypatch: pytest.MonkeyPatch, parameters: FilterParameters) -> tuple[Tf, Listener]:
    """Make the motion that is said by tf, with a buffer of this kind."""
    module = SimpleNamespace(
        Buffer=Buffer, TransformListener=Listener, TransformException=UnknownTransformError
    )
    monkeypatch.setitem(sys.modules, 'tf2_ros', cast('Any', module))
    made = Tf(cast('Node', None), parameters)
    return made, cast('Listener', made._listener)


def transform(parent: str, child: str, t: int, pose: tuple[float, ...]) -> TransformStamped:
    """Make a transform: nanoseconds, and x y z in metres with a quaternion x y z w."""
    msg = TransformStamped()
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(t, SECOND)
    msg.header.frame_id, msg.child_frame_id = parent, child
    p, q = msg.transform.translation, msg.transform.rotation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = pose
    return msg


def _message(parent: str, child: str, t: int, matrix: Floats) -> TransformStamped:
    quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    pose = (*matrix[:3, 3].tolist(), *quaternion.tolist())
    return transform(parent, child, t, pose)


def _pose(msg: Any) -> tuple[float, ...]:
    p, q = msg.transform.translation, msg.transform.rotation
    return (p.x, p.y, p.z, q.x, q.y, q.z, q.w)


def _matrix(pose: tuple[float, ...]) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(pose[3:]).as_matrix()
    matrix[:3, 3] = pose[:3]
    return matrix
