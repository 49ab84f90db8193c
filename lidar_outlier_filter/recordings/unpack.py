# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compressed parts of recordings, unpacked to what they say they are, and to no byte more.

rosbags unpacks whatever there is: 47 kB may become 1.5 GB. Its tables of functions get ours.
"""

from __future__ import annotations

from bz2 import BZ2Decompressor
from functools import partial
from typing import TYPE_CHECKING, Any

from lz4.frame import LZ4FrameDecompressor
from rosbags.rosbag2 import storage_mcap

from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1

LARGEST = 256_000_000  # bytes of a message or of a chunk of messages
_MAKERS: dict[str, type[Any]] = {
    'bz2': BZ2Decompressor,
    'lz4': LZ4FrameDecompressor,
    'zstd': vars(storage_mcap)['zstd'].ZstdDecompressor,  # of Python or a package, by the version
}


def decompressor(compression: str) -> Any:
    """Make what unpacks one frame."""
    return _MAKERS[compression]()


def unpack(data: bytes, most: int = LARGEST, *, compression: str) -> bytes:
    """Unpack bytes, of one frame or several; refuse more than ``most``, and an end within one."""
    parts: list[bytes] = []
    left = most
    while data:
        frame = decompressor(compression)
        parts.append(frame.decompress(data, left + 1))
        left -= len(parts[-1])
        if left < 0:
            raise RecordingError('a compressed part', f'of at most {most} bytes', 'more')
        if not frame.eof:
            raise RecordingError('a compressed part', 'whole', 'its end within a frame')
        data = frame.unused_data
    return parts[0] if len(parts) == 1 else b''.join(parts)


def bound_mcap() -> None:
    """Let rosbags unpack no more of a chunk than the chunk says it has."""
    table: dict[str, Any] = storage_mcap.DECOMPRESSORS
    for name in ('lz4', 'zstd'):
        table[name] = partial(unpack, compression=name)


def bound_chunks(reader: Reader1, largest: int) -> None:
    """Let rosbags unpack no chunk of a ROS 1 bag that is larger than ``largest`` bytes."""
    for offset, chunk in reader.chunks.items():
        for name in ('bz2', 'lz4'):
            if name in getattr(chunk.decompressor, '__module__', ''):
                bounded = partial(unpack, most=largest, compression=name)
                reader.chunks[offset] = chunk._replace(decompressor=bounded)
