# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings for tests whose truth is known: small ones made by hand, and outputs to them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_filter.recordings.bags import NewBag, Topic
from lidar_outlier_lab.simulation.world.recording import to_message

CLOUD, STRING = 'sensor_msgs/msg/PointCloud2', 'std_msgs/msg/String'
STORE = get_typestore(Stores.ROS2_JAZZY)
POINT = np.dtype(
    [(axis, '<f4') for axis in 'xyz'] + [('t', '<u4'), ('label', 'u1'), ('surface', 'u1')]
)
SCORED = np.dtype([*POINT.descr, ('outlier_score', '<f4'), ('outlier_detectors', '<u2')])
# Label, surface, rejected, score: two of three outliers are found, one of five good points is lost.
TRUTH = np.array(
    [
        [Cause.GOOD, Kind.ROAD, 0, 0.1],
        [Cause.EXHAUST, Kind.AIR, 1, 3.0],
        [Cause.GOOD, Kind.ROAD, 1, 1.5],
        [Cause.EXHAUST, Kind.AIR, 0, np.nan],
        [Cause.MIXED, Kind.CAR, 1, 9.0],
        [Cause.GOOD, Kind.CAR, 0, 0.5],
        [Cause.GOOD, Kind.ROAD, 0, np.nan],
        [Cause.GOOD, Kind.POLE, 0, 1.0],
    ]
)
BAD = TRUTH[:, 0] != Cause.GOOD
REJECTED = TRUTH[:, 2] != 0


def rows(dtype: np.dtype[np.void] = POINT) -> Rows:
    """Make the points of ``TRUTH``, the i-th at x = 10 i + 1."""
    cloud = np.zeros(len(TRUTH), dtype)
    cloud['x'] = 10 * np.arange(len(TRUTH)) + 1
    cloud['t'] = 1000 * np.arange(len(TRUTH))
    cloud['label'], cloud['surface'] = TRUTH[:, 0], TRUTH[:, 1]
    if dtype == SCORED:
        cloud['outlier_score'] = TRUTH[:, 3]
        cloud['outlier_detectors'] = np.where(REJECTED, [1, 1, 5, 1, 4, 1, 1, 1], 0)
    return cloud


def results(
    clouds: Sequence[Rows], rejected: Sequence[NDArray[np.bool_]], topic: str = '/lidar'
) -> dict[str, list[Rows]]:
    """Split clouds as verdicts say."""
    pairs = list(zip(clouds, rejected, strict=True))
    return {
        f'{topic}/cleaned': [cloud[~mask] for cloud, mask in pairs],
        f'{topic}/outliers': [cloud[mask] for cloud, mask in pairs],
    }


def write(
    path: Path, topics: Mapping[str, Sequence[Any]], without: str = '', *, beside: str = ''
) -> Path:
    """Record clouds by topic, rows, messages or CDR, 0.1 s apart, all but one of their fields.

    On the topic ``beside`` there are texts, too.
    """
    definition, _ = STORE.generate_msgdef(CLOUD, ros_version=2)
    with NewBag(path) as bag:
        if beside:
            text, _ = STORE.generate_msgdef(STRING, ros_version=2)
            other = Topic(beside, STRING, text, STORE.hash_rihs01(STRING))
            bag.add(other)
            message = STORE.types[STRING]('a text')
            for time in (0, 50_000_000, 1_000_000_000):
                bag.write(other, time, bytes(STORE.serialize_cdr(message, STRING)))
        for name, clouds in topics.items():
            topic = Topic(name, CLOUD, definition, STORE.hash_rihs01(CLOUD))
            bag.add(topic)
            for number, cloud in enumerate(clouds):
                time = number * 100_000_000
                if isinstance(cloud, bytes):
                    bag.write(topic, time, cloud)
                    continue
                message = to_message(time, cloud) if isinstance(cloud, np.ndarray) else cloud
                message.fields = [item for item in message.fields if item.name != without]
                bag.write(topic, time, bytes(STORE.serialize_cdr(message, CLOUD)))
    return path
