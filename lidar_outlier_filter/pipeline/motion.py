# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The motion step: clouds wait for their poses, and leave moved to the fixed frame.

Only the points that detectors see are moved. Published clouds keep their frame and their bytes.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Generic, Protocol

from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.core.engine.stream_cloud import BEGINNING, AnyCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.poses import SensorExtrinsics, Track
from lidar_outlier_filter.errors import PoseError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.statistics import CountsByReason
from lidar_outlier_filter.pipeline.topics import ODOMETRY


class PoseSource(Protocol):
    """Source of the sensor's poses."""

    topic: str  # of nav_msgs/Odometry; empty: none
    refusals: CountsByReason  # of poses

    @property
    def listeners(self) -> Mapping[tuple[str, str], Callable[[Any], None]]:
        """The methods that take the messages, by topic, as given, and type."""
        ...

    def take(self, msg: Any) -> None:
        """Add the next message with a pose; an invalid one is counted."""

    def reaches(self, last: int, frame: str) -> bool:
        """Return whether the pose of ``frame`` at ``last`` (ns) is known, or never will be."""

    def move(self, points: Points, frame: str) -> tuple[Points, Bools]:
        """Move points from ``frame`` to the fixed frame.

        Returns the points and which of them, (N,) bool, were moved. That depends on the time of
        each point alone.
        """

    def reset(self) -> None:
        """Forget all poses, because the clock of the points was set back.

        If their own clock was set back first, the poses since then are kept.
        """


class Odometry:
    """Poses of nav_msgs/Odometry messages, and the sensor's place in their child frame."""

    def __init__(self, parameters: FilterParameters) -> None:
        motion = parameters.motion
        self.topic = motion.topic
        self.refusals = CountsByReason()
        self.listeners = {(self.topic, ODOMETRY): self.take}
        self._track = Track(motion.max_gap, parameters.time_jump)
        self._extrinsics = SensorExtrinsics.at(
            (motion.x, motion.y, motion.z), (motion.roll, motion.pitch, motion.yaw)
        )

    def take(self, msg: Any) -> None:
        """Add the next odometry; an invalid one is counted."""
        stamp, pose = msg.header.stamp, msg.pose.pose
        p, q = pose.position, pose.orientation
        try:
            self._track.add(stamp.sec * SECOND + stamp.nanosec, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))
        except PoseError as err:
            self.refusals.note(err.what)

    def reaches(self, last: int, _frame: str) -> bool:
        """Return whether there is odometry up to ``last``."""
        return self._track.reaches(last)

    def move(self, points: Points, _frame: str) -> tuple[Points, Bools]:
        """Move points from the sensor to the frame of the odometry, where there is odometry."""
        return self._track.move(points, self._extrinsics)

    def reset(self) -> None:
        """Forget all odometry."""
        self._track.reset()


class PoseQueue(Generic[AnyCloud]):
    """Clouds that wait for their poses, in order.

    A cloud and all clouds behind it wait until its last pose is known, or until points arrive
    that are more than ``max_delay`` later. Points without pose keep the sensor's frame and
    are judged apart from moved ones.

    Attributes
    ----------
    clouds : deque of clouds
        Oldest first.
    points : int
        Their points, missing returns included.
    newest : int
        Latest time of any point, nanoseconds.
    without_pose : int
        Number of clouds that left with points that were not moved.

    """

    def __init__(self, source: PoseSource | None, parameters: FilterParameters) -> None:
        """Wait for the poses of a source; without one no cloud waits, and none is moved."""
        self.without_pose = 0
        self._source = source
        self.set_max_delay(parameters.max_delay)
        self._clear()

    def _clear(self) -> None:
        self.clouds: deque[AnyCloud] = deque()
        self.points = 0
        self.newest = BEGINNING

    def set_max_delay(self, seconds: float) -> None:
        """Let clouds wait for their poses no longer than this."""
        self._max_delay = round(seconds * SECOND)

    def append(self, cloud: AnyCloud) -> None:
        """Add the next cloud. Its ``frame`` is that of its coordinates."""
        self.clouds.append(cloud)
        self.points += cloud.count

    def ready(self) -> Iterator[AnyCloud]:
        """Release the clouds that need not wait any longer."""
        while self.clouds and self._is_ready(self.clouds[0]):
            yield self.release()

    def release_all(self) -> Iterator[AnyCloud]:
        """Release all clouds, moved by the poses that are known."""
        while self.clouds:
            yield self.release()

    def release(self) -> AnyCloud:
        """Release the oldest cloud, moved by the poses that are known.

        With a pose source, ``frame`` becomes '' if all points are moved, else ``own: …``.
        """
        cloud = self.clouds.popleft()
        self.points -= cloud.count
        if self._source is None:
            return cloud
        cloud.points, moved = self._source.move(cloud.points, cloud.frame)
        if moved.all():
            cloud.frame = ''
        else:
            self.without_pose += 1
            cloud.frame = f'own: {cloud.frame}'
            if moved.any():
                cloud.points = replace(cloud.points, fixed=moved)
        return cloud

    def reset(self) -> None:
        """Forget the poses and the time; the queue is empty."""
        self._clear()
        if self._source is not None:
            self._source.reset()

    def _is_ready(self, cloud: AnyCloud) -> bool:
        is_late = cloud.last < max(cloud.first, self.newest - self._max_delay)
        return self._source is None or is_late or self._source.reaches(cloud.last, cloud.frame)
