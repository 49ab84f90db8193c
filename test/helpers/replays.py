# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings, and the answers of a replay."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import PointCloud2, PointField

from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import LATCHED, NewBag, Recording, Topic

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    Content = dict[str, list[tuple[int, bytes]]]


STORE = get_typestore(Stores.ROS2_JAZZY)
STRING = 'std_msgs/msg/String'
DOOR = 'shop_msgs/msg/Door'
STORE.register(get_types_from_msg('string name\nfloat64 angle\n', DOOR))

REAL = [
    'cloudini_lidar_link_mcap',
    'hdl32_mrpt_mcap',
    'hesai_xt32_nebula_mcap',
    'os0_32.bag',
    'os1_128_db3',
    'vlp16_mrpt.bag',
    'vlp16_mrpt_db3',
    'vlp16_mrpt_mcap',
    'vlp32_nebula.bag',
    'vlp32_nebula_db3',
]

PERIOD = 100_000_000  # ns between two clouds
FIELDS = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('time', '<f4'), ('ring', '<u2')]
ROW = np.dtype(FIELDS)


def topic_of(name: str, msgtype: str) -> Topic:
    """Describe a topic of a known type."""
    definition = STORE.generate_msgdef(msgtype, ros_version=2)[0]
    return Topic(name, msgtype, definition, STORE.hash_rihs01(msgtype), (LATCHED,))


def cloud(index: int, points: int = 200) -> Any:
    """Make one ring of 0.1 s: a wall with noise, and three points far before it."""
    rng = np.random.default_rng(index)
    rows = np.zeros(points, ROW)
    rows['time'] = np.arange(points) * (0.1 / points)
    rows['x'] = 10 + rng.normal(0, 0.01, points)
    rows['y'] = np.linspace(-5, 5, points)
    rows['x'][rng.choice(points, 3, replace=False)] -= 3
    msg = PointCloud2(
        height=1, width=points, point_step=ROW.itemsize, row_step=points * ROW.itemsize
    )
    msg.header.frame_id = 'lidar'
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(index * PERIOD, 10**9)
    kinds = {'<f4': PointField.FLOAT32, '<u2': PointField.UINT16}
    msg.fields = [
        PointField(name=name, offset=4 * number, datatype=kinds[kind], count=1)
        for number, (name, kind) in enumerate(FIELDS)
    ]
    msg.data = rows.tobytes()
    return msg


def write_drive(path: Path, clouds: Iterable[Any], lidars: Iterable[str] = ('/lidar',)) -> Path:
    """Write clouds of some lidars, a text before each, an own type and a silent topic."""
    points = [topic_of(name, CLOUD) for name in lidars]
    text, door, silent = topic_of('/text', STRING), topic_of('/door', DOOR), topic_of('/s', STRING)
    with NewBag(path) as bag:
        for topic in (*points, text, door, silent):
            bag.add(topic)
        bag.write(door, 0, cdr(DOOR, 'front', 0.5))
        for index, msg in enumerate(clouds):
            bag.write(text, index * PERIOD, cdr(STRING, f'cloud {index}'))
            for topic in points:
                data = msg if isinstance(msg, bytes) else serialize_message(msg)
                bag.write(topic, index * PERIOD, data)
    return path


def cdr(msgtype: str, *values: Any) -> bytes:
    """Serialize a message."""
    return STORE.serialize_cdr(STORE.types[msgtype](*values), msgtype).tobytes()


def content(path: Path) -> Content:
    """Read all messages of a recording, by topic."""
    with Recording(path) as recording:
        found: Content = {topic.name: [] for topic in recording.topics}
        for topic, time, data in recording.messages():
            found[topic.name].append((time, data))
    return found


def rows_of(msg: Any) -> list[bytes]:
    """Cut a cloud into the bytes of its points."""
    data, step = bytes(msg.data), msg.point_step
    assert msg.row_step == msg.width * step
    assert len(data) == msg.row_step * msg.height
    return [data[start : start + step] for start in range(0, len(data), step)]


def is_part(part: list[bytes], whole: list[bytes]) -> bool:
    """Return whether the rows of the part are in the whole, in their order."""
    rest = iter(whole)
    return all(row in rest for row in part)


def check_answers(before: Content, after: Content, topic: str) -> None:
    """Hold that each cloud has two answers with its header and bag time, and all of its points."""
    answers = zip(before[topic], after[f'{topic}/cleaned'], after[f'{topic}/outliers'], strict=True)
    for (time, data), (cleaned_time, cleaned_data), (outliers_time, outliers_data) in answers:
        assert time == cleaned_time == outliers_time
        msg, cleaned, outliers = (
            deserialize_message(item, PointCloud2) for item in (data, cleaned_data, outliers_data)
        )
        assert msg.header == cleaned.header == outliers.header
        assert msg.fields == cleaned.fields == outliers.fields
        whole, kept, rejected = rows_of(msg), rows_of(cleaned), rows_of(outliers)
        assert Counter(kept) + Counter(rejected) == Counter(whole)
        assert is_part(kept, whole)
        assert is_part(rejected, whole)
