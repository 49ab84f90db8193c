# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds as they were received: the same as rclpy reads them, without a copy of the points."""

import numpy as np
import pytest
from helpers.clouds import NAME, STORE, cloud, table
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.ros.endpoints import read_cloud


def example(frame: str = 'lidar', name: str = 'time', count: int = 5) -> PointCloud2:
    """Make a cloud; the lengths of the names decide where everything lies."""
    msg = cloud(table(count, t=('u4', np.arange(count))), row_padding=3)
    msg.header.frame_id = frame
    msg.fields[-1].name = name
    msg.is_dense = count % 2 == 1
    return msg


def assert_equal(read: PointCloud2, expected: PointCloud2) -> None:
    """Compare all there is."""
    for part in {*PointCloud2.get_fields_and_field_types()} - {'data'}:
        assert getattr(read, part) == getattr(expected, part), part
    assert bytes(read.data) == bytes(expected.data)


@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'abcd', 'ü'])
@pytest.mark.parametrize('name', ['t', 'ti', 'tim', 'time'])
@pytest.mark.parametrize('count', [0, 1, 2, 5])
def test_it_is_what_rclpy_reads(frame: str, name: str, count: int) -> None:
    """Whatever the alignment."""
    msg = example(frame, name, count)
    assert_equal(read_cloud(serialize_message(msg)), msg)


def test_a_message_with_nothing_in_it() -> None:
    """A cloud needs no fields to be read."""
    assert_equal(read_cloud(serialize_message(PointCloud2())), PointCloud2())


def test_big_endian() -> None:
    """The order of bytes is that of the message, and no matter of this machine's."""
    msg = example()
    data = serialize_message(msg)
    there = STORE.deserialize_cdr(data, NAME)
    swapped = bytes(STORE.serialize_cdr(there, NAME, little_endian=False))
    assert swapped[:2] != data[:2]
    assert_equal(read_cloud(swapped), msg)


def test_the_points_are_not_copied() -> None:
    """They are those received."""
    data = serialize_message(example())
    assert read_cloud(data).data.obj is data


def test_cut_short() -> None:
    """Wherever it ends, it is refused."""
    data = serialize_message(example())
    last = data.rindex(b'\xee') + 1  # is_dense is behind it, and padding
    for size in range(4, last + 1):
        with pytest.raises(CloudError, match='a serialised cloud must be whole'):
            read_cloud(data[:size])


@pytest.mark.parametrize('data', [b'', b'\x00', b'\x00\x0b\x00\x00', b'\xff' * 40])
def test_what_rclpy_refuses(data: bytes) -> None:
    """A representation that nobody knows, or no message at all: the node goes on."""
    with pytest.raises(CloudError, match='must be a sensor_msgs/msg/PointCloud2, got other bytes'):
        read_cloud(data)
