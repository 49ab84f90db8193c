# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the sensor was when: from odometry, or from tf. Messages are duck-typed.

Only the points that detectors see are moved. What is published keeps its frame and its bytes.
"""

from __future__ import annotations

import importlib
from collections import Counter
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from lidar_outlier_filter.core.points import SECOND, Points
from lidar_outlier_filter.core.poses import Cover, Mounting, Track
from lidar_outlier_filter.errors import ParameterError, PoseError
from lidar_outlier_filter.tf_links import Links

if TYPE_CHECKING:
    from rclpy.node import Node

    from lidar_outlier_filter.parameters import FilterParameters

STEP = SECOND // 100  # between two looks into tf: vehicles turn slowly


class Motion(Protocol):
    """What knows where the sensor was."""

    topic: str  # of nav_msgs/Odometry; empty: none
    refusals: Counter[str]  # poses, by what was wrong

    def take(self, msg: Any) -> None:
        """Take the next message with a pose; one that makes no sense is counted."""

    def cover(self, first: int, last: int, frame: str) -> Cover:
        """Tell whether it is known where ``frame`` was from ``first`` to ``last`` (ns), both."""

    def move(self, points: Points, frame: str) -> Points | None:
        """Move points from ``frame`` to the frame that stands still; None if that is not known."""

    def begin_anew(self) -> None:
        """Forget what was before: the clock of the points was set back.

        What has begun anew by itself is kept: poses may be set back before the points are.
        """


class Odometry:
    """nav_msgs/Odometry, and where the sensor is in its child frame."""

    def __init__(self, parameters: FilterParameters) -> None:
        """Take the mounting and the longest gap."""
        motion = parameters.motion
        self.topic = motion.topic
        self.refusals: Counter[str] = Counter()
        self._track = Track(motion.max_gap, parameters.time_jump)
        self._track.compile()
        self._mounting = Mounting.at(
            (motion.x, motion.y, motion.z), (motion.roll, motion.pitch, motion.yaw)
        )

    def take(self, msg: Any) -> None:
        """Take the next odometry; one that makes no sense is counted."""
        stamp, pose = msg.header.stamp, msg.pose.pose
        p, q = pose.position, pose.orientation
        try:
            self._track.add(stamp.sec * SECOND + stamp.nanosec, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))
        except PoseError as err:
            self.refusals[err.what] += 1

    def cover(self, first: int, last: int, _frame: str) -> Cover:
        """Tell whether there is odometry from ``first`` to ``last``."""
        return self._track.cover(first, last)

    def move(self, points: Points, _frame: str) -> Points | None:
        """Move points from the sensor to the frame of the odometry."""
        return self._track.move(points, self._mounting)

    def begin_anew(self) -> None:
        """Forget the odometry of before."""
        self._track.begin_anew()


class Tf:
    """tf2: the transform from the frame of the cloud to one that stands still.

    It is looked up every 10 ms and interpolated between, because one look takes 10 µs and a cloud
    has as many times as points. tf2 interpolates over any gap, so gaps are looked for here.
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
        from rclpy.time import Duration, Time  # noqa: PLC0415  the odometry of a test needs no ROS

        self.topic = ''
        self._fixed = parameters.motion.fixed_frame
        self.refusals: Counter[str] = Counter()
        self._time: Any = lambda t: Time(nanoseconds=t)
        self._jump, self._gap = parameters.time_jump, parameters.motion.max_gap
        self._buffer: Any = tf2_ros.Buffer(cache_time=Duration(seconds=60), node=node)
        Track.compile()
        self._unknown: Any = tf2_ros.TransformException
        self._links = Links(self._buffer, parameters.time_jump)
        self._listener = tf2_ros.TransformListener(self._links, node)

    def take(self, msg: Any) -> None:
        """Do nothing: tf2 has its own subscriptions."""

    def cover(self, first: int, last: int, frame: str) -> Cover:
        """Tell whether tf knows ``frame`` from ``first`` to ``last``."""
        if first <= 0:
            return Cover.NEVER  # to tf2 0 is the latest time, and one before it an error
        if not self._buffer.can_transform(self._fixed, frame, self._time(last)):
            return Cover.NOT_YET
        if not self._buffer.can_transform(self._fixed, frame, self._time(first)):
            return Cover.NEVER
        longest = round(self._gap * SECOND)
        has_gap = self._links.has_gap(self._fixed, frame, first, last, longest)
        return Cover.NEVER if has_gap else Cover.YES

    def move(self, points: Points, frame: str) -> Points | None:
        """Move points from ``frame`` to the one that stands still."""
        known = points.t[points.valid]
        if not len(known):
            return points
        first, last = int(known.min()), int(known.max())
        track = Track(self._gap, self._jump)
        for t in np.unique(np.append(np.arange(first, last, STEP), last)).tolist():
            try:
                found = self._buffer.lookup_transform(self._fixed, frame, self._time(t))
                p, q = found.transform.translation, found.transform.rotation
                track.add(t, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))
            except self._unknown:
                return None
            except PoseError as err:
                self.refusals[err.what] += 1
                return None
        self._links.caught_up()
        return track.move(points, Mounting.at((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))

    def begin_anew(self) -> None:
        """Forget the transforms of before; those that hold for ever stay."""
        self._links.begin_anew()


def make_motion(node: Node, parameters: FilterParameters) -> Motion | None:
    """Make what ``motion.source`` asks for; None for 'none'.

    Raises
    ------
    ParameterError
        If it is not to be had here.

    """
    if parameters.motion.source == 'none':
        return None
    return Odometry(parameters) if parameters.motion.source == 'odometry' else Tf(node, parameters)
