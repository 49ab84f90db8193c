# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Play a recording, of ROS 1 or 2, where there is no ``ros2 bag play``.

python play.py RECORDING        # begins when somebody listens to one of its topics
python play.py RECORDING 0.5    # at half the speed
"""

import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

POLL = 0.1  # seconds
TIMEOUT = Duration(seconds=10)


def publisher(connection: Connection) -> Any:
    """Publish a topic; where its package is missing, say so, and leave it out."""
    package, _, kind = connection.msgtype.split('/')
    try:
        message = getattr(import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        sys.stderr.write(f'{connection.topic} is left out: no {connection.msgtype} here\n')
        return None
    latched = connection.topic.endswith('tf_static')
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    qos = QoSProfile(depth=10, durability=durability)
    return me.create_publisher(message, connection.topic, qos)


def play(reader: AnyReader, speed: float) -> int:
    """Publish all messages at the pace of their times; return how many."""
    by_topic = {one.topic: publisher(one) for one in reader.connections}
    publishers = {topic: one for topic, one in by_topic.items() if one is not None}
    if not publishers:
        sys.exit('a recording must have topics to publish, got none')
    while not any(one.get_subscription_count() for one in publishers.values()):
        time.sleep(POLL)
    count, begin = 0, time.monotonic()
    for connection, stamp, data in reader.messages(
        [one for one in reader.connections if one.topic in publishers]
    ):
        due = begin + (stamp - reader.start_time) * 1e-9 / speed
        time.sleep(max(0.0, due - time.monotonic()))
        cdr = data if reader.is2 else reader.typestore.ros1_to_cdr(data, connection.msgtype)
        publishers[connection.topic].publish(bytes(cdr))
        count += 1
    for one in publishers.values():
        one.wait_for_all_acked(TIMEOUT)
    return count


if __name__ == '__main__':
    rclpy.init()
    me = rclpy.create_node('play')
    with AnyReader([Path(sys.argv[1])]) as recording:
        speed = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0  # noqa: PLR2004  the second argument
        sys.stdout.write(f'{play(recording, speed)} messages\n')
