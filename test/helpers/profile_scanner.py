# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A profile scanner on a vehicle in a street: clouds in two frames, truth, odometry, bags."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2

from helpers.clouds import SECOND, STAMP, STORE, cloud
from helpers.drives import write_messages
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.evaluation.labels import ALL_BUT_0
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.motion import Odometry as OdometryMotion
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud
from lidar_outlier_filter.pipeline.topics import CLOUD, ODOMETRY, TRANSFORMS
from lidar_outlier_filter.tuning.training import Training, read_training

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
SOR: dict[str, object] = {
    'chain': ('sor',),
    'sor.statistic': 'radius',
    'sor.radius': 0.3,
    'sor.min_neighbors': 4,
}
MOVING = SOR | MOUNTING | {'motion.source': 'odometry', 'line_source': 'field'}
REPLAYED = MOVING | {'motion.topic': '/odom'}
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

    def __init__(self, seconds: float) -> None:
        rng = np.random.default_rng(0)
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

    def odometry(self) -> list[Odometry]:
        """Make the odometry of the drive, and a bit more."""
        last = int(self.t[-1]) * 1e-9
        t: Floats = np.arange(-1.0, np.ceil(last * 100) + 2, dtype=np.float64) / 100
        position, rotation = pose(t)
        listed = (position + MAP).tolist(), rotation.as_quat().tolist()
        return [odometry(*item) for item in zip(t, *listed, strict=True)]


def odometry(t: float, position: list[float], quaternion: list[float]) -> Odometry:
    """Make a pose, t seconds after the start of a drive."""
    msg = Odometry()
    stamp = STAMP + round(t * SECOND)
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, SECOND)
    msg.header.frame_id, msg.child_frame_id = 'odom', 'base_link'
    pose_: Any = msg.pose.pose
    pose_.position.x, pose_.position.y, pose_.position.z = position
    q = pose_.orientation
    q.x, q.y, q.z, q.w = quaternion
    return msg


def nanoseconds(msg: Any) -> int:
    """Return the stamp of a message."""
    return int(msg.header.stamp.sec * SECOND + msg.header.stamp.nanosec)


def seconds(msg: Any) -> float:
    """Return the stamp of a message, seconds after the start of a drive."""
    return (nanoseconds(msg) - STAMP) * 1e-9


class Moving:
    """A filter that is given clouds and odometry by their stamps."""

    def __init__(self, extra: Mapping[str, object] | None = None) -> None:
        parameters = FilterParameters().changed({**MOVING, **(extra or {})})
        self.motion = OdometryMotion(parameters)
        self.filter = Pipeline(parameters, motion=self.motion)

    def run(
        self, clouds: Iterable[PointCloud2], odometry: Iterable[object], delay: float = 0.0
    ) -> list[SplitCloud]:
        """Feed all messages; odometry arrives ``delay`` seconds after its time."""
        events = [(seconds(msg), 0, msg) for msg in clouds]
        events += [(seconds(msg) + delay, 1, msg) for msg in odometry]
        results: list[SplitCloud] = []
        for _, is_odometry, msg in sorted(events, key=lambda event: event[:2]):
            if is_odometry:
                self.motion.take(msg)
                results += self.filter.advance()
            else:
                results += self.filter.process(msg, msg)
        return results + self.filter.flush()


def rejected(drive: Drive, results: list[SplitCloud]) -> NDArray[np.bool_]:
    """Return which points of the drive went to the outliers, by the time in their clouds."""
    mask = np.zeros(len(drive.t), np.bool_)
    for result in results:
        if result.outliers.width:
            rows = structured(result.outliers).reshape(-1)
            start = nanoseconds(result.outliers) - STAMP
            mask |= np.isin(drive.t, rows['t'].astype(np.int64) + start)
    return mask


def write(path: Path, drive: Drive, topics: tuple[str, ...] = ('/points',)) -> Path:
    """Write a recording: clouds at the end of their time, odometry 30 ms after its own."""
    clouds: list[Any] = drive.clouds(drive.own)
    streams = [(name, SECOND // 10, clouds) for name in topics]
    streams.append(('/odom', 3 * SECOND // 100, drive.odometry()))
    events = [
        (name, nanoseconds(msg) + delay, bytes(serialize_message(msg)))
        for name, delay, every in streams
        for msg in every
    ]
    types = dict.fromkeys(topics, CLOUD) | {'/odom': ODOMETRY}
    return write_messages(path, types, sorted(events, key=lambda event: event[1]))


def write_tf(path: Path, drive: Drive, topics: tuple[str, ...] = ('/points',)) -> Path:
    """Write the same recording with tf in place of odometry; a frame begins with a slash."""
    types = STORE.types

    def transforms(parent: str, child: str, msg: Any, position: Any, quaternion: Any) -> bytes:
        stamp = types['builtin_interfaces/msg/Time'](msg.header.stamp.sec, msg.header.stamp.nanosec)
        header = types['std_msgs/msg/Header'](stamp, parent)
        pose = types['geometry_msgs/msg/Transform'](
            types['geometry_msgs/msg/Vector3'](*map(float, position)),
            types['geometry_msgs/msg/Quaternion'](*map(float, quaternion)),
        )
        one = types['geometry_msgs/msg/TransformStamped'](header, child, pose)
        return bytes(STORE.serialize_cdr(types[TRANSFORMS]([one]), TRANSFORMS))

    odometry = drive.odometry()
    mounting = Rotation.from_euler('xyz', ANGLES).as_quat()
    static = transforms('/base_link', '/lidar', odometry[0], POSITION, mounting)
    events = [('/tf_static', nanoseconds(odometry[0]), static)]
    for msg in odometry:
        p, q = msg.pose.pose.position, msg.pose.pose.orientation
        data = transforms('odom', 'base_link', msg, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        events.append(('/tf', nanoseconds(msg) + 3 * SECOND // 100, data))
    for msg in drive.clouds(drive.own):
        msg.header.frame_id = '/lidar'
        data = bytes(serialize_message(msg))
        events += [(name, nanoseconds(msg) + SECOND // 10, data) for name in topics]
    kinds = dict.fromkeys(topics, CLOUD) | dict.fromkeys(('/tf', '/tf_static'), TRANSFORMS)
    return write_messages(path, kinds, sorted(events, key=lambda event: event[1]))


class Recorded:
    """A recorded drive, with a file of labels for each cloud."""

    def __init__(self, folder: Path, drive: Drive) -> None:
        self.drive, self.bag = drive, write(folder / 'drive', drive)
        self.labels = folder / 'labels'
        self.labels.mkdir()
        self.files = []
        size = 10 * SHOTS  # points of a cloud
        for begin in range(0, len(drive.wrong), size):
            self.files.append(self.labels / f'{begin:06}.npy')
            np.save(self.files[-1], drive.wrong[begin : begin + size].astype(np.uint8))

    def training(self, values: dict[str, object], **options: Any) -> Training:
        """Read it."""
        parameters = FilterParameters().changed(values)
        options = options or {'files': self.files}
        return read_training(self.bag, parameters, ALL_BUT_0, **options)


class WithoutFirstPoses(Drive):
    """A drive whose odometry begins 0.3 s late."""

    def odometry(self) -> list[Odometry]:
        """Leave the first poses out."""
        return [msg for msg in super().odometry() if seconds(msg) > 0.295]
