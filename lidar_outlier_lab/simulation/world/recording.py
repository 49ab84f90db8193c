# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The recording of a drive: clouds with their truth, as messages.

The fields ``label`` and ``surface`` are the truth, codes of :class:`Cause` and :class:`Kind`; a
filter passes them through like any other field. A shot without echo leaves no point.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__PointCloud2 as PointCloud2
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__PointField as PointField
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header

from lidar_outlier_filter.core.annotations import Ints, Rows
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_filter.messages.cloud import DATATYPES
from lidar_outlier_filter.recordings.bags import NewBag, Topic
from lidar_outlier_lab.simulation.world.drive import Drive, Returns, simulate

TOPIC = '/lidar/points'
FRAME, OWN_FRAME = 'map', 'lidar'  # of the scene, and of the scanner
START = 1_750_000_000 * SECOND  # when a drive begins, nanoseconds


@dataclass(frozen=True)
class Cloud:
    """One message: ``stamp`` and ``sent`` (nanoseconds) are its header's and the bag's time."""

    stamp: int
    sent: int
    points: Rows
    topic: str = TOPIC
    frame: str = FRAME


def by_cause(labels: Ints) -> dict[Cause, int]:
    """Name the causes of counts by label (256,); 0 is good."""
    return {cause: int(labels[cause]) for cause in Cause}


def clouds(drive: Drive, lines_per_message: int = 10) -> Iterator[tuple[int, Rows]]:
    """Yield the time of each cloud's first shot (nanoseconds) and its points, in order.

    The points do not depend on ``lines_per_message``; a cloud without echoes is empty.
    """
    for cloud in messages(drive, simulate(drive), lines_per_message):
        yield cloud.stamp, cloud.points


def messages(
    drive: Drive, blocks: Iterable[tuple[int, Returns]], lines_per_message: int = 10
) -> Iterator[Cloud]:
    """Cut returns that come in blocks, each with the number of shots so far, into messages.

    A message is sent when its last shot has been taken; the last message ends with the last block.
    """
    sensor = drive.sensor
    step = lines_per_message * sensor.shots_per_line
    frame = OWN_FRAME if drive.in_own_frame else FRAME
    first, end, held = 0, 0, Returns(np.zeros(0, np.int64), np.zeros(0, sensor.point))

    def cut(last: int) -> Cloud:
        count = int(np.searchsorted(held.shot, last))
        points = held.points[:count].copy()
        points['t'] = (held.shot[:count] - first) * sensor.interval
        stamp, sent = (START + shot * sensor.interval for shot in (first, last))
        return Cloud(stamp, sent, points, frame=frame)

    for end, new in blocks:
        held = Returns(*(np.concatenate(pair) for pair in zip(held, new, strict=True)))
        while first + step <= end:
            yield cut(first + step)
            first += step
            held = held.take(slice(int(np.searchsorted(held.shot, first)), None))
    if first < end:
        yield cut(end)


def to_message(stamp: int, points: Rows, frame: str = FRAME) -> PointCloud2:
    """Make a cloud of points, (N,) or (height, width)."""
    height, width = points.shape if points.ndim > 1 else (1, len(points))
    columns: Mapping[str, Any] = points.dtype.fields or {}
    return PointCloud2(
        header=Header(Time(*divmod(stamp, SECOND)), frame),
        height=height,
        width=width,
        fields=[
            PointField(name, offset, DATATYPES[dtype.str[1:]], 1)
            for name, (dtype, offset, *_) in columns.items()
        ],
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * width,
        data=points.reshape(-1).view(np.uint8),
        is_dense=height == 1,
    )


def record(
    drive: Drive,
    bag: Path,
    *,
    lines_per_message: int = 10,
    progress: Callable[[float], object] = lambda _: None,
) -> dict[Cause, int]:
    """Write a drive as an MCAP bag, and count points by cause; ``progress`` gets the share done.

    Raises
    ------
    RecordingError
        If ``bag`` exists, or cannot be written.

    """
    end = drive.shots * drive.sensor.interval
    made = messages(drive, simulate(drive), lines_per_message)
    return write(made, bag, lambda cloud: progress((cloud.sent - START) / end))


def write(
    made: Iterable[Cloud],
    bag: Path,
    progress: Callable[[Cloud], object] = lambda _: None,
    custom_data: Mapping[str, str] | None = None,
) -> dict[Cause, int]:
    """Write clouds as an MCAP bag, and count points by cause; ``progress`` gets what is written.

    ``custom_data`` is that of its ``metadata.yaml``.

    Raises
    ------
    RecordingError
        If ``bag`` exists, or cannot be written.

    """
    store = get_typestore(Stores.ROS2_JAZZY)
    name = PointCloud2.__msgtype__
    definition, _ = store.generate_msgdef(name, ros_version=2)
    channels: dict[str, Topic] = {}
    causes = np.zeros(256, np.int64)
    with NewBag(bag, custom_data) as recording:
        for cloud in made:
            if cloud.topic not in channels:
                topic = Topic(cloud.topic, name, definition, store.hash_rihs01(name))
                channels[cloud.topic] = topic
                recording.add(topic)
            message = to_message(cloud.stamp, cloud.points, cloud.frame)
            data = bytes(store.serialize_cdr(message, name))
            recording.write(channels[cloud.topic], cloud.sent, data)
            there = np.isfinite(cloud.points['x'])
            causes += np.bincount(cloud.points['label'][there], minlength=256)
            progress(cloud)
    return by_cause(causes)
