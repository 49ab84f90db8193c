# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the header of a LAS or LAZ file says, held against the size of the file.

laspy believes a header: it reads as many records as that counts, also behind the end of the file,
and of the points no more than that counts.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, BinaryIO

import lazrs

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.size_check import (
    check_count,
    check_fits,
    check_offset,
    check_points,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

LONGEST = 375  # bytes of a header that are looked at
SHORTEST = 227  # bytes of a header of LAS 1.0 to 1.2
_WITH_EVLRS = 4  # the minor version that brought extended records
VLR = struct.Struct('<H16sHH32s')
EVLR = struct.Struct('<H16sHQ32s')
_TABLE = struct.Struct('<II')  # version, chunks
_POINTERS = 8  # bytes of the offset of the chunk table, in front of the first chunk
_CHUNKED, _LAYERED = 2, 3  # compressors of LASzip
# Layers of the items of a point, by their kind; of bytes as many as there are.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_BYTES = 14
_SHORTEST_LASZIP = 34  # bytes, without any item
_MOST = 2**31  # units that a coordinate may have
_OF_ANY_SIZE = 2**32 - 1
LARGEST_CHUNK = 256_000_000  # bytes of the points of a chunk; lazrs takes memory for all of them


def check_records(path: Path) -> None:
    """Refuse records, before and behind the points, that do not fit into the file."""
    size = path.stat().st_size
    with path.open('rb') as stream:
        header = stream.read(LONGEST)
        if header[:4] != b'LASF':
            return  # laspy says so
        what = 'the header of'
        if len(header) < SHORTEST:
            raise CloudError(f'{what} {path}', f'of at least {SHORTEST} bytes', len(header))
        begin, points = _number(header, 94, 2), _number(header, 96, 4)
        check_offset(path, 'the end of the header', begin, SHORTEST, size)
        check_offset(path, 'the first point', points, begin, size)
        _check_chain(stream, path, VLR, (begin, points), _number(header, 100, 4))
        if header[25] >= _WITH_EVLRS and (count := _number(header, 243, 4)):
            begin = _number(header, 235, 8)
            check_offset(path, 'the first extended record', begin, points, size)
            _check_chain(stream, path, EVLR, (begin, size), count)


def _check_chain(
    stream: BinaryIO, path: Path, layout: struct.Struct, offsets: tuple[int, int], count: int
) -> None:
    """Refuse records that do not all lie between two offsets (bytes) of the file."""
    offset, end = offsets
    check_fits(path, 'the number of records', count, layout.size, end - offset)
    for _ in range(count):
        check_offset(path, 'a record', offset, 0, end - layout.size)
        stream.seek(offset)
        length = layout.unpack(stream.read(layout.size))[3]
        offset += layout.size
        check_fits(path, 'the bytes in a record', length, 1, end - offset)
        offset += length


def check_scaling(path: Path, scales: Iterable[float], offsets: Iterable[float]) -> None:
    """Refuse scales and offsets that give coordinates which are no numbers, or all one.

    laspy takes NaN for another scaling than NaN, and would write other integers.
    """
    for axis, *pair in zip('xyz', scales, offsets, strict=True):
        scale, offset = map(float, pair)
        what = f'scale and offset of {axis} in {path}'
        if not math.isfinite(abs(scale) * _MOST + abs(offset)):
            raise CloudError(what, 'such that all coordinates are finite', f'{scale} and {offset}')
        if scale == 0:
            raise CloudError(what, 'such that coordinates differ', f'{scale} and {offset}')


def check_las_points(path: Path, count: int) -> None:
    """Refuse a count of points that are not compressed, if they are more or fewer."""
    with path.open('rb') as stream:
        header = stream.read(LONGEST)
    end = path.stat().st_size
    if header[25] >= _WITH_EVLRS and _number(header, 243, 4):
        end = _number(header, 235, 8)
    check_points(path, count, _number(header, 105, 2), _number(header, 96, 4), end)


def check_laz_points(path: Path, count: int, records: Sequence[bytes]) -> None:
    """Refuse a count of compressed points that is not that of their chunks.

    Chunks of the point formats 6 to 10 count their points. Of the others it is known how many are
    in each but the last: there may be more of them than the header counts.

    Parameters
    ----------
    path : the file
    count : what the header says
    records : those of LASzip, of which there must be one

    """
    if [len(record) >= _SHORTEST_LASZIP for record in records] != [True]:
        got = f'{[len(record) for record in records]}'
        must_be = f'one, of at least {_SHORTEST_LASZIP} bytes'
        raise CloudError(f'the records of LASzip in {path}', must_be, got)
    laszip = records[0]
    compressor, chunk_size = _number(laszip, 0, 2), _number(laszip, 12, 4)
    size = path.stat().st_size
    with path.open('rb') as stream:
        header = stream.read(LONGEST)
        begin, each = _number(header, 96, 4), _number(header, 105, 2)
        items = _items(laszip)
        if not items or sum(n for _, n in items) != each:
            must_be = f'of {each} bytes, as it says'
            raise CloudError(f'a point in {path}', must_be, sum(n for _, n in items))
        if {kind in _LAYERS or kind == _BYTES for kind, _ in items} != {compressor == _LAYERED}:
            must_be = (
                f'{_LAYERED}, in layers, for the point formats 6 to 10, and another for others'
            )
            raise CloudError(f'the compressor of {path}', must_be, compressor)
        if compressor not in {_CHUNKED, _LAYERED}:
            return
        stream.seek(begin)
        table = int.from_bytes(stream.read(_POINTERS), 'little', signed=True)
        if table == -1:  # written behind all, by who could not go back
            stream.seek(max(0, size - _POINTERS))
            table = int.from_bytes(stream.read(_POINTERS), 'little', signed=True)
        begin += _POINTERS
        check_offset(path, 'the table of chunks', table, begin, size - _TABLE.size)
        stream.seek(table)
        chunks = _TABLE.unpack(stream.read(_TABLE.size))[1]
        check_fits(path, 'the number of chunks', chunks, each, table - begin)
        stream.seek(begin - _POINTERS)
        found = lazrs.read_chunk_table(stream, lazrs.LazVlr(laszip)) if chunks else []
        check_fits(path, 'the bytes in all chunks', sum(n for _, n in found), 1, table - begin)
        if (largest := each * max((n for n, _ in found), default=0)) > LARGEST_CHUNK:
            must_be = f'at most {LARGEST_CHUNK} bytes'
            raise CloudError(f'the points of a chunk in {path}', must_be, largest)
        if compressor == _LAYERED:
            layers = sum(n if kind == _BYTES else _LAYERS.get(kind, 0) for kind, n in items)
            counts = _count_layered(path, stream, begin, each, layers, [n for _, n in found])
            check_count(path, count, sum(counts))
            _check_chunks(path, counts, [n for n, _ in found], fixed=chunk_size != _OF_ANY_SIZE)
            return
    most = sum(n for n, _ in found)
    last = found[-1][0] - 1 if found and chunk_size != _OF_ANY_SIZE else 0
    if not most - last <= count <= most:
        check_count(path, count, most)


def _items(laszip: bytes) -> list[tuple[int, int]]:
    """List what a point is made of: kind and size of each item."""
    found = struct.iter_unpack('<HHH', laszip[_SHORTEST_LASZIP:][: 6 * _number(laszip, 32, 2)])
    return [(kind, size) for kind, size, _ in found]


def _count_layered(  # noqa: PLR0913  where the chunks are, and how large
    path: Path, stream: BinaryIO, begin: int, each: int, layers: int, sizes: list[int]
) -> list[int]:
    """Read how many points are in each chunk, which counts them behind the bytes of its first.

    Behind the count are the sizes of its layers. Refuse a chunk that they do not fit into. Writers
    of chunks of any size may leave one without points, and without bytes, at the end.
    """
    counts = []
    for size in sizes:
        if not size:
            counts.append(0)
            continue
        stream.seek(begin + each)
        head = stream.read(4 + 4 * layers)
        inside = sum(number for (number,) in struct.iter_unpack('<I', head[4 : len(head) & ~3]))
        left = size - each - 4 - 4 * layers
        check_fits(path, 'the bytes in the layers of a chunk', inside, 1, left)
        counts.append(int.from_bytes(head[:4], 'little'))
        begin += size
    return counts


def _check_chunks(path: Path, counts: list[int], said: list[int], *, fixed: bool) -> None:
    """Refuse chunks that have other numbers of points than the file says of them.

    Of chunks of a fixed size, which is said of the last as well, the last may have fewer.
    """
    if fixed and counts and counts[-1] <= said[-1]:
        counts, said = counts[:-1], said[:-1]
    if counts != said:
        wrong = next(i for i, count in enumerate(counts) if count != said[i])
        what = f'the points of chunk {wrong} of {path}'
        raise CloudError(what, f'{said[wrong]}, as it says', counts[wrong])


def _number(data: bytes, offset: int, size: int) -> int:
    return int.from_bytes(data[offset : offset + size], 'little')
