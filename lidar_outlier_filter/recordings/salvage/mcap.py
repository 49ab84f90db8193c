# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What can be read of a damaged MCAP file: every whole chunk, and every message in no chunk.

A chunk counts as a whole, as for ``mcap recover``: if its checksum or the sequence of its records
is wrong, all of it is lost. Behind damage, the next chunk or message is looked for byte by
byte, so that neither an index nor a summary is needed. So the whole messages are found, too, of a
chunk that is not compressed, and whose head or end is lost.
"""

from __future__ import annotations

import re
import struct
from binascii import crc32
from collections import Counter
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import ChunkInfo, Schema, get_msgdef, get_qos

from lidar_outlier_filter.errors import RecordingError, said_by
from lidar_outlier_filter.recordings.salvage.mcap_records import MAGIC, chunk_at
from lidar_outlier_filter.recordings.unpack import unpack

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from lidar_outlier_filter.recordings.salvage.losses import Losses

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _STATISTICS = 2, 3, 4, 5, 6, 7, 11
# The parts of each kind of record: so many bytes, or the bytes that a number before them counts.
_SHORT, _LONG = struct.Struct('<I'), struct.Struct('<Q')
_PARTS: dict[int, tuple[int | struct.Struct, ...]] = {
    1: (_SHORT, _SHORT),
    _FOOTER: (20,),
    _SCHEMA: (2, _SHORT, _SHORT, _SHORT),
    _CHANNEL: (4, _SHORT, _SHORT, _SHORT),
    _INDEX: (2, _SHORT),
    8: (32, _SHORT, 8, _SHORT, 16),
    9: (16, _SHORT, _SHORT, _LONG, 4),
    10: (40, _SHORT, _SHORT),
    _STATISTICS: (42, _SHORT),
    12: (_SHORT, _SHORT),
    13: (16, _SHORT),
    14: (17,),
    15: (4,),
}
_HEAD = struct.Struct('<BQ')  # kind and length of a record
_MESSAGE_HEAD = struct.Struct('<HIQQ')  # channel, number, bag time, time of publishing
# How a chunk, or a message of less than 4 GiB, begins.
_BEGINNING = re.compile(rb'[\x05\x06].{4}\0{4}', re.DOTALL)
_WINDOW = 2**20  # bytes searched at once


class _McapRecord(NamedTuple):
    """Kind of a record, its offset and where its contents begin and end, in bytes."""

    kind: int
    offset: int
    begin: int
    end: int


class DamagedMcap:
    """An MCAP file that may be damaged anywhere.

    ``connections`` are those of its channels that are known; ``expected`` counts the messages that
    the file says it has, 0 where it does not say.
    """

    def __init__(
        self, path: Path, largest: int, losses: Losses, types: Mapping[str, str] | None = None
    ) -> None:
        """Read the file through, and count what is lost.

        ``types`` of topics help where their schemas are lost; chunks and messages of more than
        ``largest`` bytes are.
        """
        self.path, self._largest, self._losses = path, largest, losses
        self._size = path.stat().st_size
        self.expected = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[int, str, str, bytes]] = {}
        self._counts: Counter[int] = Counter()
        self._good: list[_McapRecord] = []  # chunks and messages
        with path.open('rb') as stream:
            self._read_through(stream)
        self.connections = list(self._connections(types or {}))

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Read the channel, bag time and bytes of each message, in the order of the file."""
        known = {connection.id for connection in self.connections}
        with self.path.open('rb') as stream:
            for record in self._good:
                data = self._contents(stream, record)
                for one in [record] if record.kind == _MESSAGE else _records(data):
                    if one.kind == _MESSAGE:
                        part = data if one is record else data[one.begin : one.end]
                        channel, _, time, _ = _MESSAGE_HEAD.unpack_from(part)
                        if channel in known:
                            yield channel, time, part[_MESSAGE_HEAD.size :]

    def _read_through(self, stream: BinaryIO) -> None:
        offset = len(MAGIC) if stream.read(len(MAGIC)) == MAGIC else 0
        ended = lost = False  # lost: the last chunk
        while offset < self._size and not ended:
            record = self._record(stream, offset)
            if record is None:
                found = self._next(stream, offset + 1)
                self._lose(f'no record at byte {offset}', size=found - offset)
                offset = found
                continue
            if record.kind == _INDEX and lost:
                self._losses.messages += max(0, record.end - record.begin - 6) // 16
            elif record.kind != _INDEX:
                lost = not self._take(stream, record)
            ended, offset = record.kind == _FOOTER, record.end
        if not ended:
            self._lose(f'it ends at byte {self._size} without a footer')

    def _lose(self, reason: str, *, size: int = 0, chunks: int = 0) -> None:
        self._losses.add(f'{self.path.name}: {reason}', size=size, chunks=chunks)

    def _take(self, stream: BinaryIO, record: _McapRecord) -> bool:
        """Take what a record says; return whether it could be read."""
        try:
            data = self._contents(stream, record)
            if record.kind == _CHUNK:
                parts = list(_records(data))
                for one in parts:
                    self._learn(one.kind, data[one.begin : one.end])
            else:
                self._learn(record.kind, data)
        except Exception as err:  # noqa: BLE001  on damaged bytes, decoders raise anything
            is_chunk = record.kind == _CHUNK
            what = f'the {"chunk" if is_chunk else "record"} at byte {record.offset}'
            self._lose(
                f'{what}: {said_by(err)}', size=record.end - record.offset, chunks=int(is_chunk)
            )
            return False
        if record.kind in {_CHUNK, _MESSAGE}:
            self._good.append(record)
        return True

    def _learn(self, kind: int, data: bytes) -> None:
        """Note a schema, a channel, the message of a channel, or how many messages there are."""
        if kind == _SCHEMA:
            (number,) = struct.unpack_from('<H', data)
            name, encoding, text = _strings(data, 2, 3)
            schema = Schema(number, name.decode(), encoding.decode(), text.decode())
            self._schemas.setdefault(number, schema)
        elif kind == _CHANNEL:
            number, schema_number = struct.unpack_from('<HH', data)
            topic, encoding, metadata = _strings(data, 4, 3)
            channel = (schema_number, topic.decode(), encoding.decode(), metadata)
            self._channels.setdefault(number, channel)
        elif kind == _MESSAGE:
            self._counts[_MESSAGE_HEAD.unpack_from(data)[0]] += 1
        elif kind == _STATISTICS:
            (self.expected,) = _LONG.unpack_from(data)

    def _contents(self, stream: BinaryIO, record: _McapRecord) -> bytes:
        """Read what is in a record; a chunk is unpacked and checked."""
        if record.kind == _CHUNK:
            return self._unpacked(stream, record)
        if record.kind not in {_SCHEMA, _CHANNEL, _MESSAGE, _STATISTICS}:
            return b''
        if record.end - record.begin > self._largest:
            raise RecordingError('a message', f'of at most {self._largest} bytes', 'more')
        stream.seek(record.begin)
        return stream.read(record.end - record.begin)

    def _unpacked(self, stream: BinaryIO, record: _McapRecord) -> bytes:
        chunk = self._chunk(stream, record)
        if chunk is None or max(chunk.uncompressed_size, chunk.compressed_size) > self._largest:
            raise RecordingError('a chunk', f'of at most {self._largest} bytes', 'more')
        stream.seek(record.begin + 24)
        (checksum,) = _SHORT.unpack(stream.read(4))
        stream.seek(record.end - chunk.compressed_size)
        data = stream.read(chunk.compressed_size)
        if chunk.compression:
            data = unpack(data, chunk.uncompressed_size, compression=chunk.compression)
        if len(data) != chunk.uncompressed_size or (checksum and crc32(data) != checksum):
            raise RecordingError('a chunk', 'what its checksum and size say', 'other bytes')
        return data

    def _chunk(self, stream: BinaryIO, record: _McapRecord) -> ChunkInfo | None:
        stream.seek(record.begin)
        return chunk_at(stream, record.offset, record.end - record.begin)

    def _record(self, stream: BinaryIO, offset: int) -> _McapRecord | None:
        """Find the record at an offset; None if there is none that is whole and fits its parts."""
        stream.seek(offset)
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        kind, length = _HEAD.unpack(head)
        record = _McapRecord(kind, offset, offset + _HEAD.size, offset + _HEAD.size + length)
        if record.end > self._size:
            return None
        if kind == _CHUNK:
            return record if self._chunk(stream, record) is not None else None
        if kind == _MESSAGE:
            return record if length >= _MESSAGE_HEAD.size else None
        return record if kind in _PARTS and _fits(stream, record) else None

    def _next(self, stream: BinaryIO, offset: int) -> int:
        """Find the next chunk or message behind damage; the end of the file for none."""
        while offset < self._size:
            stream.seek(offset)
            window = stream.read(_WINDOW + _HEAD.size - 1)
            for match in _BEGINNING.finditer(window):
                if self._begins(stream, offset + match.start()):
                    return offset + match.start()
            offset += _WINDOW
        return self._size

    def _begins(self, stream: BinaryIO, offset: int) -> bool:
        """Return whether a chunk begins at an offset, or a message with a record behind it."""
        record = self._record(stream, offset)
        if record is None or record.kind == _CHUNK:
            return record is not None
        stream.seek(record.begin)
        known = _MESSAGE_HEAD.unpack(stream.read(_MESSAGE_HEAD.size))[0] in self._channels
        return known and (record.end == self._size or self._record(stream, record.end) is not None)

    def _connections(self, types: Mapping[str, str]) -> Iterator[Connection]:
        """Make the connections of all channels that are known; the messages of others are lost."""
        for number, (schema_number, topic, encoding, metadata) in self._channels.items():
            schema = self._schemas.get(schema_number)
            try:
                definition = get_msgdef(schema)
                name = types[topic] if schema is None else schema.name
                extension = ConnectionExtRosbag2(encoding, get_qos(metadata))
            except Exception:  # noqa: BLE001  as above
                self._losses.add(
                    f'{self.path.name}: {topic} has no schema', messages=self._counts[number]
                )
                continue
            count = self._counts[number]
            owner: Any = self
            yield Connection(number, topic, name, definition, '', count, extension, owner)
        for number in self._counts.keys() - self._channels.keys():
            self._losses.add(
                f'{self.path.name}: nothing says what channel {number} is',
                messages=self._counts[number],
            )


def _fits(stream: BinaryIO, record: _McapRecord) -> bool:
    """Return whether the parts of a record are as long as it is."""
    offset = record.begin
    for part in _PARTS[record.kind]:
        if isinstance(part, struct.Struct):
            stream.seek(offset)
            number = stream.read(part.size)
            if len(number) < part.size:
                return False
            offset += part.size + part.unpack(number)[0]
        else:
            offset += part
        if offset > record.end:
            return False
    return offset == record.end


def _records(data: bytes) -> Iterator[_McapRecord]:
    """Walk over the records of a chunk; the last one must end where it ends."""
    offset = 0
    while offset < len(data):
        kind, length = _HEAD.unpack_from(data, offset)
        begin, end = offset + _HEAD.size, offset + _HEAD.size + length
        if end > len(data) or (kind == _MESSAGE and length < _MESSAGE_HEAD.size):
            raise RecordingError('a chunk', 'a sequence of records', 'other bytes')
        yield _McapRecord(kind, offset, begin, end)
        offset = end


def _strings(data: bytes, offset: int, count: int) -> list[bytes]:
    """Cut so many texts out of a record, each with its length before it."""
    texts = []
    for _ in range(count):
        (length,) = _SHORT.unpack_from(data, offset)
        offset += _SHORT.size + length
        if offset > len(data):
            raise RecordingError('a text', 'within its record', 'more')
        texts.append(data[offset - length : offset])
    return texts
