# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds for tests: real messages made from structured arrays, and read back with plain loops."""

import struct
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2, PointField

from lidar_outlier_filter.core.annotations import Rows

SECOND = 1_000_000_000
STAMP = 1_700_000_000 * SECOND  # nanoseconds
STORE = get_typestore(Stores.ROS2_JAZZY)
NAME = 'sensor_msgs/msg/PointCloud2'
# PointField.datatype: numpy's name without byte order, and struct's.
TYPES = {
    1: ('i1', 'b'),
    2: ('u1', 'B'),
    3: ('i2', 'h'),
    4: ('u2', 'H'),
    5: ('i4', 'i'),
    6: ('u4', 'I'),
    7: ('f4', 'f'),
    8: ('f8', 'd'),
    9: ('i8', 'q'),
    10: ('u8', 'Q'),
}
DATATYPES = {name: number for number, (name, _) in TYPES.items()}


def cloud(rows: Rows, stamp: int = STAMP, *, row_padding: int = 0) -> PointCloud2:
    """Make a message with the layout and the bytes of ``rows``, (N,) or (height, width).

    A stamp is in nanoseconds. The padding behind each row is full of 0xEE.
    """
    table = rows.reshape(1, -1) if rows.ndim == 1 else rows
    msg = PointCloud2()
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, SECOND)
    msg.header.frame_id = 'lidar'
    msg.height, msg.width = table.shape
    columns: Any = rows.dtype.fields
    for name in rows.dtype.names or ():
        kind, offset = columns[name][:2]
        base, shape = kind.subdtype or (kind, (1,))
        datatype = DATATYPES[base.str[1:]]
        msg.fields.append(PointField(name=name, offset=offset, datatype=datatype, count=shape[0]))
        msg.is_bigendian |= base.byteorder == '>'
    msg.point_step = rows.dtype.itemsize
    msg.row_step = msg.width * msg.point_step + row_padding
    for row in table.view(np.dtype((np.void, msg.point_step))):
        msg.data.frombytes(row.tobytes() + b'\xee' * row_padding)
    return msg


def table(count: int, order: str = '<', /, **columns: Any) -> Rows:
    """Make packed rows of valid points; columns are given as ``name=(kind, values)``."""
    kinds = {'x': 'f4', 'y': 'f4', 'z': 'f4'} | {name: kind for name, (kind, _) in columns.items()}
    rows = np.zeros(count, np.dtype([(name, order + kind) for name, kind in kinds.items()]))
    rows['x'] = 1
    for name, (_, values) in columns.items():
        rows[name] = values
    return rows


def to_rosbags(msg: PointCloud2) -> Any:
    """Turn a message of ROS into that of rosbags, whose data is a numpy array."""
    return STORE.deserialize_cdr(serialize_message(msg), NAME)


def to_bytes(msg: PointCloud2) -> bytes:
    """Serialize a message, its padding zero: ROS itself leaves anything there."""
    return bytes(STORE.serialize_cdr(to_rosbags(msg), NAME))


def to_ros(msg: Any) -> PointCloud2:
    """Turn a message of rosbags into that of ROS; it must be one that can be sent."""
    return deserialize_message(bytes(STORE.serialize_cdr(msg, NAME)), PointCloud2)


def dump(msg: Any) -> tuple[Any, ...]:
    """Return copies of all that a message holds, to be compared before and after."""
    stamp = (msg.header.stamp.sec, msg.header.stamp.nanosec, msg.header.frame_id)
    fields = [(item.name, item.offset, item.datatype, item.count) for item in msg.fields]
    sizes = (msg.height, msg.width, msg.point_step, msg.row_step)
    return (stamp, fields, sizes, msg.is_bigendian, msg.is_dense, bytes(msg.data))


def point_bytes(msg: Any) -> list[bytes]:
    """Return the bytes of each point, row by row, by the sizes that the message says."""
    data = bytes(msg.data)
    starts = [
        row * msg.row_step + column * msg.point_step
        for row in range(msg.height if msg.width else 0)
        for column in range(msg.width)
    ]
    return [data[start : start + msg.point_step] for start in starts]


def values(msg: Any, name: str) -> list[tuple[Any, ...]]:
    """Unpack one field of every point, row by row."""
    item = next(item for item in msg.fields if item.name == name)
    code = f'{">" if msg.is_bigendian else "<"}{item.count}{TYPES[item.datatype][1]}'
    return [struct.unpack_from(code, point, item.offset) for point in point_bytes(msg)]


# A drive: several rings, time-ordered, with all that happens -------------------------------------

DRIVE = np.dtype(
    {
        'names': ['x', 'y', 'z', 'std', 'ring', 'timestamp', 'tick'],
        'formats': ['<f4', '<f4', '<f4', '<f4', '<u2', '<f8', '<u4'],
        'offsets': [0, 4, 8, 14, 18, 21, 30],
        'itemsize': 37,
    }
)


def drive(seed: int, shots: int = 600, rings: int = 4) -> Rows:
    """Make the points of a short drive in order of time, all rings fired together.

    About 4 % are outliers, 4 % missing returns (NaN, Inf and 0 0 0), 8 % not there, in gaps of up
    to seven shots, and 1 % are there twice. The padding is full of noise.
    """
    rng = np.random.default_rng(seed)
    noise = bytearray(rng.bytes(shots * rings * DRIVE.itemsize))
    rows = np.frombuffer(noise, DRIVE).reshape(shots, rings)
    t = np.arange(shots)[:, None] * 200_000 + np.zeros((1, rings), np.int64)
    angle, height = t * 2e-8 * np.pi, np.arange(rings)
    sigma = 0.01 + 0.01 * height
    rows['x'] = 10 * np.cos(angle) + rng.normal(0, sigma, t.shape)
    rows['y'] = 5 * np.sin(angle) + np.where(t % 30_000_000 < 15_000_000, 0, 2)
    rows['y'] += rng.normal(0, sigma, t.shape)
    rows['z'] = height + rng.normal(0, sigma, t.shape)
    rows['std'], rows['ring'], rows['tick'] = sigma, height, t
    rows['timestamp'] = (STAMP // SECOND) + t * 1e-9
    wrong = rng.uniform(size=t.shape) < 0.04
    rows['x'][wrong] += rng.choice([-3, -1, 0.1, 1, 3], np.count_nonzero(wrong))
    for share, point in ((0.01, (np.nan,) * 3), (0.01, (1, np.inf, 1)), (0.02, (0, 0, 0))):
        no_return = rng.uniform(size=t.shape) < share
        for name, value in zip('xyz', point, strict=True):
            rows[name][no_return] = value
    times = np.ones(t.shape, np.int64)
    for ring in range(rings):
        for start in rng.integers(0, shots, shots // 50):
            times[start : start + rng.integers(1, 8), ring] = 0
    times[rng.uniform(size=t.shape) < 0.01] *= 2
    plain = rows.view(np.dtype((np.void, DRIVE.itemsize)))
    return np.repeat(plain.reshape(-1), times.reshape(-1)).view(DRIVE)


def cut(rows: Rows, seed: int, cuts: int) -> list[Rows]:
    """Cut points into parts at random; some parts are empty."""
    ends = np.random.default_rng(seed).integers(0, len(rows) + 1, cuts)
    return np.split(rows, np.sort(ends))
