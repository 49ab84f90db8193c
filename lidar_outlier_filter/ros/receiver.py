# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What comes in on the topics of one sensor: clouds go to the inbox, poses to their source.

All of it runs in the executor's thread.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.ros.backlog import Received
from lidar_outlier_filter.ros.cdr import read_cloud
from lidar_outlier_filter.ros.subscriptions import end, subscribe, subscribe_odometry

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from nav_msgs.msg import Odometry
    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from sensor_msgs.msg import PointCloud2

    from lidar_outlier_filter.ros.health import Health
    from lidar_outlier_filter.ros.worker import Worker
    from lidar_outlier_filter.stream.motion import PoseSource


class CloudReceiver:
    """Subscribes to the clouds of one topic, and to the odometry that they need."""

    def __init__(
        self, node: Node, topic: str, worker: Worker, health: Health, motion: PoseSource | None
    ) -> None:
        """Hand clouds to ``worker``; nothing is subscribed to yet."""
        self._node = node
        self._topic = topic
        self._worker = worker
        self._health = health
        self._motion = motion
        self._clouds: Subscription | None = None
        self._odometry: Subscription | None = None

    def start(self) -> None:
        """Subscribe."""
        if self._motion is not None and self._motion.topic:
            self._odometry = subscribe_odometry(self._node, self._motion.topic, self._take_pose)
        self._clouds = subscribe(self._node, self._topic, self._take, self._lost)

    def end(self) -> list[Received]:
        """Receive no more; return the clouds that were received and not served."""
        clouds, self._clouds = self._clouds, None
        odometry, self._odometry = self._odometry, None
        # The poses last: those of the last clouds may come behind them.
        received = [] if clouds is None else end(self._node, clouds)
        for msg in [] if odometry is None else end(self._node, odometry):
            self._take_pose(msg)
        return [self._noted(msg) for msg in self._read(received)]

    def take(self, msg: PointCloud2) -> None:
        """Put a cloud into the inbox."""
        self._worker.raise_failure()
        self._health.dropped(self._worker.inbox.put(self._noted(msg)))

    def _take(self, data: bytes) -> None:
        for msg in self._read([data]):
            self.take(msg)

    def _read(self, received: Iterable[bytes]) -> Iterator[PointCloud2]:
        """Read clouds; those that make no sense are counted."""
        for data in received:
            try:
                yield read_cloud(data)
            except CloudError as err:
                self._worker.refuse(err)

    def _noted(self, msg: PointCloud2) -> Received:
        """Count a cloud, and note when it was received."""
        self._health.received(msg.width * msg.height)
        return Received(msg, self._worker.clock.now(), len(msg.data))

    def _take_pose(self, msg: Odometry) -> None:
        if self._motion is not None:
            self._motion.take(msg)
            self._worker.inbox.wake()

    def _lost(self, event: Any) -> None:
        self._health.lost(event.total_count_change)
