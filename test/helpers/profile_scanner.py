# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A profile scanner on a vehicle in a narrow street: its clouds in two frames, truth, odometry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation

from helpers.clouds import SECOND, STAMP, cloud

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2

    from lidar_outlier_filter.annotations import Floats

MAP = np.array([4e5, 5e6, 100.0])  # where the street is
LINES, SHOTS = 100, 720  # a second; a line
POSITION, ANGLES = (0.5, 0.2, 2.0), (0.02, 0.1, 0.3)  # of the sensor on the vehicle
MOUNTING: dict[str, object] = dict(
    zip(
        (f'motion.{name}' for name in ('x', 'y', 'z', 'roll', 'pitch', 'yaw')),
        POSITION + ANGLES,
        strict=True,
    )
)
# Normal, distance from the street, and how far a wall goes in and out.
WALLS = ((0, 1, 0, 7.0, 1.5), (0, -1, 0, 6.0, 1.0), (0, 0, -1, 0.0, 0.0), (0, 0, 1, 9.0, 1.5))


def pose(t: Floats) -> tuple[Floats, Rotation]:
    """Return where the vehicle is t seconds after the start: 8 m/s, in a curve, on a bad road."""
    heading = 0.1 * np.sin(t)
    roll, pitch = 0.03 * np.sin(7 * t), 0.02 * np.sin(5 * t)
    position = np.stack([8 * t, np.sin(0.7 * t), 0.05 * np.sin(9 * t)], axis=1)
    return position, Rotation.from_euler('xyz', np.stack([roll, pitch, heading], axis=1))


class Drive:
    """Points of a drive: in the frame of the sensor, georeferenced, and which are outliers."""

    def __init__(self, seconds: float, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        count = round(seconds * LINES * SHOTS)
        self.t = np.arange(count) * SECOND // (LINES * SHOTS)
        angle = 2 * np.pi * (np.arange(count) % SHOTS) / SHOTS
        beam = np.stack([np.zeros(count), np.cos(angle), np.sin(angle)], axis=1)
        position, rotation = pose(self.t.astype(np.float64) * 1e-9)
        mounting = Rotation.from_euler('xyz', ANGLES)
        eye = position + rotation.apply(POSITION)
        direction = (rotation * mounting).apply(beam)
        reach = np.full(count, np.inf)
        for *normal, middle, depth in WALLS:
            distance = middle + depth * np.sin(1.5 * eye[:, 0])
            towards = direction @ normal
            with np.errstate(divide='ignore'):
                hit = (distance - eye @ normal) / towards
            reach = np.where(towards > 0, np.minimum(reach, hit), reach)
        self.wrong = rng.uniform(size=count) < 0.01
        reach = np.where(self.wrong, reach - rng.uniform(0.5, 1.5, count), reach)
        reach += rng.normal(0, 0.01, count)
        self.own = beam * reach[:, None]
        self.fixed = eye + direction * reach[:, None] + MAP
        self.line = np.arange(count) // SHOTS

    def clouds(self, xyz: Floats, lines: int = 10) -> list[PointCloud2]:
        """Make messages of so many lines each."""
        names = [(axis, 'f8') for axis in 'xyz']
        rows = np.zeros(len(xyz), [*names, ('ring', 'u2'), ('t', 'u4')])
        for axis, column in zip('xyz', xyz.T, strict=True):
            rows[axis] = column
        rows['ring'] = self.line % 65536
        messages = []
        for begin in range(0, len(rows), lines * SHOTS):
            part = rows[begin : begin + lines * SHOTS].copy()
            start = int(self.t[begin])
            part['t'] = self.t[begin : begin + len(part)] - start
            messages.append(cloud(part, STAMP + start))
        return messages

    def odometry(self, rate: int = 100) -> list[Odometry]:
        """Make the odometry of the drive, and a bit more."""
        last = int(self.t[-1]) * 1e-9
        t: Floats = np.arange(-1.0, np.ceil(last * rate) + 2, dtype=np.float64) / rate
        return [_odometry(*item) for item in zip(t, *_listed(*pose(t)), strict=True)]


def _listed(position: Floats, rotation: Rotation) -> tuple[list[list[float]], list[list[float]]]:
    return (position + MAP).tolist(), rotation.as_quat().tolist()


def _odometry(t: float, position: list[float], quaternion: list[float]) -> Odometry:
    msg = Odometry()
    stamp = STAMP + round(t * SECOND)
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, SECOND)
    msg.header.frame_id, msg.child_frame_id = 'odom', 'base_link'
    pose_: Any = msg.pose.pose
    pose_.position.x, pose_.position.y, pose_.position.z = position
    q = pose_.orientation
    q.x, q.y, q.z, q.w = quaternion
    return msg


def seconds(msg: Any) -> float:
    """Return the stamp of a message, seconds after the start of a drive."""
    nanoseconds: int = msg.header.stamp.sec * SECOND + msg.header.stamp.nanosec - STAMP
    return nanoseconds * 1e-9
