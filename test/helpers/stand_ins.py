# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings in the layouts of the makers' drivers, for machines without real ones."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from helpers.clouds import NAME, STORE, cloud, to_bytes
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_lab.simulation.scenes.spinning_streets import plan, rings
from lidar_outlier_lab.simulation.world.drive import simulate
from lidar_outlier_lab.simulation.world.recording import messages
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner

Lay = Callable[[Rows, int, SpinningScanner], bytes]  # points, nanoseconds of the first shot

ROS1 = get_typestore(Stores.ROS1_NOETIC)
TURN = 100_000_000  # nanoseconds
XYZI = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4')]
VELODYNE = np.dtype([*XYZI, ('ring', '<u2'), ('time', '<f4')])
HESAI = np.dtype([*XYZI, ('ring', '<u2'), ('azimuth', '<f4'), ('stamp', '<f8')])
LINK = np.dtype([*XYZI, ('ring', '<u2'), ('timestamp', '<f8')])
OUSTER = np.dtype(
    {
        'names': ['x', 'y', 'z', 'intensity', 't', 'reflectivity', 'ring', 'ambient', 'range'],
        'formats': ['<f4', '<f4', '<f4', '<f4', '<u4', '<u2', '<u2', '<u2', '<u4'],
        'offsets': [0, 4, 8, 16, 20, 24, 26, 28, 32],
        'itemsize': 48,
    }
)
CLOCK_OFF = 126_000_000  # seconds that a Hesai's own clock is behind
TIMES = 250  # different times of a turn in the layout of `lidar_link`


def write_cloud(rows: Rows, stamp: int, frame: str, *, is_dense: bool = True) -> bytes:
    """Serialize rows (N,) or (height, width) as a message."""
    msg = cloud(rows, stamp)
    msg.header.frame_id, msg.is_dense = frame, is_dense
    return to_bytes(msg)


def _filled(points: Rows, layout: np.dtype[np.void]) -> Rows:
    rows = np.zeros(len(points), layout)
    for name in {'x', 'y', 'z', 'intensity', 'ring', 't'} & {*(layout.names or ())}:
        rows[name] = points[name]
    return rows


def velodyne(points: Rows, stamp: int, _sensor: SpinningScanner) -> bytes:
    """Lay out a turn as ROS's driver does: the stamp is that of the end, times are before it."""
    rows = _filled(points, VELODYNE)
    rows['time'] = points['t'] * 1e-9 - TURN * 1e-9
    return write_cloud(rows, stamp + TURN, 'velodyne')


def hesai(points: Rows, stamp: int, _sensor: SpinningScanner) -> bytes:
    """Lay out a turn with absolute times of a clock of its own."""
    rows = _filled(points, HESAI)
    rows['azimuth'] = np.degrees(np.arctan2(points['x'], points['y']))
    rows['stamp'] = (stamp + points['t'].astype(np.int64)) * 1e-9 - CLOCK_OFF
    return write_cloud(rows, stamp, 'hesai')


def link(points: Rows, stamp: int, _sensor: SpinningScanner) -> bytes:
    """Lay out a turn whose points share few times."""
    rows = _filled(points, LINK)
    step = TURN // TIMES
    rows['timestamp'] = (stamp + points['t'].astype(np.int64) // step * step) * 1e-9
    return write_cloud(rows, stamp, 'lidar_link', is_dense=False)


def ouster(points: Rows, stamp: int, sensor: SpinningScanner) -> bytes:
    """Lay out a turn as a range image, each ring shifted; what is missing is 0, 0, 0."""
    rows = _filled(points, OUSTER)
    xyz = np.stack([points[axis].astype(np.float64) for axis in 'xyz'])
    rows['range'] = np.rint(1000.0 * np.linalg.norm(xyz, axis=0))
    rows['reflectivity'] = np.minimum(points['intensity'], 255)
    grid = np.zeros((sensor.rings, sensor.columns), OUSTER)
    grid['ring'] = np.arange(sensor.rings)[:, None]
    shift = 12 * (points['ring'].astype(np.int64) % 4)
    column = (points['t'] // sensor.column_time + shift) % sensor.columns
    grid[points['ring'], column] = rows
    return write_cloud(grid, stamp, 'os_lidar')


class StandIn(NamedTuple):
    """What a recording is made of: a layout; lowest and highest ring in degrees, and how many."""

    lay: Lay
    low: float
    high: float
    rings: int
    columns: int
    turns: int


TOPICS: dict[Lay, str] = {
    velodyne: '/velodyne_points',
    ouster: '/ouster/points',
    hesai: '/pandar_points',
    link: '/lidar_points',
}
# By the names that each is written under.
STAND_INS = {
    'vlp16_mrpt.bag vlp16_mrpt_db3 vlp16_mrpt_mcap': StandIn(velodyne, -15, 15, 16, 1500, 4),
    'hdl32_mrpt_mcap': StandIn(velodyne, -30.67, 10.67, 32, 2000, 3),
    'vlp32_nebula.bag vlp32_nebula_db3': StandIn(velodyne, -25, 15, 32, 1000, 5),
    'os1_128_db3': StandIn(ouster, -22.5, 22.5, 128, 1024, 3),
    'os0_32.bag': StandIn(ouster, -45, 45, 32, 1024, 1),
    'hesai_xt32_nebula_mcap': StandIn(hesai, -16, 15, 32, 2000, 4),
    'cloudini_lidar_link_mcap': StandIn(link, -16, 15, 32, 2000, 1),
}


def turns(one: StandIn) -> Iterator[tuple[int, bytes]]:
    """Simulate ten turns a second in a dry street: bag time and message of each."""
    sensor = SpinningScanner(
        elevation=rings(one.low, one.high, one.rings),
        columns=one.columns,
        column_time=TURN // one.columns // one.rings * one.rings,
    )
    street = plan(one.rings, 7)
    drive = replace(street, sensor=sensor, lines=one.turns, scene=replace(street.scene, air=()))
    for turn in messages(drive, simulate(drive), 1):
        yield turn.sent, one.lay(turn.points, turn.stamp, sensor)


def write_stand_ins(folder: Path) -> Path:
    """Write all of them into ``bags``; return the folder."""
    (folder / 'bags').mkdir()
    for names, one in STAND_INS.items():
        made = list(turns(one))
        for name in names.split():
            _write(folder / 'bags' / name, TOPICS[one.lay], made)
    return folder


def _write(path: Path, topic: str, made: list[tuple[int, bytes]]) -> None:
    if path.suffix == '.bag':
        with Writer1(path) as old:
            link_ = old.add_connection(topic, NAME, typestore=ROS1)
            for time, data in made:
                old.write(link_, time, STORE.cdr_to_ros1(data, NAME))
        return
    plugin = StoragePlugin.SQLITE3 if path.name.endswith('db3') else StoragePlugin.MCAP
    with Writer2(path, version=9, storage_plugin=plugin) as bag:
        connection = bag.add_connection(topic, NAME, typestore=STORE)
        for time, data in made:
            bag.write(connection, time, data)
