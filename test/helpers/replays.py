# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings, and the outputs of a replay."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from helpers.clouds import cloud as cloud_of
from helpers.clouds import point_bytes
from helpers.drives import DOOR, PERIOD, ROW, STRING, cdr, write_messages
from lidar_outlier_filter.pipeline.topics import CLOUD

Content = dict[str, list[tuple[int, bytes]]]

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


def cloud(index: int, points: int = 200) -> Any:
    """Make one ring of 0.1 s: a wall with noise, and three points far before it."""
    rng = np.random.default_rng(index)
    rows = np.zeros(points, ROW)
    rows['time'] = np.arange(points) * (0.1 / points)
    rows['x'] = 10 + rng.normal(0, 0.01, points)
    rows['y'] = np.linspace(-5, 5, points)
    rows['x'][rng.choice(points, 3, replace=False)] -= 3
    return cloud_of(rows, index * PERIOD)


def write_drive(path: Path, clouds: Iterable[Any], lidars: Iterable[str] = ('/lidar',)) -> Path:
    """Write clouds of some lidars, a text before each, an own type and a silent topic."""
    topics = dict.fromkeys(lidars, CLOUD) | {'/text': STRING, '/door': DOOR, '/s': STRING}
    messages = [('/door', 0, cdr(DOOR, 'front', 0.5))]
    for index, msg in enumerate(clouds):
        time, data = index * PERIOD, msg if isinstance(msg, bytes) else serialize_message(msg)
        messages.append(('/text', time, cdr(STRING, f'cloud {index}')))
        messages += [(name, time, data) for name in lidars]
    return write_messages(path, topics, messages)


def is_part(part: list[bytes], whole: list[bytes]) -> bool:
    """Return whether the rows of the part are in the whole, in their order."""
    rest = iter(whole)
    return all(row in rest for row in part)


def check_outputs(before: Content, after: Content, topic: str) -> None:
    """Hold that each cloud has two outputs with its header and bag time, and all of its points."""
    results = zip(before[topic], after[f'{topic}/cleaned'], after[f'{topic}/outliers'], strict=True)
    for (time, data), (cleaned_time, cleaned_data), (outliers_time, outliers_data) in results:
        assert time == cleaned_time == outliers_time
        msg, cleaned, outliers = (
            deserialize_message(item, PointCloud2) for item in (data, cleaned_data, outliers_data)
        )
        assert msg.header == cleaned.header == outliers.header
        assert msg.fields == cleaned.fields == outliers.fields
        whole, kept, rejected = map(point_bytes, (msg, cleaned, outliers))
        assert Counter(kept) + Counter(rejected) == Counter(whole)
        assert is_part(kept, whole)
        assert is_part(rejected, whole)
