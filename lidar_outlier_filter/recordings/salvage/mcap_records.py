# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file, walked from the first to the last without reading what is in them.

So a file is refused before memory is taken for a length that it cannot have, and the chunks are
known that its index lacks.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader

from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _MESSAGE, _CHUNK, _DATA_END = 2, 5, 6, 15
_HEAD = struct.Struct('<BQ')  # kind and length of a record
_CHUNK_HEAD = struct.Struct(
    '<QQQII'
)  # first and last time, size unpacked, checksum, length of a word
_LONG = struct.Struct('<Q')
_FOOTER_SIZE = 20
_TAIL = _HEAD.size + _FOOTER_SIZE + len(MAGIC)


class Walk(NamedTuple):
    """What a walk over the records of a file found.

    ``loose`` counts the messages that are in no chunk;
    ``whole`` is where the last record that is whole ends; ``wrong`` says what stands behind it,
    empty in a file that is whole.
    """

    chunks: tuple[ChunkInfo, ...]
    loose: int
    whole: int
    wrong: str


def walk(path: RecordingPath, largest: int) -> Walk:
    """Walk over the records of a file up to the footer.

    Parameters
    ----------
    path : the file
    largest : bytes that a chunk, unpacked, and a message may have

    Raises
    ------
    RecordingError
        If a chunk or a message is larger, or says so.

    """
    size = path.stat().st_size
    chunks: list[ChunkInfo] = []
    with path.open('rb') as stream:
        offset = len(MAGIC)
        if stream.read(offset) != MAGIC:
            return Walk((), 0, 0, 'no MCAP file')
        loose, data = 0, True  # in front of the summary
        while True:
            head = stream.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return Walk(tuple(chunks), loose, offset, f'an end at byte {size} without a footer')
            kind, length = _HEAD.unpack(head)
            end = offset + _HEAD.size + length
            if end > size:
                return Walk(
                    tuple(chunks), loose, offset, f'a record at byte {offset} that ends behind it'
                )
            if kind == _FOOTER:
                stream.seek(end)
                whole = length == _FOOTER_SIZE and stream.read() == MAGIC
                return Walk(tuple(chunks), loose, offset, '' if whole else 'a footer that is none')
            if kind == _DATA_END:
                data = False
            if kind == _CHUNK and data:
                chunk = chunk_at(stream, offset, length)
                if chunk is None:
                    return Walk(
                        tuple(chunks), loose, offset, f'a chunk at byte {offset} that is none'
                    )
                _check(path, f'the chunk at byte {offset}', chunk.uncompressed_size, largest)
                chunks.append(chunk)
            elif kind == _MESSAGE:
                _check(path, f'the message at byte {offset}', length, largest)
                loose += 1
            offset = end
            stream.seek(offset)


def chunk_at(stream: BinaryIO, offset: int, length: int) -> ChunkInfo | None:
    """Read the head of a chunk; None, if its parts have not the length that they should have."""
    head = stream.read(min(_CHUNK_HEAD.size, length))
    if len(head) < _CHUNK_HEAD.size:
        return None
    first, last, unpacked, _, letters = _CHUNK_HEAD.unpack(head)
    if _CHUNK_HEAD.size + letters + _LONG.size > length:
        return None
    compression = stream.read(letters).decode('latin-1')
    (packed,) = _LONG.unpack(stream.read(_LONG.size))
    if _CHUNK_HEAD.size + letters + _LONG.size + packed != length:
        return None
    return ChunkInfo(
        first, last, offset, _HEAD.size + length, {}, 0, compression, packed, unpacked, {}
    )


def _check(path: RecordingPath, what: str, size: int, largest: int) -> None:
    if size > largest:
        raise RecordingError(f'{what} of {path}', f'of at most {largest} bytes', size)


def has_summary(path: RecordingPath, largest: int) -> bool:
    """Return whether a file ends with a summary, of at most ``largest`` bytes.

    Its records need no walk then: over a network, one would read a part of every chunk.
    """
    size = path.stat().st_size
    if size < len(MAGIC) + _TAIL:
        return False
    with path.open('rb') as stream:
        stream.seek(size - _TAIL)
        tail = stream.read(_TAIL)
    if not tail.endswith(MAGIC) or _HEAD.unpack_from(tail) != (_FOOTER, _FOOTER_SIZE):
        return False
    (start,) = _LONG.unpack_from(tail, _HEAD.size)
    return bool(0 < start <= size - _TAIL and size - start <= largest)


def complete_from_summary(path: RecordingPath, reader: McapReader, largest: int) -> None:
    """Check what the summary of a file says of its chunks; walk over them where it lacks some.

    Raises
    ------
    RecordingError
        If a chunk has more than ``largest`` bytes, or is not within the file.

    """
    size = path.stat().st_size
    for chunk in reader.chunks:
        what = f'the chunk at byte {chunk.chunk_start_offset}'
        _check(path, what, max(chunk.uncompressed_size, chunk.compressed_size), largest)
        if chunk.chunk_start_offset + chunk.chunk_length > size:
            raise RecordingError(f'{what} of {path}', f'within its {size} bytes', 'one beyond')
    listed = Walk(tuple(reader.chunks), 0, size, '')
    if not (_channels_known(reader, listed) and _chunks_known(reader, listed)):
        complete(reader, walk(path, largest))


def complete(reader: McapReader, found: Walk) -> None:
    """Give a reader all channels and chunks of its file, where its index lacks some of them.

    rosbags reads no channel and no chunk that the index does not name, nor a chunk without an index
    of its messages, nor messages in no chunk beside chunks.
    """
    if not _channels_known(reader, found):
        _read_channels(reader)
    if found.loose:
        reader.chunks.clear()
    elif not _chunks_known(reader, found):
        counts = dict.fromkeys((connection.id for connection in reader.connections), 1)
        reader.chunks[:] = [chunk._replace(channel_count=counts) for chunk in found.chunks]


def _channels_known(reader: McapReader, found: Walk) -> bool:
    """Return whether every channel that has messages is named by the index."""
    known = {connection.id for connection in reader.connections}
    if not known:
        return not found.chunks and not found.loose
    counted = set(reader.statistics.channel_message_counts) if reader.statistics else set()
    return known >= counted.union(*(chunk.message_index_offsets for chunk in reader.chunks))


def _read_channels(reader: McapReader) -> None:
    """Let rosbags read the whole file for its channels, and count their messages."""
    reader.meta_scan()
    counts = reader.statistics.channel_message_counts if reader.statistics else {}
    reader.connections[:] = [
        connection._replace(msgcount=counts.get(connection.id, 0))
        for connection in reader.connections
    ]


def _chunks_known(reader: McapReader, found: Walk) -> bool:
    """Return whether the index names every chunk as it is, and all its messages."""
    listed = {chunk.chunk_start_offset: chunk for chunk in reader.chunks}
    for chunk in found.chunks:
        one = listed.get(chunk.chunk_start_offset)
        if one is None or (one.chunk_length, *one[6:9]) != (chunk.chunk_length, *chunk[6:9]):
            return False
        if not one.channel_count:
            return False
    counted = sum(sum(chunk.channel_count.values()) for chunk in reader.chunks)
    return reader.statistics is None or counted == reader.statistics.message_count
