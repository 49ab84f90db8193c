# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What comes in on the topics of one sensor: clouds go to the inbox, poses to their source.

All of it runs in the executor's thread. rclpy copies the points of a cloud three times before it
hands them over, and no other thread can work meanwhile. So all but the points is left to rclpy, and
they are viewed in the bytes received.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import CloudError, said_by
from lidar_outlier_filter.ros.backlog import Received
from lidar_outlier_filter.ros.subscriptions import end, subscribe, subscribe_odometry

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from nav_msgs.msg import Odometry
    from rclpy.node import Node
    from rclpy.subscription import Subscription

    from lidar_outlier_filter.pipeline.motion import PoseSource
    from lidar_outlier_filter.ros.health import Health
    from lidar_outlier_filter.ros.worker import Worker

PLAIN_CDR = {b'\x00\x00': '>', b'\x00\x01': '<'}  # the representations whose layout is known here
START = 4  # behind the identifier of the representation; alignment counts from there


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


def read_cloud(received: bytes) -> PointCloud2:
    """Read a cloud as it was received; its ``data`` is a read-only memoryview of it.

    Such a cloud is to be read and split, not to be sent. One in another representation than plain
    CDR is left to rclpy as a whole.

    Raises
    ------
    CloudError
        If it ends too early, or is no cloud.

    """
    order = PLAIN_CDR.get(received[:2])
    if order is None:
        return _by_rclpy(received)
    try:
        begin = _find_data(received, order)
        (size,) = struct.unpack_from(order + 'I', received, begin - 4)
        end = begin + size
        # The same cloud without points: no number in it, and behind it only is_dense.
        bare = received[: begin - 4] + bytes(4) + struct.pack('?', received[end])
    except (struct.error, IndexError) as err:
        raise CloudError('a serialised cloud', 'whole', f'{len(received)} bytes') from err
    msg = _by_rclpy(bare)
    # Past the setter, which takes an array only, or looks at every byte.
    msg._data = memoryview(received)[begin:end]  # noqa: SLF001
    return msg


def _by_rclpy(data: bytes) -> PointCloud2:
    try:
        return deserialize_message(data, PointCloud2)
    except RuntimeError as err:  # of the middleware
        must_be = 'a sensor_msgs/msg/PointCloud2'
        raise CloudError('a serialised cloud', must_be, f'other bytes ({said_by(err)})') from err


def _find_data(received: bytes, order: str) -> int:
    """Return where the points begin."""
    at = _behind_string(received, order, START + 8)  # header: stamp, frame_id
    at = _aligned(at) + 8  # height, width
    (fields,) = struct.unpack_from(order + 'I', received, at)
    at += 4
    for _ in range(fields):
        at = _behind_string(received, order, at)
        at = _aligned(_aligned(at) + 5) + 4  # offset, datatype, count
    return _aligned(at + 1) + 12  # is_bigendian, point_step, row_step, size of the points


def _behind_string(received: bytes, order: str, at: int) -> int:
    at = _aligned(at)
    (size,) = struct.unpack_from(order + 'I', received, at)
    return at + 4 + int(size)


def _aligned(at: int) -> int:
    """Go on to the next multiple of four, as every number but a single byte does."""
    return START + -(-(at - START) // 4) * 4
