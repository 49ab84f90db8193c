# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds as they are sent: where the points lie in the bytes, and the formats that compress them.

The bytes of a ``CompressedPointCloud2`` are those of a ``PointCloud2``, with the points compressed
and the name of the format at the end. So one becomes the other before anything reads it.
"""

import struct
import zlib
from typing import NamedTuple

from lidar_outlier_filter.errors import CloudError, refusing

MAX_CLOUD_BYTES = 256_000_000  # bytes of the points of a compressed cloud
# Of plain CDR, by the identifier of the representation.
BYTE_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}
CDR_START = 4  # after the identifier; alignment counts from here
GZIP_OR_ZLIB = 32 + zlib.MAX_WBITS  # the publisher writes the former, the subscriber reads both


class Layout(NamedTuple):
    """Where the points of a cloud lie in its bytes, and its shape."""

    begin: int
    end: int
    height: int
    row_step: int


def layout(received: bytes, order: str) -> Layout:
    """Find the points in the bytes of a cloud, compressed or not, in plain CDR.

    Raises
    ------
    CloudError
        If it is truncated.

    """
    try:
        at = _aligned(_after_string(received, order, CDR_START + 8))  # header: stamp, frame_id
        height, _, fields = struct.unpack_from(order + '3I', received, at)
        at += 12
        for _ in range(fields):
            at = _after_string(received, order, at)
            at = _aligned(_aligned(at) + 5) + 4  # offset, datatype, count
        # is_bigendian, point_step, row_step, size of the points
        row_step, size = struct.unpack_from(order + '2I', received, _aligned(at + 1) + 4)
        begin = _aligned(at + 1) + 12
        received[begin + size]  # is_dense
    except (struct.error, IndexError) as err:
        raise CloudError('a serialised cloud', 'whole', f'{len(received)} bytes') from err
    return Layout(begin, begin + size, height, row_step)


def _after_string(received: bytes, order: str, at: int) -> int:
    at = _aligned(at)
    (size,) = struct.unpack_from(order + 'I', received, at)
    return at + 4 + int(size)


def _aligned(at: int) -> int:
    """Return the next multiple of four, where every number but a single byte lies."""
    return CDR_START + -(-(at - CDR_START) // 4) * 4


def decompressed(received: bytes) -> bytes:
    """Return the bytes of a ``PointCloud2`` for those of a ``CompressedPointCloud2``.

    Raises
    ------
    CloudError
        If it is damaged, or of another format. Its shape bounds the memory, and MAX_CLOUD_BYTES.

    """
    order = BYTE_ORDERS.get(received[:2])
    if order is None:
        raise CloudError('a compressed cloud', 'in plain CDR', received[:2].hex() or 'no bytes')
    found = layout(received, order)
    size = found.height * found.row_step
    if size > MAX_CLOUD_BYTES:
        must_be = f'of at most {MAX_CLOUD_BYTES} bytes'
        raise CloudError('the points of a compressed cloud', must_be, size)
    name = received[_aligned(found.end + 1) + 4 :].rstrip(b'\x00').decode(errors='replace')
    if name not in DECODERS:
        must_be = ' or '.join(map(repr, DECODERS))
        raise CloudError('the format of a compressed cloud', must_be, repr(name))
    points = DECODERS[name](memoryview(received)[found.begin : found.end], size)
    head = received[: found.begin - 4] + struct.pack(order + 'I', size)
    return b''.join((head, points, received[found.end : found.end + 1]))


def _from_zlib(data: memoryview, size: int) -> bytes:
    reader = zlib.decompressobj(GZIP_OR_ZLIB)
    with refusing(CloudError, *_must_be('zlib', size), zlib.error):
        points = reader.decompress(data, size + 1)  # the checksum is read after the last byte
    if len(points) != size or not reader.eof or reader.unused_data:
        raise CloudError(*_must_be('zlib', size), 'other bytes')
    return points


def _from_zstd(data: memoryview, size: int) -> bytes:
    with refusing(CloudError, "a cloud of format 'zstd'", 'read by zstandard', ImportError):
        import zstandard  # noqa: PLC0415  that nodes without such clouds do not need
    with refusing(CloudError, *_must_be('zstd', size), zstandard.ZstdError):
        # Which the publisher writes, and the reader would allocate; -1: not in the frame.
        if (declared := zstandard.frame_content_size(data)) != size:
            raise CloudError(*_must_be('zstd', size), declared)
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)


def _must_be(name: str, size: int) -> tuple[str, str]:
    return 'the data of a compressed cloud', f'{name} of row_step × height = {size} bytes'


# By the last word of the topic's name, too.
DECODERS = {'zlib': _from_zlib, 'zstd': _from_zstd}
