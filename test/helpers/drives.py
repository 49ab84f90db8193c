# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small recordings for tests, how they are read back, and what is compared of their replays."""

import resource
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg

from helpers.clouds import SECOND, STORE, cloud, to_bytes
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.pipeline.topics import CLOUD
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


def first_cloud(path: Path) -> Any:
    """Read the first cloud of a recording."""
    with Recording(path) as recording:
        for topic, _, data in recording.messages():
            if topic.msgtype == CLOUD:
                return STORE.deserialize_cdr(data, CLOUD)
    raise AssertionError(path)


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


def write_messages(
    path: Path, topics: Mapping[str, str], messages: Iterable[tuple[str, int, bytes]]
) -> Path:
    """Write a recording of topics, each of a type: topic, bag time and bytes of each message."""
    known = {name: topic_of(name, msgtype) for name, msgtype in topics.items()}
    with NewBag(path) as bag:
        for topic in known.values():
            bag.add(topic)
        for name, time, data in messages:
            bag.write(known[name], time, data)
    return path


def write_drive(path: Path, clouds: int, seed: int = 0, points: int = 120) -> Path:
    """Write a recording of turns, 10 in a second, and of a text before each."""
    messages: list[tuple[str, int, bytes]] = []
    for number in range(clouds):
        begin = BEGIN + number * PERIOD
        turn = to_bytes(cloud(rows_of_turn(seed + number, points), begin))
        messages += [('/text', begin, cdr(STRING, 'turn')), ('/lidar', begin + PERIOD, turn)]
    return write_messages(path, {'/lidar': CLOUD, '/text': STRING}, messages)


def faults_of_a_cloud() -> int:
    """Count the pages that the system gives for 40 MB, after the first time."""
    bytearray(40_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    bytearray(40_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def hashes(path: Path) -> dict[str, str]:
    """Hash the files of a bag."""
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in sorted(path.iterdir())}
