# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What can be read of a damaged ROS 1 bag: every whole chunk, found without the index."""

from __future__ import annotations

import struct
from collections import Counter
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Header

from lidar_outlier_filter.errors import RecordingError, said_by
from lidar_outlier_filter.recordings.unpack import unpack

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rosbags.interfaces import Connection

    from lidar_outlier_filter.recordings.salvage.losses import Losses

_MAGIC = b'#ROSBAG V2.0\n'
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = range(2, 8)
_SHORT = struct.Struct('<I')
_MOST_HEADER = 2**20  # bytes of the header of a record
# A chunk's header has three fields: compression of 20 or 19 bytes, op of 8 and size of 13.
_WORD = b'compression='
_FIELDS_BEFORE = (0, 8, 13, 21)  # bytes of the fields that may stand before the compression
_WINDOW = 2**20  # bytes searched at once


class _BagRecord(NamedTuple):
    """A record's header, and where it and its data begin and end, in bytes."""

    header: Header
    offset: int
    begin: int
    end: int


class DamagedBag:
    """A ROS 1 bag that may be damaged anywhere.

    ``connections`` are those that are known; ``expected`` counts the messages that its index has.
    """

    def __init__(self, path: Path, largest: int, losses: Losses) -> None:
        """Read the bag through, and count what is lost; chunks of more than ``largest`` are."""
        self.path, self._largest, self._losses = path, largest, losses
        self._size = path.stat().st_size
        self.expected = 0
        self._known: dict[int, Connection] = {}
        self._counts: Counter[int] = Counter()
        self._good: list[_BagRecord] = []
        self._chunks = 0  # that the header says there are
        with path.open('rb') as stream:
            self._read_through(stream)
        if missing := max(0, self._chunks - len(self._good) - losses.chunks):
            losses.add(f'{path.name}: {missing} chunks are not there', chunks=missing)
        for number in self._counts.keys() - self._known.keys():
            losses.add(
                f'{path.name}: nothing says what connection {number} is',
                messages=self._counts[number],
            )
        self.connections = [
            connection._replace(msgcount=self._counts[connection.id])
            for connection in self._known.values()
        ]

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Read the connection, bag time and bytes of each message, in the order of the file."""
        with self.path.open('rb') as stream:
            for chunk in self._good:
                data = self._unpacked(stream, chunk)
                for one in _records(data):
                    if one.header.get_uint8('op') == _MESSAGE:
                        number = one.header.get_uint32('conn')
                        if number in self._known:
                            yield number, one.header.get_time('time'), data[one.begin : one.end]

    def _read_through(self, stream: BinaryIO) -> None:
        offset = len(_MAGIC) if stream.read(len(_MAGIC)) == _MAGIC else 0
        lost = False  # the last chunk
        while offset < self._size:
            record = _record(stream, offset, self._size)
            if record is None:
                found = self._next(stream, offset + 1)
                self._losses.add(
                    f'{self.path.name}: no record at byte {offset}', size=found - offset
                )
                offset = found
                continue
            offset = record.end
            if record.header.get_uint8('op') == _INDEX:
                if lost and 'count' in record.header:
                    self._losses.messages += record.header.get_uint32('count')
            else:
                lost = not self._take(stream, record)

    def _take(self, stream: BinaryIO, record: _BagRecord) -> bool:
        """Take what a record says; return whether it could be read."""
        kind = record.header.get_uint8('op')
        try:
            if kind == _CHUNK:
                self._learn_chunk(self._unpacked(stream, record))
                self._good.append(record)
            elif kind == _CONNECTION:
                stream.seek(record.offset)
                self._learn(stream.read(record.end - record.offset))
            elif kind == _BAG:
                self._learn_header(record.header)
            elif kind == _CHUNK_INFO:
                stream.seek(record.begin)
                counts = stream.read(record.end - record.begin)
                self.expected += sum(count for _, count in struct.iter_unpack('<II', counts))
        except Exception as err:  # noqa: BLE001  on damaged bytes, decoders raise anything
            what = f'the {"chunk" if kind == _CHUNK else "record"} at byte {record.offset}'
            self._losses.add(
                f'{self.path.name}: {what}: {said_by(err)}',
                chunks=int(kind == _CHUNK),
                size=record.end - record.offset,
            )
            return False
        return True

    def _learn_header(self, header: Header) -> None:
        self._chunks = header.get_uint32('chunk_count')
        if header.get_uint64('index_pos') == 0:
            self._losses.add(f'{self.path.name}: it was not closed by its recorder')

    def _learn_chunk(self, data: bytes) -> None:
        """Note the connections and messages of a chunk, if all of it is a sequence of records."""
        counts: Counter[int] = Counter()
        for one in list(_records(data)):
            if one.header.get_uint8('op') == _CONNECTION:
                self._learn(data[one.offset : one.end])
            elif one.header.get_uint8('op') == _MESSAGE:
                one.header.get_time('time')
                counts[one.header.get_uint32('conn')] += 1
        self._counts.update(counts)

    def _learn(self, data: bytes) -> None:
        """Note a connection."""
        reader = Reader(self.path)
        reader.bio = BytesIO(data)
        connection = reader.read_connection()
        self._known.setdefault(connection.id, connection)

    def _unpacked(self, stream: BinaryIO, record: _BagRecord) -> bytes:
        size = record.header.get_uint32('size')
        if max(size, record.end - record.begin) > self._largest:
            raise RecordingError('a chunk', f'of at most {self._largest} bytes', size)
        stream.seek(record.begin)
        data = stream.read(record.end - record.begin)
        compression = record.header.get_string('compression')
        if compression != 'none':
            data = unpack(data, size, compression=compression)
        if len(data) != size:
            raise RecordingError('a chunk', f'of {size} bytes, as it says', len(data))
        return data

    def _next(self, stream: BinaryIO, offset: int) -> int:
        """Find the next chunk behind damage; the end of the file for none."""
        first = offset
        while offset < self._size:
            stream.seek(offset)
            window = stream.read(_WINDOW + len(_WORD) - 1)
            at = window.find(_WORD)
            while at >= 0:
                for before in _FIELDS_BEFORE:
                    begin = offset + at - 8 - before
                    if begin >= first and self._is_chunk(stream, begin):
                        return begin
                at = window.find(_WORD, at + 1)
            offset += _WINDOW
        return self._size

    def _is_chunk(self, stream: BinaryIO, offset: int) -> bool:
        record = _record(stream, offset, self._size)
        return record is not None and record.header.get_uint8('op') == _CHUNK


def _record(stream: BinaryIO, offset: int, size: int) -> _BagRecord | None:
    """Read the header of the record at an offset; None if there is none that is whole."""
    stream.seek(offset)
    head = stream.read(_SHORT.size)
    if len(head) < _SHORT.size or _SHORT.unpack(head)[0] > min(_MOST_HEADER, size - offset):
        return None
    stream.seek(offset)
    try:
        header = Header.read(stream)
        header.get_uint8('op')
        (length,) = _SHORT.unpack(stream.read(_SHORT.size))
    except Exception:  # noqa: BLE001  as above
        return None
    begin = stream.tell()
    known = _MESSAGE <= header.get_uint8('op') <= _CONNECTION
    return (
        _BagRecord(header, offset, begin, begin + length)
        if known and begin + length <= size
        else None
    )


def _records(data: bytes) -> Iterator[_BagRecord]:
    """Walk over the records of a chunk; the last one must end where it ends."""
    stream, offset = BytesIO(data), 0
    while offset < len(data):
        record = _record(stream, offset, len(data))
        if record is None:
            raise RecordingError('a chunk', 'a sequence of records', 'other bytes')
        yield record
        offset = record.end
