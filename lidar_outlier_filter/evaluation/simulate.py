# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A drive through a scene: clouds with their truth, and the recording of them.

Every cloud has the fields of ``POINT``; ``label`` and ``surface`` are the truth, and a filter
passes them through like any other field. A shot without echo leaves no point.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__PointCloud2 as PointCloud2
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__PointField as PointField
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header

from lidar_outlier_filter.bags import NewBag, Topic
from lidar_outlier_filter.core.points import SECOND
from lidar_outlier_filter.evaluation.scene import Cause, Kind, Rays, Scene, towards
from lidar_outlier_filter.evaluation.sensors import ProfileScanner

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.evaluation.scene import Puff
    from lidar_outlier_filter.evaluation.sensors import Echoes

    Floats = NDArray[np.float64]

TOPIC = '/lidar/points'
FRAME = 'map'
BLOCK_LINES = 20  # lines that are cast at once, and that share one stream of dice
START = 1_750_000_000 * SECOND  # when a drive begins, nanoseconds

POINT = np.dtype(
    [
        ('x', '<f4'),
        ('y', '<f4'),
        ('z', '<f4'),
        ('intensity', '<f4'),
        ('t', '<u4'),  # nanoseconds after the header stamp
        ('scan_angle', '<f4'),  # rad
        ('label', 'u1'),  # Cause
        ('surface', 'u1'),  # Kind
    ]
)
DATATYPES = {'<f4': PointField.FLOAT32, '<u4': PointField.UINT32, '|u1': PointField.UINT8}


@dataclass(frozen=True)
class Trajectory:
    """How the vehicle moves: along x, with slow changes of speed, and over bumps.

    Angles and heights swing as sums of two sines each, which is smooth, and known at any time.
    """

    start: tuple[float, float] = (0.0, -1.6)
    speed: float = 8.5
    speed_change: float = 0.4
    speed_period: float = 3.0
    bump: float = 0.012  # metres
    sway: float = 0.003  # rad
    mount: tuple[float, float, float] = (-1.0, 0.0, 2.4)  # the scanner in the vehicle's frame

    def position(self, t: Floats) -> Floats:
        """Place of the vehicle on the road (3, N), metres, at t (N,) seconds."""
        rate = 2.0 * np.pi / self.speed_period
        x = self.start[0] + self.speed * t + self.speed_change / rate * (1.0 - np.cos(rate * t))
        y = self.start[1] + 0.05 * np.sin(0.9 * t)
        z = self.bump * (0.7 * np.sin(8.8 * t) + 0.3 * np.sin(19.0 * t + 1.0))
        return np.stack([x, y, z])

    def rotation(self, t: Floats) -> Floats:
        """Rotation (3, 3, N) (roll, pitch, yaw) from the vehicle's frame to the scene's."""
        roll = self.sway * (0.8 * np.sin(7.1 * t) + 0.2 * np.sin(23.0 * t))
        pitch = self.sway * (0.8 * np.sin(8.8 * t + 0.6) + 0.2 * np.sin(17.0 * t))
        yaw = self.sway * np.sin(1.9 * t)
        cr, cp, cy = np.cos([roll, pitch, yaw])
        sr, sp, sy = np.sin([roll, pitch, yaw])
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )


@dataclass(frozen=True)
class Disturbances:
    """What goes wrong with shots at the road; shares are of these, heights above it in metres."""

    reflection: float = 0.004
    reflection_height: tuple[float, float] = (0.10, 1.4)
    reflection_scale: float = 0.5  # heights fall off exponentially
    near_surface: float = 0.001
    near_surface_height: tuple[float, float] = (0.03, 0.08)


@dataclass(frozen=True)
class Drive:
    """Everything that makes a recording: the same drive gives the same bytes."""

    scene: Scene
    lines: int
    sensor: ProfileScanner = field(default_factory=ProfileScanner)
    trajectory: Trajectory = field(default_factory=Trajectory)
    disturbances: Disturbances = field(default_factory=Disturbances)
    seed: int = 1

    @property
    def shots(self) -> int:
        """Number of shots, with and without echo."""
        return self.lines * self.sensor.shots_per_line

    def rays(self, shot: NDArray[np.int64]) -> Rays:
        """Footprints of shots, in the scene."""
        t = shot.astype(np.float64) * (self.sensor.interval / SECOND)
        offset, direction = self.sensor.bundle(self.sensor.angle(shot))
        rotation = self.trajectory.rotation(t)
        lever = offset + np.reshape(self.trajectory.mount, (3, 1, 1))
        origin = np.einsum('ijn,jnk->ink', rotation, lever)
        origin += self.trajectory.position(t)[:, :, None]
        return Rays(origin, np.einsum('ijn,jnk->ink', rotation, direction), t)


class Returns(NamedTuple):
    """Points with the numbers of their shots; their ``t`` is not yet set."""

    shot: NDArray[np.int64]
    points: NDArray[np.void]


@dataclass(frozen=True)
class Truth:
    """What a recording holds."""

    shots: int
    points: int
    causes: dict[Cause, int]
    kinds: dict[Kind, int]


def simulate(drive: Drive) -> Iterator[tuple[int, Returns]]:
    """Cast a drive, and yield it in blocks: the number of shots so far, and the block's returns."""
    step = BLOCK_LINES * drive.sensor.shots_per_line
    for first in range(0, drive.shots, step):
        end = min(first + step, drive.shots)
        dice = np.random.default_rng([drive.seed, first // step])
        yield end, _cast(drive, np.arange(first, end, dtype=np.int64), dice)


def _cast(drive: Drive, shot: NDArray[np.int64], dice: np.random.Generator) -> Returns:
    """Cast some shots: what they meet, what goes wrong on the way, noise."""
    rays = drive.rays(shot)
    scene, sensor = drive.scene, drive.sensor
    hits = scene.cast(rays)
    reflectance = np.array([thing.reflectance for thing in scene.surfaces] + [0.0])
    echoes = sensor.receive(hits, reflectance[hits.surface])
    distance, kind, cause = _met(scene, echoes)
    bright = reflectance[echoes.surface] * echoes.cosine

    for puff in scene.puffs:
        far = _in_puff(puff, rays, distance, dice.random(len(shot)))
        sent_back = far < distance
        distance = np.where(sent_back, far, distance)
        cause[sent_back], kind[sent_back], bright[sent_back] = Cause.EXHAUST, Kind.AIR, 0.05
    distance = _disturb(drive.disturbances, distance, rays.direction[2, :, 0], kind, cause, dice)

    seen = np.flatnonzero(distance < sensor.farthest)
    seen = seen[distance[seen] > sensor.nearest]
    noise, glitter = dice.standard_normal((2, len(shot)))[:, seen]
    # A droplet and a doubly reflected shot have no face that leans.
    cosine = np.where(kind[seen] == Kind.AIR, 1.0, echoes.cosine[seen])
    measured = distance[seen] + noise * sensor.range_sigma(distance[seen], cosine)
    xyz = rays.origin[:, seen, 0] + measured * rays.direction[:, seen, 0]

    points = np.zeros(len(seen), POINT)
    for axis, name in enumerate('xyz'):
        points[name] = xyz[axis]
    points['intensity'] = 100.0 * bright[seen] * np.exp(0.1 * glitter)
    points['scan_angle'] = sensor.angle(shot[seen])
    points['label'], points['surface'] = cause[seen], kind[seen]
    return Returns(shot[seen], points)


def _met(scene: Scene, echoes: Echoes) -> tuple[Floats, NDArray[np.uint8], NDArray[np.uint8]]:
    """Distance, kind and cause of every echo, before anything goes wrong on its way."""
    kinds = np.array([thing.kind for thing in scene.surfaces] + [Kind.AIR], np.uint8)
    causes = np.array([thing.cause for thing in scene.surfaces] + [Cause.GOOD], np.uint8)
    cause = causes[echoes.surface]
    cause[echoes.mixed & (cause == Cause.GOOD)] = Cause.MIXED
    return echoes.distance, kinds[echoes.surface], cause


def _in_puff(puff: Puff, rays: Rays, distance: Floats, dice: Floats) -> Floats:
    """Distance (N,) at which the centres of the bundles are sent back; inf: they pass."""
    far = np.full(len(distance), np.inf)
    near = towards(rays, puff.sphere)
    centre = rays.take(near)
    far[near] = puff.meet(
        centre.origin[:, :, 0], centre.direction[:, :, 0], distance[near], dice[near]
    )
    return far


def _disturb(  # noqa: PLR0913  one shot's whole state
    how: Disturbances,
    distance: Floats,
    fall: Floats,
    kind: NDArray[np.uint8],
    cause: NDArray[np.uint8],
    dice: np.random.Generator,
) -> Floats:
    """Lift some points off the road, along their rays; changes ``kind`` and ``cause``."""
    lot, place = dice.random((2, len(distance)))
    road = (kind == Kind.ROAD) & (cause == Cause.GOOD)
    twice = road & (lot < how.reflection)
    close = road & ~twice & (lot < how.reflection + how.near_surface)
    low, high = how.reflection_height
    span = -np.expm1(-(high - low) / how.reflection_scale)
    lift = np.where(twice, low - how.reflection_scale * np.log1p(-place * span), 0.0)
    low, high = how.near_surface_height
    lift = np.where(close, low + place * (high - low), lift)
    cause[twice], cause[close] = Cause.REFLECTION, Cause.NEAR_SURFACE
    kind[twice | close] = Kind.AIR
    lifted = lift > 0.0
    return np.where(lifted, distance + lift / np.where(lifted, fall, 1.0), distance)


def clouds(drive: Drive, lines_per_message: int = 10) -> Iterator[tuple[int, NDArray[np.void]]]:
    """Yield the time of each cloud's first shot (nanoseconds) and its points, in order.

    The points do not depend on ``lines_per_message``; a cloud without echoes is empty.
    """
    step = lines_per_message * drive.sensor.shots_per_line
    first, held = 0, Returns(np.zeros(0, np.int64), np.zeros(0, POINT))
    for end, new in simulate(drive):
        held = Returns(*(np.concatenate(pair) for pair in zip(held, new, strict=True)))
        while first < end and (first + step <= end or end == drive.shots):
            count = int(np.searchsorted(held.shot, first + step))
            points = held.points[:count].copy()
            points['t'] = (held.shot[:count] - first) * drive.sensor.interval
            yield START + first * drive.sensor.interval, points
            held = Returns(held.shot[count:], held.points[count:])
            first += step


def to_message(stamp: int, points: NDArray[np.void]) -> PointCloud2:
    """Make a cloud of points with the dtype ``POINT``."""
    columns: Mapping[str, Any] = POINT.fields or {}
    return PointCloud2(
        header=Header(Time(*divmod(stamp, SECOND)), FRAME),
        height=1,
        width=len(points),
        fields=[
            PointField(name, offset, DATATYPES[dtype.str], 1)
            for name, (dtype, offset, *_) in columns.items()
        ],
        is_bigendian=False,
        point_step=POINT.itemsize,
        row_step=POINT.itemsize * len(points),
        data=points.view(np.uint8),
        is_dense=True,
    )


def record(
    drive: Drive,
    bag: Path,
    *,
    topic: str = TOPIC,
    lines_per_message: int = 10,
    progress: Callable[[float], object] = lambda _: None,
) -> Truth:
    """Write a drive as an MCAP bag, and count what is in it; ``progress`` is told the share done.

    Raises
    ------
    RecordingError
        If ``bag`` exists, or cannot be written.

    """
    store = get_typestore(Stores.ROS2_JAZZY)
    name = PointCloud2.__msgtype__
    definition, _ = store.generate_msgdef(name, ros_version=2)
    channel = Topic(topic, name, definition, store.hash_rihs01(name))
    interval = drive.sensor.interval
    causes, kinds = np.zeros(256, np.int64), np.zeros(256, np.int64)
    with NewBag(bag) as recording:
        recording.add(channel)
        for stamp, points in clouds(drive, lines_per_message):
            # A cloud is sent when its last shot has been taken.
            shots = (stamp - START) // interval + lines_per_message * drive.sensor.shots_per_line
            shots = min(shots, drive.shots)
            data = bytes(store.serialize_cdr(to_message(stamp, points), name))
            recording.write(channel, START + shots * interval, data)
            causes += np.bincount(points['label'], minlength=256)
            kinds += np.bincount(points['surface'], minlength=256)
            progress(shots / drive.shots)
    return Truth(
        drive.shots,
        int(causes.sum()),
        {cause: int(causes[cause]) for cause in Cause},
        {kind: int(kinds[kind]) for kind in Kind},
    )
