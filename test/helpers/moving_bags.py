# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a sensor that moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from helpers.moving_sensor import MOVING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sensor_msgs.msg import PointCloud2

    from helpers.profile_scanner import Drive


def write(
    path: Path,
    drive: Drive,
    topics: tuple[str, ...] = ('/points',),
    late: Sequence[PointCloud2] = (),
) -> Path:
    """Write a recording: clouds at the end of their time, odometry a little after its own.

    Some clouds may be late by a minute.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        events = []
        for topic in topics:
            where = bag.add_connection(topic, 'sensor_msgs/msg/PointCloud2', typestore=store)
            events += [(_time(msg) + 10**8, where, msg) for msg in drive.clouds(drive.own)]
            events += [(_time(msg) + 60 * 10**9, where, msg) for msg in late]
        where = bag.add_connection('/odom', 'nav_msgs/msg/Odometry', typestore=store)
        events += [(_time(msg) + 3 * 10**7, where, msg) for msg in drive.odometry()]
        for time, connection, msg in sorted(events, key=lambda event: event[0]):
            bag.write(connection, time, bytes(serialize_message(msg)))
    return path


def _time(msg: object) -> int:
    stamp = msg.header.stamp  # type: ignore[attr-defined]
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


REPLAYED = MOVING | {'motion.topic': '/odom'}
