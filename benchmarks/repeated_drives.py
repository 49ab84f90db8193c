# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Drives for benchmarks of archives: the sweeps of real recordings, again and again, later on."""

# ruff: noqa: INP001  a module of scripts, in no package

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from helpers.drives import SECOND, STORE, pose_bytes, topic_of

from lidar_outlier_filter.pipeline.topics import CLOUD, ODOMETRY
from lidar_outlier_filter.recordings.bags import NewBag, Recording

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

BEGIN = 1_750_000_000 * SECOND
POSES = SECOND // 20  # between two poses
ALONE = SECOND // 10  # from one sweep to the next, where a recording has one only
ABSOLUTE = ('stamp', 'timestamp')  # fields with a time that counts from an epoch
DOUBLE = 8  # PointField.FLOAT64


@dataclass(frozen=True)
class Sweeps:
    """The clouds of a real recording: messages, their stamps, and when they come again, ns."""

    clouds: Sequence[Any]
    stamps: Sequence[int]
    period: int

    def from_time(self, begin: int, end: int) -> Iterator[tuple[int, Any]]:
        """Give stamps and clouds from one time to another."""
        loop = 0
        while True:
            for cloud, stamp in zip(self.clouds, self.stamps, strict=True):
                at = begin + stamp - self.stamps[0] + loop * self.period
                if at >= end:
                    return
                yield at, moved(cloud, at - stamp)
            loop += 1

    def sector(self, centre: float, width: float) -> Sweeps:
        """Keep what lies in a sector about the vertical, degrees."""
        return replace(self, clouds=[_sector(cloud, centre, width) for cloud in self.clouds])


def sweeps_of(recording: Path) -> Sweeps:
    """Read the clouds of a recording of one sensor."""
    with Recording(recording) as source:
        topics = [topic for topic in source.topics if topic.msgtype == CLOUD]
        clouds = [STORE.deserialize_cdr(data, CLOUD) for _, _, data in source.messages(topics)]
    stamps = [_stamp(cloud) for cloud in clouds]
    step = int(np.median(np.diff(stamps))) if len(stamps) > 1 else ALONE
    return Sweeps(clouds, stamps, stamps[-1] - stamps[0] + step)


def write_repeated(
    path: Path,
    sensors: Sequence[Sweeps],
    seconds: float,
    begin: int = BEGIN,
    *,
    poses: bool = True,
) -> Path:
    """Write a drive with a topic for each sensor, and an odometry, as an MCAP bag."""
    end = begin + round(seconds * SECOND)
    topics = [topic_of(f'/lidar{number}', CLOUD) for number in range(len(sensors))]
    odometry = topic_of('/odometry', ODOMETRY)
    streams = [sweeps.from_time(begin, end) for sweeps in sensors]
    with NewBag(path) as bag:
        for topic in (*topics, odometry):
            bag.add(topic)
        waiting = [next(stream, None) for stream in streams]
        pose = begin
        while any(waiting):
            first = min((one[0], number) for number, one in enumerate(waiting) if one is not None)
            while poses and pose <= first[0]:
                bag.write(odometry, pose, pose_bytes(pose, (pose - begin) / SECOND))
                pose += POSES
            number = first[1]
            stamp, cloud = waiting[number] or (0, None)
            data = bytes(STORE.serialize_cdr(cloud, CLOUD))
            bag.write(topics[number], stamp + ALONE, data)
            waiting[number] = next(streams[number], None)
    return path


def moved(cloud: Any, later: int) -> Any:
    """Copy a cloud with its times so many ns later."""
    stamp = _stamp(cloud) + later
    time = type(cloud.header.stamp)(*divmod(stamp, SECOND))
    header = replace(cloud.header, stamp=time)
    fields = [f for f in cloud.fields if f.name in ABSOLUTE and f.datatype == DOUBLE]
    if not fields:
        return replace(cloud, header=header)
    rows = cloud.data.reshape(-1, cloud.point_step).copy()
    for field in fields:
        part = slice(field.offset, field.offset + 8)
        times = rows[:, part].copy().view('<f8') + later / SECOND
        rows[:, part] = times.view(np.uint8)
    return replace(cloud, header=header, data=rows.reshape(-1))


def _sector(cloud: Any, centre: float, width: float) -> Any:
    offsets = {field.name: field.offset for field in cloud.fields}
    rows = cloud.data.reshape(-1, cloud.point_step)
    x, y = (rows[:, offsets[name] : offsets[name] + 4].copy().view('<f4')[:, 0] for name in 'xy')
    angle = np.degrees(np.arctan2(y, x)) - centre
    kept = rows[np.abs((angle + 180) % 360 - 180) < width / 2]
    size = kept.size
    return replace(cloud, height=1, width=len(kept), row_step=size, data=kept.reshape(-1))


def _stamp(cloud: Any) -> int:
    return int(cloud.header.stamp.sec) * SECOND + int(cloud.header.stamp.nanosec)
