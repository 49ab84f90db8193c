# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Summarise a recording, and the verdict of the defaults on its first seconds."""

import math
import struct
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Ints
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.scan_lines import line_starts, order_by_line
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.topics import SCANS
from lidar_outlier_filter.recordings.bags import Recording, Topic
from lidar_outlier_filter.recordings.cloud_topic import (
    CloudTopic,
    MessageTimes,
    TopicReport,
    cloud_topics,
    read_cloud,
)
from lidar_outlier_filter.recordings.remote_path import RecordingPath

SAMPLE_S = 3.0  # seconds of bag time that the filter judges
MAX_RING_DEVIATION_RAD = math.radians(1)  # deviation in elevation up to which a line is a ring
MAX_STEP_DEVIATION = 0.1  # of the median step, up to which rings are evenly spaced
MIN_LINE_POINTS = 3  # of a line whose elevation is used
KINDS = ('int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'float32', 'float64')


@dataclass(frozen=True)
class ScanGeometry:
    """Properties of a scanner, estimated from one cloud.

    Attributes
    ----------
    lines : scan lines
    per_line : points of a line, the median
    seconds : between the cloud's first and last point
    near, far : 1st and 99th percentile of the range, m
    invalid : share of the points without a return
    low, high : elevation of the rings, degrees; nan where lines are not rings around the sensor
    step, even : median step of rings, degrees; whether all steps are alike
    azimuth : median step between points of a ring, degrees

    """

    lines: int
    per_line: float
    seconds: float
    near: float
    far: float
    invalid: float
    low: float = math.nan
    high: float = math.nan
    step: float = math.nan
    even: bool = False
    azimuth: float = math.nan

    @property
    def is_spinning(self) -> bool:
        """Whether the lines are rings around the sensor."""
        return not math.isnan(self.low)


@dataclass
class CloudInfo:
    """Properties of a topic, from its first clouds.

    Attributes
    ----------
    frame, fields, shape, step : of the first cloud that can be read: its frame, its fields as
        ``NAME TYPE``, height and width, and the bytes of a point
    found : sentences on how the clouds are read
    geometry : of the first cloud with points
    report, seconds : counts of the sample with defaults, and time for all but its first cloud
    stamps : the header stamps of all clouds
    behind : bag time minus stamp of the first cloud, s

    """

    frame: str = ''
    fields: tuple[str, ...] = ()
    shape: tuple[int, int] = (0, 0)
    step: int = 0
    found: list[str] = field(default_factory=list)
    geometry: ScanGeometry | None = None
    report: TopicReport | None = None
    seconds: float = 0.0
    stamps: MessageTimes = field(default_factory=MessageTimes)
    behind: float = 0.0


@dataclass
class RecordingInfo:
    """A summary of a recording; ``topics`` have the bag times of their messages.

    ``unread`` counts declared ``messages`` that were not found in it.
    """

    path: RecordingPath
    start: int
    duration: float
    messages: int
    topics: dict[Topic, MessageTimes]
    clouds: dict[Topic, CloudInfo]
    unread: int = 0


def describe_recording(
    path: RecordingPath,
    sample: float = SAMPLE_S,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> RecordingInfo:
    """Summarise a recording: times of all messages, and properties of the first clouds.

    Parameters
    ----------
    path : ROS 2 bag folder, ``.mcap``, ``.db3``, or ROS 1 ``.bag``
    sample : seconds of bag time that are judged by the defaults
    progress : called after each message with the number read and the total

    """
    with Recording(path) as source:
        info = RecordingInfo(
            path,
            source.start,
            source.duration / SECOND,
            source.message_count,
            {topic: MessageTimes() for topic in source.topics},
            {topic: CloudInfo() for topic in cloud_topics(source, scans=True).values()},
        )
        stop = source.start + round(sample * SECOND)
        for topic, cloud in info.clouds.items():
            _judge(topic, cloud, source.messages([topic], None, stop))
        done = 0
        for topic, time, data in source.messages():
            info.topics[topic].add(time)
            if topic in info.clouds:
                _note_stamp(info.clouds[topic], time, data)
            done += 1
            progress(done, source.message_count)
        info.unread = max(0, source.message_count - done)
    return info


def _judge(topic: Topic, cloud: CloudInfo, messages: Iterable[tuple[Topic, int, bytes]]) -> None:
    """Describe clouds of a topic, and filter them by the defaults."""
    prefix = f'{topic.name}: '
    stream = CloudTopic(topic, FilterParameters(), cloud.found.append)

    def note(taken: StreamCloud, _msg: Any, _number: int) -> None:
        if cloud.geometry is None:
            cloud.geometry = scan_geometry(taken)

    stream.show(note)
    for number, (_, time, data) in enumerate(messages):
        if not cloud.fields:
            with suppress(CloudError):  # the filter counts it
                _describe(cloud, topic, read_cloud(topic, data))
        began = perf_counter()
        stream.feed(time, data)
        if number:  # the first waits for the filter to start
            cloud.seconds += perf_counter() - began
    began = perf_counter()
    stream.finish()
    cloud.seconds += perf_counter() - began
    cloud.report = stream.report()
    cloud.found = [text.removeprefix(prefix) for text in cloud.found]


def _describe(cloud: CloudInfo, topic: Topic, msg: Any) -> None:
    cloud.frame = str(msg.header.frame_id)
    if topic.msgtype in SCANS:
        names = ('ranges', 'intensities')[: 1 + bool(len(msg.intensities))]
        cloud.shape, cloud.step = (1, len(msg.ranges)), len(names) * np.dtype(np.float32).itemsize
        cloud.fields = tuple(f'{name} float32' for name in names)
        return
    cloud.shape, cloud.step = (msg.height, msg.width), msg.point_step
    cloud.fields = tuple(f'{one.name} {_kind(one.datatype)}' for one in msg.fields)


def _kind(number: int) -> str:
    return KINDS[number - 1] if 1 <= number <= len(KINDS) else f'type {number}'


def _note_stamp(cloud: CloudInfo, time: int, data: bytes) -> None:
    """Read the stamp from the bytes of a cloud, unless they are truncated."""
    if len(data) < 12:  # noqa: PLR2004  the head of CDR, and a stamp
        return
    seconds, nanoseconds = struct.unpack_from('<iI' if data[1] & 1 else '>iI', data, 4)
    stamp = seconds * SECOND + nanoseconds
    if not cloud.stamps.count:
        cloud.behind = (time - stamp) / SECOND
    cloud.stamps.add(stamp)


def scan_geometry(cloud: StreamCloud) -> ScanGeometry | None:
    """Estimate the properties of the scanner from a cloud; None without valid points."""
    if not len(cloud.points):
        return None
    points = cloud.points.take(order_by_line(cloud.points))
    bounds = line_starts(points.line)
    near, far = np.percentile(points.range, (1, 99))
    found = ScanGeometry(
        len(bounds) - 1,
        float(np.median(np.diff(bounds))),
        int(points.t.max() - points.t.min()) / SECOND,
        float(near),
        float(far),
        cloud.absent / cloud.count,
    )
    return _with_rings(found, points, bounds)


def _with_rings(found: ScanGeometry, points: Points, bounds: Ints) -> ScanGeometry:
    """Add the angles of rings, if lines are rings."""
    x, y, z = points.xyz.T
    elevation, azimuth = np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)
    lines = [slice(begin, end) for begin, end in pairwise(bounds) if end - begin >= MIN_LINE_POINTS]
    if not lines:
        return found
    middles = np.array([np.median(elevation[line]) for line in lines])
    spread = [np.median(abs(elevation[line] - m)) for line, m in zip(lines, middles, strict=True)]
    if np.median(spread) > MAX_RING_DEVIATION_RAD or np.ptp(azimuth) < math.pi / 8:
        return found
    steps = np.diff(np.sort(middles))
    turns = np.concatenate([np.diff(azimuth[line]) for line in lines])
    turns = abs((turns + math.pi) % (2 * math.pi) - math.pi)
    return replace(
        found,
        low=math.degrees(middles.min()),
        high=math.degrees(middles.max()),
        step=math.degrees(np.median(steps)) if len(steps) else math.nan,
        even=bool(len(steps) and np.ptp(steps) <= MAX_STEP_DEVIATION * np.median(steps)),
        azimuth=math.degrees(np.median(turns)),
    )
