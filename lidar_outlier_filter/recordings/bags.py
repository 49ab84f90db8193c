# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: all of one, in the form of ROS 2, and a new one that appears whole or not at all."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import StoragePlugin, Writer

from lidar_outlier_filter.disk.new_files import FOLDER, check_new, hidden_folder, publish
from lidar_outlier_filter.errors import FilterError, RecordingError, said_by
from lidar_outlier_filter.recordings.channels import LATCHED, Topic, ros1_channels, ros2_channels
from lidar_outlier_filter.recordings.packed import unpacked
from lidar_outlier_filter.recordings.storage import (
    bound,
    check_storage,
    texts_by_name,
    whole_number,
)
from lidar_outlier_filter.recordings.unpack import LARGEST

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from rosbags.interfaces import Connection

    from lidar_outlier_filter.recordings.remote_path import RecordingPath

__all__ = ['LATCHED', 'RELIABLE', 'NewBag', 'Recording', 'Topic']

LATEST = 2**63 - 1  # bag time, nanoseconds
# What a publisher of ROS 2 offers that keeps ten messages; 0: the middleware's own default.
RELIABLE = Qos(
    QosHistory.KEEP_LAST,
    10,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.SYSTEM_DEFAULT,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)


class Recording:
    """A recording to read: a ROS 2 bag folder, a lone ``.mcap`` or ``.db3``, or a ROS 1 ``.bag``.

    A context manager; inside it, ``topics`` are all topics (those without a message too), ``start``
    is the first bag time and ``duration`` the length, both in nanoseconds, and ``message_count`` is
    what the recording's own index says.
    Publishers that share a topic and a type are one topic here.

    Raises
    ------
    RecordingError
        If there is no recording, or a damaged one; also while its messages are read.

    """

    def __init__(self, path: RecordingPath, largest: int = LARGEST) -> None:
        """Name the recording; it is opened on entering. One on a store is read by ranges.

        A chunk of messages or a message that has more than ``largest`` bytes is refused.
        """
        self.path = path
        self._largest = largest
        self.topics: tuple[Topic, ...] = ()
        self.start = self.duration = 0
        self.message_count = 0
        self.custom_data: Mapping[str, str] = {}

    def __enter__(self) -> Self:
        """Open the recording and read what it says of its topics."""
        with ExitStack() as stack, _readable(self.path):
            _check_finished(self.path)
            path = stack.enter_context(unpacked(self.path, self._largest))
            walks = check_storage(path, self._largest)
            is_ros1 = path.suffix == '.bag' and not path.is_dir()
            self._reader: Reader1 | Reader2 = Reader1(path) if is_ros1 else Reader2(path)
            stack.enter_context(self._reader)
            self._unpack = bound(self._reader, walks, self._largest)
            connections = self._reader.connections
            self._channels = ros1_channels(connections) if is_ros1 else ros2_channels(connections)
            self.topics = tuple(dict.fromkeys(topic for topic, _ in self._channels.values()))
            self.duration = whole_number(self.path, 'the duration', self._reader.duration)
            self.start = self._reader.start_time
            self.message_count = sum(
                whole_number(
                    self.path, f'the message_count of {connection.topic}', connection.msgcount
                )
                for connection in connections
            )
            if isinstance(self._reader, Reader2):
                self.custom_data = texts_by_name(
                    self.path, self._reader.storage.metadata.custom or {}
                )
            self._close = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the recording."""
        self._close.close()

    def messages(
        self,
        topics: Collection[Topic] | None = None,
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Topic, int, bytes]]:
        """Read topic, bag time (ns) and CDR bytes of every message, in the order of the bag times.

        Messages with the same bag time come in the order in which they were recorded.

        Parameters
        ----------
        topics : read these only; None: all
        start, stop : bag times, ns, the first that is read and the first that is not

        """
        with _readable(self.path):
            wanted = [
                connection
                for connection in self._reader.connections
                if topics is None or self._channels[connection.id][0] in topics
            ]
            if not wanted:  # which readers take for all
                return
            for connection, time, packed in self._reader.messages(wanted, start, stop):
                topic, to_cdr = self._channels[connection.id]
                data = self._unpack(packed)
                if len(data) > self._largest:
                    what, must_be = (
                        f'a message of {topic.name}',
                        f'of at most {self._largest} bytes',
                    )
                    raise RecordingError(what, must_be, len(data))
                yield topic, time, to_cdr(data)


class NewBag:
    """An MCAP bag folder to write: it appears whole under its name, or not at all.

    A context manager. Until it is left without an error, all is in a hidden folder beside ``path``;
    no error, no Ctrl-C and no full disk leaves anything behind. Only one chunk (1 MiB, or a single
    message that is longer) is held in memory. Inside it, ``folder`` is the hidden folder.

    Raises
    ------
    RecordingError
        If ``path`` exists, or if it cannot be written.

    """

    def __init__(self, path: Path, custom_data: Mapping[str, str] | None = None) -> None:
        """Name the folder, and what its ``metadata.yaml`` shall carry under ``custom_data``."""
        self.path = path
        self._custom_data = custom_data or {}

    def __enter__(self) -> Self:
        """Begin the bag in its hidden folder."""
        check_new(self.path, FOLDER)
        with ExitStack() as stack, writable(self.path):
            self.folder = stack.enter_context(hidden_folder(self.path))
            # In the hidden folder it has its final name already: its files are named after it.
            self._built = self.folder / self.path.name
            stack.push(self._publish)
            writer = Writer(self._built, version=9, storage_plugin=StoragePlugin.MCAP)
            for key, value in self._custom_data.items():
                writer.set_custom_data(key, value)
            self._writer = stack.enter_context(writer)
            self._connections: dict[Topic, Connection] = {}
            self._finish = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the bag and give it its name, or remove it if there was an error."""
        with writable(self.path):
            self._finish.__exit__(kind, error, trace)

    def _publish(
        self,
        kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        if kind is None:
            publish(self._built, self.path)

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
        if not 0 <= time <= LATEST:
            must_be = f'from 0 to {LATEST} ns'
            raise RecordingError(f'the bag time of a message of {topic.name}', must_be, time)
        with writable(self.path):
            self._writer.write(self._connections[topic], time, data)


@contextmanager
def _readable(path: RecordingPath) -> Iterator[None]:
    """Refuse, in one sentence, whatever a recording that is none makes the readers raise."""
    try:
        try:
            yield
        except FilterError:
            raise
        except Exception as err:  # on damaged files, the decoders raise whatever they come upon
            raise RecordingError(f'the recording {path}', 'readable', said_by(err)) from err
    except RecordingError as err:
        err.is_damage = True
        raise


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Refuse, in one sentence, what cannot be written: a full disk, a folder without permission."""
    try:
        yield
    except OSError as err:
        reason = _quoted(err.strerror or repr(err))
        raise RecordingError(f'the output {path}', 'written in full', reason) from err


def _quoted(text: str) -> str:
    """Put a foreign text, on one line, into quotes."""
    return '"' + ' '.join(text.split()) + '"'


def _check_finished(path: RecordingPath) -> None:
    """Refuse a database that its recorder did not close: messages are in the log beside it."""
    beside: list[RecordingPath] = [path.with_name(path.name + '-wal')]
    for log in path.glob('*.db3-wal') if path.is_dir() else beside:
        if log.is_file() and log.stat().st_size:
            raise RecordingError(
                f'the recording {path}', 'closed by its recorder', f'messages in {log.name}'
            )
