# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds as point_cloud_transport sends them, written by rosbags."""

import gzip
from collections.abc import Callable

import numpy as np
import zstandard
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from helpers.clouds import NAME
from lidar_outlier_filter.pipeline.topics import COMPRESSED

DEFINITION = """
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] compressed_data
bool is_dense
string format
"""
STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(get_types_from_msg(DEFINITION, COMPRESSED))
# As zlib_publisher.cpp (deflateInit2 with 16 + 15 bits) and zstd_publisher.cpp write them
COMPRESS: dict[str, Callable[[bytes], bytes]] = {'zlib': gzip.compress, 'zstd': zstandard.compress}


def compressed(data: bytes, name: str, *, little_endian: bool = True, **changes: object) -> bytes:
    """Compress a serialised cloud; ``changes`` replace fields of the message."""
    cloud = STORE.deserialize_cdr(data, NAME)
    fields = dict(vars(cloud))
    points = fields.pop('data').tobytes()
    del fields['__msgtype__']
    fields |= {'format': name, 'compressed_data': COMPRESS[name](points)} | changes
    fields['compressed_data'] = np.frombuffer(fields['compressed_data'], np.uint8)
    message = STORE.types[COMPRESSED](**fields)
    return bytes(STORE.serialize_cdr(message, COMPRESSED, little_endian=little_endian))
