# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the sensor was when, by odometry. Messages are duck-typed.

Only the points that detectors see are moved. What is published keeps its frame and its bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.poses import Mounting, Track
from lidar_outlier_filter.errors import PoseError
from lidar_outlier_filter.pipeline.statistics import Kinds

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools
    from lidar_outlier_filter.parameters.filter import FilterParameters


class PoseSource(Protocol):
    """What knows where the sensor was."""

    topic: str  # of nav_msgs/Odometry; empty: none
    refusals: Kinds  # poses, by what was wrong

    def take(self, msg: Any) -> None:
        """Take the next message with a pose; one that makes no sense is counted."""

    def reaches(self, last: int, frame: str) -> bool:
        """Return whether it is known where ``frame`` was at ``last`` (ns); or never will be."""

    def move(self, points: Points, frame: str) -> tuple[Points, Bools]:
        """Move points from ``frame`` to the frame that stands still, where that is known.

        Returns the points and which of them, (N,) bool, were moved. That depends on the time of
        each, and not on the others.
        """

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
        self.refusals = Kinds()
        self._track = Track(motion.max_gap, parameters.time_jump)
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
            self.refuse(err.what)

    def refuse(self, what: str) -> None:
        """Count a pose that was refused, by what was wrong."""
        self.refusals.note(what)

    def reaches(self, last: int, _frame: str) -> bool:
        """Return whether there is odometry up to ``last``."""
        return self._track.reaches(last)

    def move(self, points: Points, _frame: str) -> tuple[Points, Bools]:
        """Move points from the sensor to the frame of the odometry, where there is odometry."""
        return self._track.move(points, self._mounting)

    def begin_anew(self) -> None:
        """Forget the odometry of before."""
        self._track.begin_anew()
