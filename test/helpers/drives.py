# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small recordings for tests, how they are read back, and what is compared of their replays."""

import resource
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosbags.typesys import get_types_from_msg

from helpers.clouds import SECOND, STORE, cloud, to_bytes
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.pipeline.topics import CLOUD, ODOMETRY
from lidar_outlier_filter.recordings.bags import LATCHED, NewBag, Recording, Topic

PERIOD = SECOND // 10  # between two clouds
BEGIN = 1_750_000_000 * SECOND
ROW = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('time', '<f4'), ('ring', '<u2')])
FAST: Mapping[str, object] = {'chain': ['alpha_beta_gamma', 'elevation']}
STRING, DOOR = 'std_msgs/msg/String', 'shop_msgs/msg/Door'
STORE.register(get_types_from_msg('string name\nfloat64 angle\n', DOOR))


def topic_of(name: str, msgtype: str) -> Topic:
    """Describe a topic of a known type."""
    definition = STORE.generate_msgdef(msgtype, ros_version=2)[0]
    return Topic(name, msgtype, definition, STORE.hash_rihs01(msgtype), (LATCHED,))


def cdr(msgtype: str, *values: Any) -> bytes:
    """Serialize a message."""
    return STORE.serialize_cdr(STORE.types[msgtype](*values), msgtype).tobytes()


def content(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Read all messages of a recording, by topic."""
    with Recording(path) as recording:
        found: dict[str, list[tuple[int, bytes]]] = {topic.name: [] for topic in recording.topics}
        for topic, time, data in recording.messages():
            found[topic.name].append((time, data))
    return found


def rows_of_turn(number: int, points: int = 120) -> Rows:
    """Make one turn of two rings within a noisy cylinder, with three points far inside."""
    rng = np.random.default_rng(number)
    rows = np.zeros(points, ROW)
    rows['time'] = np.arange(points) * (0.099 / points)
    rows['ring'] = np.arange(points) % 2
    angle = 2 * np.pi * np.arange(points) / points
    distance = 10 + rng.normal(0, 0.01, points)
    distance[rng.choice(points, 3, replace=False)] -= 4
    rows['x'], rows['y'] = distance * np.cos(angle), distance * np.sin(angle)
    rows['z'] = rows['ring'] * 0.5
    return rows


def cloud_bytes(rows: Rows, stamp: int, columns: tuple[str, ...] = ROW.names or ()) -> bytes:
    """Serialize rows as a cloud, with some of their columns."""
    kept = np.empty(len(rows), [(name, ROW[name]) for name in columns])
    for name in columns:
        kept[name] = rows[name]
    return to_bytes(cloud(kept, stamp))


def pose_bytes(stamp: int, x: float) -> bytes:
    """Serialize an odometry at ``x``, metres, on a straight way."""
    msg = Odometry(child_frame_id='base')
    msg.header.frame_id = 'odom'
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, SECOND)
    msg.pose.pose.position = Point(x=x)
    return bytes(serialize_message(msg))


def write_drive(  # noqa: PLR0913  what may differ
    path: Path,
    clouds: int = 30,
    lidars: tuple[str, ...] = ('/lidar',),
    stamp_of: Callable[[int], int] = lambda number: BEGIN + number * PERIOD,
    columns: tuple[str, ...] = ROW.names or (),
    seed: int = 0,
    points: int = 120,
) -> Path:
    """Write a recording of turns, 10 in a second, with an odometry every 50 ms.

    ``stamp_of`` gives the stamp of each turn, ns; bag times go on evenly all the same.
    """
    names = [topic_of(name, CLOUD) for name in lidars]
    odometry = topic_of('/odometry', ODOMETRY)
    with NewBag(path) as bag:
        for topic in (*names, odometry):
            bag.add(topic)
        for number in range(clouds):
            arrived = BEGIN + (number + 1) * PERIOD
            for step in (0, 1):
                at = BEGIN + number * PERIOD + step * PERIOD // 2
                bag.write(odometry, at, pose_bytes(at, (2 * number + step) * 0.01))
            for series, topic in enumerate(names):
                rows = rows_of_turn(seed + 1000 * series + number, points)
                bag.write(topic, arrived, cloud_bytes(rows, stamp_of(number), columns))
        bag.write(odometry, arrived, pose_bytes(arrived, 2 * clouds * 0.01))
    return path


def faults_of_a_cloud() -> int:
    """Count the pages that the system gives for 40 MB, after the first time."""
    bytearray(40_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    bytearray(40_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def hashes(path: Path) -> dict[str, str]:
    """Hash the files of a bag."""
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in sorted(path.iterdir())}
