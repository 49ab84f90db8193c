# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Copy the readable part of a damaged recording into a new, complete bag.

MCAP files are read record by record, databases row by row, ROS 1 bags message by message, each
until it cannot be read further. Losses are counted.
"""

import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any, BinaryIO

import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message, MessageIndex, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader, get_chunk_data_stream
from mcap.summary import Summary
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

from lidar_outlier_filter.disk.new_files import FOLDER, check_new, hidden_folder, writable
from lidar_outlier_filter.disk.sqlite_pages import connect, damage_of, open_logs
from lidar_outlier_filter.errors import RecordingError, printable, quote_error, refusing
from lidar_outlier_filter.recordings.bags import (
    NewBag,
    Recording,
    check_metadata,
    check_regular,
    texts_by_name,
)
from lidar_outlier_filter.recordings.channels import Topic, topic_of

MAX_KEPT_REASONS = 1000  # that are kept

# A message with its bag time, ns; without one, a topic that the file has.
_Item = tuple['Topic', int, bytes | None]


@dataclass
class Losses:
    """Minimum losses of a recording.

    Attributes
    ----------
    messages : as far as they can be counted
    chunks : chunks that cannot be unpacked, or have a wrong checksum
    reasons : texts of the first ``MAX_REASONS`` losses
    more : losses beyond these
    expected : messages by the statistics and indexes of the files

    """

    messages: int = 0
    chunks: int = 0
    reasons: list[str] = field(default_factory=list)
    more: int = 0
    expected: int = field(default=0, compare=False)

    def add(self, reason: str, *, messages: int = 0, chunks: int = 0) -> None:
        """Count one loss."""
        if len(self.reasons) < MAX_KEPT_REASONS:
            self.reasons.append(printable(' '.join(reason.split())))
        else:
            self.more += 1
        self.messages += messages
        self.chunks += chunks

    def said(self, most: int = MAX_KEPT_REASONS) -> list[str]:
        """List so many of the first reasons, and behind them how many more there are."""
        more = self.more + max(0, len(self.reasons) - most)
        return self.reasons[:most] + ([f'and {more} more'] if more else [])


@contextmanager
def salvaged(path: Path, output: Path, largest: int) -> Iterator[tuple[Path, Losses]]:
    """Give a copy, in a hidden folder beside ``output``, of the readable part, and the losses."""
    if not path.exists():
        raise RecordingError('the recording', 'an existing file or folder', path)
    check_regular(path)
    check_new(output, FOLDER)
    losses = Losses()
    with writable(output), hidden_folder(output) as folder:
        copy = folder / 'salvaged'
        _copy(path, folder, copy, largest, losses)
        yield copy, losses


def _copy(path: Path, folder: Path, copy: Path, largest: int, losses: Losses) -> None:
    bag = _metadata(path, losses)
    zipped = str(bag.get('compression_mode')).lower() == 'message'
    topics: dict[tuple[str, str], Topic] = {}
    found = 0
    with NewBag(copy, bag.get('custom_data') or {}) as new:
        for file in _files(path, bag, losses):
            for topic, time, data in _open(file, folder, largest, losses):
                if (key := (topic.name, topic.msgtype)) not in topics:
                    new.add(topics.setdefault(key, topic))
                if data is None:
                    continue
                try:
                    whole = _checked(topic, time, data, largest, zipped=zipped)
                    new.write(topics[key], time, whole)
                    found += 1
                except RecordingError as err:
                    losses.add(str(err), messages=1)
    counted = bag.get('message_count')
    missing = max(losses.expected, counted if type(counted) is int else 0) - found - losses.messages
    if missing > 0:
        losses.add(f'{missing} more messages that it counts are missing', messages=missing)


def _checked(topic: Topic, time: int, data: bytes, largest: int, *, zipped: bool) -> bytes:
    """Give the bytes of a message, unpacked; refuse one that a bag cannot hold."""
    what = f'a message of {topic.name} at {time} ns'
    with refusing(RecordingError, what, 'readable'):  # a private type of the version of Python
        data = DECOMPRESSORS['zstd'](data, 0) if zipped else data
    if len(data) > largest:
        raise RecordingError(what, f'of at most {largest} bytes', len(data))
    return data


def _metadata(path: Path, losses: Losses) -> dict[str, Any]:
    """Read metadata.yaml as far as it can be read."""
    if not path.is_dir():
        return {}
    try:
        check_metadata(path)
        data = yaml.safe_load((path / 'metadata.yaml').read_text(encoding='utf-8'))
        bag = dict(data['rosbag2_bagfile_information'])
        texts_by_name(bag.get('custom_data') or {})
    except (RecordingError, yaml.YAMLError, OSError, LookupError, TypeError, ValueError) as err:
        losses.add(f'metadata.yaml: {quote_error(err)}')
        return {}
    if str(bag.get('compression_mode')).lower() == 'file':
        must_be = 'unpacked, as by `zstd -d`, before a part of it can be read'
        raise RecordingError(f'the files of {path}', must_be, 'compressed as a whole')
    return bag


def _files(path: Path, bag: Mapping[str, Any], losses: Losses) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    named = bag.get('relative_file_paths')
    names = [PurePath(str(name)).name for name in named] if isinstance(named, list) else []
    found = sorted(one.name for one in path.iterdir() if one.suffix in {'.mcap', '.db3'})
    for name in names or found:
        if (path / name).is_file():
            yield path / name
        else:
            losses.add(f'{name} is missing')


def _open(path: Path, folder: Path, largest: int, losses: Losses) -> Iterable[_Item]:
    """Give the topics and messages of a file as far as they can be read, a topic first."""
    match path.suffix:
        case '.bag':
            return _ros1_bag(path, largest, losses)
        case '.mcap':
            return _McapFile(path, largest, losses)
        case '.db3':
            return _database(_with_log(path, folder, losses), losses)
    must_be = 'a ROS 2 bag folder, .mcap, .db3 or a ROS 1 .bag'
    raise RecordingError('the recording', must_be, path)


def _ros1_bag(path: Path, largest: int, losses: Losses) -> Iterator[_Item]:
    """Read a ROS 1 bag whose index is complete."""
    with Recording(path, largest) as source:
        losses.expected += source.message_count
        for topic in source.topics:
            yield topic, 0, None
        try:
            yield from source.messages()
        except RecordingError as err:
            losses.add(f'{path.name}: {err}')


class _McapFile:
    """An MCAP file: every chunk whose checksum agrees, and every message outside of chunks."""

    def __init__(self, path: Path, largest: int, losses: Losses) -> None:
        self._path, self._largest, self._losses = path, largest, losses
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, Topic | None] = {}

    def __iter__(self) -> Iterator[_Item]:
        """Give its topics and messages, each topic before its messages."""
        indexed = 0  # messages in chunks, and others
        with self._path.open('rb') as stream:
            summary = Summary()
            with suppress(Exception):  # on damaged bytes, decoders raise anything
                summary = SeekingReader(stream).get_summary() or summary
            for described in (*summary.schemas.values(), *summary.channels.values()):
                yield from self._items(described)
            starts = sorted(one.chunk_start_offset for one in summary.chunk_indexes)
            for record in self._file_records(stream, starts):
                indexed += len(record.records) if isinstance(record, MessageIndex) else 0
                indexed += isinstance(record, Message)
                for one in self._unpacked(record) if isinstance(record, Chunk) else [record]:
                    yield from self._items(one)
        statistics = summary.statistics
        self._losses.expected += statistics.message_count if statistics else indexed

    def _lose(self, reason: str, *, chunks: int = 0) -> None:
        self._losses.add(f'{self._path.name}: {reason}', chunks=chunks)

    def _file_records(self, stream: BinaryIO, starts: list[int]) -> Iterator[McapRecord]:
        """Read the records of the file; behind damage, go on at the next chunk of the index."""
        begin: int | None = MAGIC_SIZE
        while begin is not None:
            stream.seek(begin)
            end = begin
            reader = StreamReader(
                stream, skip_magic=True, emit_chunks=True, record_size_limit=self._largest
            )
            try:
                for record in reader.records:
                    end = stream.tell()
                    yield record
                begin = None
            except Exception as err:  # noqa: BLE001  as above
                self._lose(f'no complete record at byte {end}, got {_words(err)}')
                begin = next((start for start in starts if start > end), None)

    def _unpacked(self, chunk: Chunk) -> list[McapRecord]:
        """Return the records of a chunk; none, if not all of it can be read."""
        try:
            return list(_records(chunk, self._largest))
        except Exception as err:  # noqa: BLE001  as above
            times = f'from {chunk.message_start_time} to {chunk.message_end_time} ns'
            self._lose(f'the chunk {times}: {_words(err)}', chunks=1)
            return []

    def _items(self, record: McapRecord) -> Iterator[_Item]:
        """Give the topic or the message that a record describes."""
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel) and record.id not in self._topics:
            self._topics[record.id] = topic = self._topic(record)
            if topic is not None:
                yield topic, 0, None
        elif isinstance(record, Message):
            topic = self._topics.get(record.channel_id)
            if topic is not None:
                yield topic, record.log_time, record.data
            elif record.channel_id not in self._topics:
                self._topics[record.channel_id] = None
                self._lose(f'the channel {record.channel_id} is not described')

    def _topic(self, channel: Channel) -> Topic | None:
        try:
            schema = self._schemas[channel.schema_id]
            definition = (schema.encoding, schema.data.decode(errors='replace'))
            qos = channel.metadata.get('offered_qos_profiles', '')
            encoding = channel.message_encoding
            return topic_of(channel.topic, schema.name, definition, encoding, qos)
        except Exception as err:  # noqa: BLE001  as above
            self._lose(f'the topic {channel.topic}: {quote_error(err)}')
            return None


def _records(chunk: Chunk, largest: int) -> Iterator[McapRecord]:
    """Unpack a chunk, and read its records up to its end."""
    if (size := max(chunk.uncompressed_size, len(chunk.data))) > largest:
        raise RecordingError('a chunk', f'of at most {largest} bytes', size)
    data, size = get_chunk_data_stream(chunk, validate_crc=True)
    if size != chunk.uncompressed_size:
        raise RecordingError('a chunk', f'of {chunk.uncompressed_size} bytes', size)
    stream, end = BytesIO(data.read(size)), 0
    try:
        for record in StreamReader(stream, skip_magic=True, record_size_limit=size).records:
            end = stream.tell()
            yield record
    except EndOfFile:
        if end != size:
            raise


def _words(err: Exception) -> str:
    """Quote an error; that of an end of file has no text."""
    return '"the end of its bytes"' if isinstance(err, EndOfFile) else quote_error(err)


def _database(path: Path, losses: Losses) -> Iterator[_Item]:
    """Read the rows of a database up to the first that SQLite cannot read.

    Recorders number messages from 1 and delete none: a gap in the numbers is a loss.
    """
    if wrong := damage_of(path):
        losses.add(f'{path.name}: {wrong}')
    last = 0
    try:
        with closing(connect(path)) as database:
            topics = _database_topics(path, database, losses)
            for topic in filter(None, topics.values()):
                yield topic, 0, None
            rows = database.execute(
                'SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id'
            )
            for row, number, time, data in rows:
                last, found = row, topics.get(number)
                if found is not None and isinstance(time, int) and isinstance(data, bytes):
                    yield found, time, data
                elif number not in topics:
                    topics[number] = None
                    losses.add(f'{path.name}: the topic {number} is not described')
    except (sqlite3.Error, OverflowError, UnicodeError) as err:
        losses.add(f'{path.name}: no row behind {last} can be read: {quote_error(err)}')
        with suppress(sqlite3.Error), closing(connect(path)) as database:
            (number,) = database.execute('SELECT max(id) FROM messages').fetchone()
            last = number if isinstance(number, int) else 0
    losses.expected += last


def _database_topics(
    path: Path, database: sqlite3.Connection, losses: Losses
) -> dict[int, Topic | None]:
    """Describe the topics, with the definitions of their types where the database has them."""
    database.row_factory = sqlite3.Row
    definitions = {}
    if database.execute('PRAGMA table_info(message_definitions)').fetchall():
        for row in database.execute('SELECT * FROM message_definitions'):
            described = (row['encoding'], row['encoded_message_definition'])
            definitions[row['topic_type']] = described
    topics: dict[int, Topic | None] = {}
    for found in database.execute('SELECT * FROM topics ORDER BY id'):
        row = dict(found)
        try:
            topics[row['id']] = topic_of(
                row['name'],
                row['type'],
                definitions.get(row['type'], ('', '')),
                row['serialization_format'],
                row.get('offered_qos_profiles', ''),
                row.get('type_description_hash', ''),
            )
        except Exception as err:  # noqa: BLE001  as above
            topics[row['id']] = None
            losses.add(f'{path.name}: the topic {row.get("name")}: {quote_error(err)}')
    return topics


def _with_log(path: Path, folder: Path, losses: Losses) -> Path:
    """Merge the log beside a database into a copy of it, by SQLite."""
    if not (logs := open_logs(path)):
        return path
    for file in (path, *logs):
        shutil.copyfile(file, folder / file.name)
    losses.add(f'{path.name}: it was not closed by its recorder, messages in {logs[0].name}')
    try:
        with closing(sqlite3.connect(folder / path.name)) as database:
            database.execute('PRAGMA wal_checkpoint(TRUNCATE)').fetchall()
            database.execute('SELECT count(*) FROM sqlite_master').fetchall()
    except sqlite3.DatabaseError as err:
        losses.add(f'{logs[0].name}: {quote_error(err)}')
    return folder / path.name
