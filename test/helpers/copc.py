# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A writer of small COPC files, by the standard (https://copc.io), and a reader of their levels."""

import io
import struct
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np

from helpers.cloud_files import number, patch

LASZIP = 22204
INFO = 375 + 54  # bytes before the content of the first record
KEYS = (1, 1, 0, 0), (0, 0, 0, 0), (2, 2, 0, 1), (1, 0, 1, 0)  # of the chunks in the file
EMPTY = (2, 3, 0, 0)


def write_copc(path: Path, sizes: tuple[int, ...] = (40, 25, 1, 300), point_format: int = 6) -> Any:
    """Write a node per chunk, the first of which is in a page of its own; return the points.

    Behind the octree there is another record.
    """
    header = laspy.LasHeader(point_format=point_format, version='1.4')
    rng, count = np.random.default_rng(4), sum(sizes)
    points = laspy.ScaleAwarePointRecord.zeros(count, header=header)
    points['X'], points['gps_time'] = rng.integers(0, 1000, count), rng.uniform(0, 9, count)
    points['classification'] = rng.integers(1, 7, count)
    laszip = lazrs.LazVlr.new_for_compression(point_format, 0, use_variable_size_chunks=True)
    header.vlrs.append(laspy.VLR('copc', 1, 'COPC info', bytes(160)))
    header.vlrs.append(laspy.VLR('laszip encoded', LASZIP, '', bytes(laszip.record_data())))
    header.vlrs.append(laspy.VLR('someone', 7, '', b'kept'))
    header.vlrs.append(laspy.VLR('copc', 10000, 'COPC extents', bytes(224)))
    las = io.BytesIO()
    writer = laspy.LasWriter(las, header, do_compress=False, closefd=False)
    writer.write_points(points)
    writer.close()
    begin = number(las.getvalue(), 96, 4)
    stream = io.BytesIO(las.getvalue()[:begin])
    stream.seek(0, io.SEEK_END)
    packer = lazrs.LasZipCompressor(stream, laszip)
    packer.reserve_offset_to_chunk_table()
    parts = np.split(points.array, np.cumsum(sizes)[:-1])
    for one, part in enumerate(parts):
        if one:
            packer.finish_current_chunk()
        packer.compress_many(part.tobytes())
    packer.done()
    stream.seek(begin)
    chunks = [one for one in lazrs.read_chunk_table(stream, laszip) if one[0]]
    end = stream.seek(0, io.SEEK_END)
    pages, root = _pages(begin + 8, end + 60, chunks)
    for user, record, data in ((b'copc', 1000, pages), (b'someone', 8, b'kept, too')):
        stream.write(struct.pack('<H16sHQ32s', 0, user, record, len(data), b'') + data)
    path.write_bytes(stream.getvalue())
    patch(path, 104, bytes([point_format | 128]))
    patch(path, 235, struct.pack('<QI', end, 2))
    patch(path, INFO, struct.pack('<5d2Q2d', 5, 5, 5, 5, 0.1, *root, 0, 9))
    return points


def _pages(offset: int, begin: int, chunks: list[tuple[int, int]]) -> tuple[bytes, tuple[int, int]]:
    """Return the pages, and offset and size of the root page, which is behind the other one."""
    entries = []
    for key, (count, size) in zip(KEYS, chunks, strict=True):
        entries.append(struct.pack('<4iQii', *key, offset, size, count))
        offset += size
    other = entries[0] + struct.pack('<4iQii', *EMPTY, 0, 0, 0)
    link = struct.pack('<4iQii', *KEYS[0], begin, len(other), -1)
    root = b''.join([*entries[1:], link])
    return other + root, (begin + len(other), len(root))


def levels(path: Path) -> list[Any]:
    """Return the points of each level of the octree, as laspy's own reader of COPC finds them."""
    with laspy.CopcReader.open(path) as reader:
        return [reader.query(level=level).array.copy() for level in range(4)]
