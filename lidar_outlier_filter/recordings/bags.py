# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Read a recording in the form of ROS 2; write a new bag that appears complete or not at all.

How it was made is in ``custom_data`` of its metadata: versions, seeds and parameters.
"""

import json
import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Self

import yaml
from mcap.reader import SeekingReader
from rosbags.interfaces import Connection, QosDurability, QosLiveliness, QosTime
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapReader

from lidar_outlier_filter import __version__
from lidar_outlier_filter.disk.new_files import FOLDER, new_files
from lidar_outlier_filter.disk.sqlite_pages import damage_of, open_logs
from lidar_outlier_filter.errors import RecordingError, quote_error, refusing
from lidar_outlier_filter.parameters.declaration import shown
from lidar_outlier_filter.parameters.filter import WITHOUT_EFFECT, FilterParameters
from lidar_outlier_filter.recordings.channels import LATCHED, Topic, ros1_channels, ros2_channels
from lidar_outlier_filter.recordings.remote_path import RecordingPath

__all__ = ['LATCHED', 'RELIABLE', 'NewBag', 'Recording', 'Topic', 'history', 'made_by']

MAX_MESSAGE_BYTES = 256_000_000  # bytes of a message, or of a chunk of messages, uncompressed
MAX_EXPANDED = 10_000_000  # characters of a metadata.yaml with aliases, once they are expanded
MAX_BAG_TIME_NS = 2**63 - 1  # bag time, nanoseconds
# Of the keys of custom data that say how a recording was made; the name of the command follows.
PREFIX = 'lidar_outlier_filter.'
# The profile of a ROS 2 publisher that keeps ten messages; 0: the default of the middleware.
RELIABLE = LATCHED._replace(
    depth=10,
    durability=QosDurability.VOLATILE,
    liveliness=QosLiveliness.SYSTEM_DEFAULT,
    deadline=QosTime(0, 0),
    lifespan=QosTime(0, 0),
    liveliness_lease_duration=QosTime(0, 0),
)


class Recording:
    """A recording to read: a ROS 2 bag folder, a single ``.mcap`` or ``.db3``, or a ROS 1 ``.bag``.

    A context manager. Publishers that share a topic and a type are one topic here. On a store,
    files are read by ranges.

    Parameters
    ----------
    path : of the recording
    largest : bytes; larger messages, and chunks that are larger by their index, are refused

    Attributes
    ----------
    topics : all topics, including those without a message
    start, duration : first bag time and length, ns
    message_count : messages that the index of the recording counts
    custom_data : of its ``metadata.yaml``

    """

    def __init__(self, path: RecordingPath, largest: int = MAX_MESSAGE_BYTES) -> None:
        """Name the recording; it is opened on entering."""
        self.path = path
        self._largest = largest
        self.topics: tuple[Topic, ...] = ()
        self.start = self.duration = 0
        self.message_count = 0
        self.custom_data: Mapping[str, str] = {}

    def __enter__(self) -> Self:
        """Open the recording and read which topics it has."""
        with ExitStack() as stack, _readable(self.path):
            check_regular(self.path)
            _check_databases(self.path)
            reader: Reader1 | Reader2
            if self.path.suffix == '.bag' and not self.path.is_dir():
                reader = _ros1_reader(self.path, stack)
                self._channels = ros1_channels(reader.connections)
                self.message_count = reader.message_count
            else:
                check_metadata(self.path)
                reader = stack.enter_context(Reader2(self.path))
                _check_index(reader, self._largest)
                self.message_count = sum(one.msgcount for one in reader.connections)
                _connect_as_stored(reader)
                self._channels = ros2_channels(reader.connections)
                self.custom_data = texts_by_name(reader.storage.metadata.custom or {})
            self._reader = reader
            self.topics = tuple(dict.fromkeys(topic for topic, _ in self._channels.values()))
            self.start, self.duration = reader.start_time, reader.duration
            for number in (self.start, self.duration, self.message_count):
                if type(number) is not int or number < 0:
                    what = f'times and counts of {self.path}'
                    raise RecordingError(what, 'whole numbers', f'"{shown(number)}"')
            self._close = stack.pop_all()
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the recording."""
        self._close.close()

    def messages(
        self,
        topics: Collection[Topic] | None = None,
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Topic, int, bytes]]:
        """Read topic, bag time (ns) and CDR bytes of every message, in the order of bag times.

        Messages with the same bag time come in the order in which they were recorded.

        Parameters
        ----------
        topics : read only these; None: all
        start, stop : bag times, ns, the first that is read and the first that is not

        """
        with _readable(self.path):
            connections = [
                connection
                for connection in self._reader.connections
                if topics is None or self._channels[connection.id][0] in topics
            ]
            if not connections:  # readers would return all messages
                return
            for connection, time, data in self._reader.messages(connections, start, stop):
                topic, to_cdr = self._channels[connection.id]
                if len(data) > self._largest:
                    must_be = f'of at most {self._largest} bytes'
                    raise RecordingError(f'a message of {topic.name}', must_be, len(data))
                yield topic, time, to_cdr(data)


def _ros1_reader(path: RecordingPath, stack: ExitStack) -> Reader1:
    """Open a ROS 1 bag; name the tool that repairs its index."""
    try:
        return stack.enter_context(Reader1(path))
    except (Reader1Error, AssertionError) as err:
        got = f'{quote_error(err)}; `rosbag reindex` restores a bag that was cut off'
        refusal = RecordingError(f'the recording {path}', 'readable', got)
        refusal.is_damage = False
        raise refusal from err


def check_regular(path: RecordingPath) -> None:
    """Refuse pipes, sockets and devices, as the recording or in its folder: reading may block."""
    for file in [path, *(path.iterdir() if path.is_dir() else [])]:
        if isinstance(file, Path) and file.exists() and not (file.is_file() or file.is_dir()):
            raise RecordingError(f'{file}', 'a regular file or a folder', 'another kind of file')


def _check_databases(path: RecordingPath) -> None:
    """Refuse databases that lost pages, or that their recorder did not close."""
    for file in path.glob('*.db3') if path.is_dir() else [path]:
        if file.suffix != '.db3' or not file.is_file():
            continue
        if not isinstance(file, Path):
            raise RecordingError(f'the database {file}', 'copied to this machine', 'a store')
        for log in open_logs(file):
            what, got = f'the recording {path}', f'messages in {log.name}'
            raise RecordingError(what, 'closed by its recorder', got)
        if wrong := damage_of(file):
            raise RecordingError(f'the recording {path}', 'readable', f'"{wrong}"')


def check_metadata(path: RecordingPath) -> None:
    """Refuse a ``metadata.yaml`` whose aliases expand to more than memory holds, or without end."""
    file = path / 'metadata.yaml'
    if not (path.is_dir() and file.is_file()):
        return
    text = file.read_text(encoding='utf-8')
    if '*' in text and _expanded(text) > MAX_EXPANDED:
        got = 'more once its aliases are expanded'
        raise RecordingError(f'{file}', f'of at most {MAX_EXPANDED} characters', got)


def _expanded(text: str) -> float:
    """Count characters and nodes of YAML, each alias expanded; inf: one is within itself."""
    sizes: dict[str | None, float] = {}
    open_nodes: list[tuple[str | None, float]] = [(None, 0.0)]
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            sizes[event.anchor] = math.inf
            open_nodes.append((event.anchor, 1.0))
            continue
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, size = open_nodes.pop()
        elif isinstance(event, yaml.ScalarEvent):
            anchor, size = event.anchor, 1.0 + len(event.value)
        elif isinstance(event, yaml.AliasEvent):
            anchor, size = None, sizes.get(event.anchor, 0.0)
        else:
            continue
        sizes[anchor] = size
        outer, before = open_nodes[-1]
        open_nodes[-1] = (outer, before + size)
    return open_nodes[0][1]


def texts_by_name(data: object) -> dict[str, str]:
    """Refuse custom data that are not strings by name."""
    if isinstance(data, dict) and all(
        isinstance(one, str) for item in data.items() for one in item
    ):
        return data
    raise RecordingError('custom_data in metadata.yaml', 'strings by name', f'"{shown(data)}"')


def _check_index(reader: Reader2, largest: int) -> None:
    """Refuse a bag of which rosbags would silently skip messages.

    rosbags reads the chunks and channels that the index of an MCAP file names, and the topics that
    ``metadata.yaml`` does. A file without an index is read from its beginning to its end.
    """
    topics = {(one.topic, one.msgtype) for one in reader.connections}
    storage: Any = reader.storage
    for part in getattr(storage, 'storages', [storage]):
        for one in part.connections:
            if one.msgcount and (one.topic, one.msgtype) not in topics:
                raise RecordingError(f'metadata.yaml of {reader.path}', f'with {one.topic}', 'none')
        if not isinstance(part, McapReader):
            continue
        size = max((chunk.uncompressed_size for chunk in part.chunks), default=0)
        if size > largest:
            raise RecordingError(f'a chunk of {part.path}', f'of at most {largest} bytes', size)
        if not _is_complete(part):
            must_be = 'with an index that names all of its messages'
            raise RecordingError(f'{part.path}', must_be, 'one that does not')


def _connect_as_stored(reader: Reader2) -> None:
    """Describe the connections of a bag folder as its files do, and by ``metadata.yaml`` the rest.

    rosbags silently skips the messages of connections whose QoS or hash these say differently.
    """
    storage: Any = reader.storage
    if not hasattr(storage, 'storages'):
        return
    found: list[Connection] = []
    for said in storage.connections:
        stored = [
            said._replace(digest=one.digest or said.digest, ext=one.ext)
            for part in storage.storages
            for one in part.connections
            if (one.topic, one.msgtype) == (said.topic, said.msgtype)
        ]
        if not any(one.ext.offered_qos_profiles for one in stored):
            stored.append(said)
        found += [one for number, one in enumerate(stored) if one not in stored[:number]]
    storage.connections[:] = [one._replace(id=number) for number, one in enumerate(found, 1)]


def _is_complete(part: McapReader) -> bool:
    """Compare what the index of an MCAP file names with what its statistics count."""
    with part.path.open('rb') as stream:
        summary = SeekingReader(stream).get_summary()
    counts = None if summary is None else summary.statistics
    if counts is None:
        return not part.chunks
    if part.chunks:
        indexed = sum(sum(chunk.channel_count.values()) for chunk in part.chunks)
        if (counts.chunk_count, counts.message_count) != (len(part.chunks), indexed):
            return False
    return counts.channel_message_counts.keys() <= {one.id for one in part.connections}


class NewBag:
    """An MCAP bag folder to write: it appears whole under its name, or not at all.

    A context manager. Until it is left without an error, all is in a hidden folder beside ``path``;
    no error, no Ctrl-C and no full disk leaves anything behind. Only one chunk (1 MiB, or a single
    message that is longer) is held in memory.
    """

    def __init__(self, path: Path, custom_data: Mapping[str, str] | None = None) -> None:
        self.path = path
        self._custom_data = custom_data or {}

    def __enter__(self) -> Self:
        """Begin the bag in its hidden folder."""
        with ExitStack() as stack:
            # In the hidden folder it has its final name already: its files are named after it.
            (built,) = stack.enter_context(new_files([self.path], FOLDER))
            writer = Writer(built, version=9, storage_plugin=StoragePlugin.MCAP)
            for key, value in self._custom_data.items():
                writer.set_custom_data(key, value)
            self._writer = stack.enter_context(writer)
            self._connections: dict[Topic, Connection] = {}
            self._finish = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        """Finish the bag and give it its name, or remove it if there was an error."""
        self._finish.__exit__(*error)  # type: ignore[arg-type]

    def add(self, topic: Topic) -> None:
        """Add a topic; it is in the bag even if no message follows."""
        connection = self._writer.add_connection(
            topic.name,
            topic.msgtype,
            msgdef=topic.definition,
            rihs01=topic.digest or 'unknown',
            offered_qos_profiles=topic.qos,
        )
        if not topic.digest:
            # The writer demands a hash, readers that it be true: an unknown one must be empty.
            connection = connection._replace(digest='')
            self._writer.connections[-1] = connection
        self._connections[topic] = connection

    def write(self, topic: Topic, time: int, data: bytes | memoryview) -> None:
        """Write the CDR bytes of one message of an added topic at its bag time (ns)."""
        if not 0 <= time <= MAX_BAG_TIME_NS:
            must_be = f'from 0 to {MAX_BAG_TIME_NS} ns'
            raise RecordingError(f'the bag time of a message of {topic.name}', must_be, time)
        self._writer.write(self._connections[topic], time, data)


@contextmanager
def _readable(path: RecordingPath) -> Iterator[None]:
    """Turn any error of a reader into a refusal in one sentence."""
    try:
        with refusing(RecordingError, f'the recording {path}', 'readable'):
            yield
    except RecordingError as err:
        vars(err).setdefault('is_damage', True)
        raise


def made_by(
    command: str, parameters: FilterParameters | None = None, **said: Any
) -> dict[str, str]:
    """Write the entry of a command: this version, what it was given, and changed parameters."""
    entry: dict[str, Any] = {'version': __version__, **said}
    if parameters is not None:
        default = FilterParameters().flat()
        given = parameters.flat().items()
        entry['parameters'] = {
            name: value
            for name, value in given
            if value != default[name] and name not in WITHOUT_EFFECT
        }
    return {PREFIX + command: json.dumps(entry)}


def history(custom_data: Mapping[str, str]) -> dict[str, Any]:
    """Return the entries that commands of this package have left, by command."""
    found: dict[str, Any] = {}
    for key, text in custom_data.items():
        if key.startswith(PREFIX):
            try:
                found[key.removeprefix(PREFIX)] = json.loads(text)
            except (ValueError, RecursionError):  # written by somebody else
                found[key.removeprefix(PREFIX)] = text
    return found
