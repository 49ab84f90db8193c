# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 from the wire, its points where they are.

rclpy copies the points of a cloud three times before it hands them over, and no other thread can
work meanwhile. Here all but the points is left to rclpy, and they are viewed in the bytes received.
"""

from __future__ import annotations

import struct

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import CloudError, said_by

PLAIN_CDR = {b'\x00\x00': '>', b'\x00\x01': '<'}  # the representations whose layout is known here
START = 4  # behind the identifier of the representation; alignment counts from there


def read_cloud(received: bytes) -> PointCloud2:
    """Read a cloud as it was received; its ``data`` is a read-only memoryview of it.

    Such a cloud is to be read and split, not to be sent. One in another representation than plain
    CDR is left to rclpy as a whole.

    Raises
    ------
    CloudError
        If it ends too early, or is no cloud.

    """
    order = PLAIN_CDR.get(received[:2])
    if order is None:
        return _by_rclpy(received)
    try:
        begin = _find_data(received, order)
        (size,) = struct.unpack_from(order + 'I', received, begin - 4)
        end = begin + size
        # The same cloud without points: no number in it, and behind it only is_dense.
        bare = received[: begin - 4] + bytes(4) + struct.pack('?', received[end])
    except (struct.error, IndexError) as err:
        raise CloudError('a serialised cloud', 'whole', f'{len(received)} bytes') from err
    msg = _by_rclpy(bare)
    # Past the setter, which takes an array only, or looks at every byte.
    msg._data = memoryview(received)[begin:end]  # noqa: SLF001
    return msg


def _by_rclpy(data: bytes) -> PointCloud2:
    try:
        return deserialize_message(data, PointCloud2)
    except RuntimeError as err:  # of the middleware
        must_be = 'a sensor_msgs/msg/PointCloud2'
        raise CloudError('a serialised cloud', must_be, f'other bytes ({said_by(err)})') from err


def _find_data(received: bytes, order: str) -> int:
    """Return where the points begin."""
    at = _behind_string(received, order, START + 8)  # header: stamp, frame_id
    at = _aligned(at) + 8  # height, width
    (fields,) = struct.unpack_from(order + 'I', received, at)
    at += 4
    for _ in range(fields):
        at = _behind_string(received, order, at)
        at = _aligned(_aligned(at) + 5) + 4  # offset, datatype, count
    return _aligned(at + 1) + 12  # is_bigendian, point_step, row_step, size of the points


def _behind_string(received: bytes, order: str, at: int) -> int:
    at = _aligned(at)
    (size,) = struct.unpack_from(order + 'I', received, at)
    return at + 4 + int(size)


def _aligned(at: int) -> int:
    """Go on to the next multiple of four, as every number but a single byte does."""
    return START + -(-(at - START) // 4) * 4
