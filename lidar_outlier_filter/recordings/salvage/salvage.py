# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A damaged recording: all that can be read of it, copied into a new one that is whole."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing, contextmanager, suppress
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import yaml

from lidar_outlier_filter.disk.new_files import FOLDER, check_new, hidden_folder
from lidar_outlier_filter.errors import RecordingError, said_by
from lidar_outlier_filter.recordings.bags import LATEST, NewBag, writable
from lidar_outlier_filter.recordings.channels import ros1_channels, ros2_channels
from lidar_outlier_filter.recordings.packed import is_packed, unpack_file
from lidar_outlier_filter.recordings.salvage.losses import Losses
from lidar_outlier_filter.recordings.salvage.mcap import DamagedMcap
from lidar_outlier_filter.recordings.salvage.ros1 import DamagedBag
from lidar_outlier_filter.recordings.salvage.sqlite import DamagedDatabase
from lidar_outlier_filter.recordings.storage import read_metadata, texts_by_name
from lidar_outlier_filter.recordings.unpack import unpack

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosbags.interfaces import Connection

    from lidar_outlier_filter.recordings.channels import Channels, Topic

_SUFFIXES = ('.mcap', '.db3')
_LOGS = ('-wal', '-journal')  # of SQLite, beside a database

_DamagedFile = DamagedMcap | DamagedDatabase | DamagedBag


@contextmanager
def salvaged(path: Path, output: Path, largest: int) -> Iterator[tuple[Path, Losses]]:
    """Give a copy, in a hidden folder beside ``output``, of what can be read, and what is lost.

    Raises
    ------
    RecordingError
        If there is no recording, or the copy cannot be written.

    """
    if not path.exists():
        raise RecordingError('the recording', 'an existing file or folder', path)
    check_new(output, FOLDER)
    losses = Losses()
    with writable(output), hidden_folder(output) as folder:
        copy = folder / 'salvaged'
        _copy(path, folder, copy, largest, losses)
        yield copy, losses


def _copy(path: Path, folder: Path, copy: Path, largest: int, losses: Losses) -> None:
    """Write all that can be read into a new bag."""
    bag = _metadata(path, losses)
    types = _types(bag)
    by_message = str(bag.get('compression_mode')).lower() == 'message'
    topics: dict[tuple[str, str], Topic] = {}
    expected = found = 0
    with NewBag(copy, _custom(path, bag, losses)) as new:
        for file in _files(path, bag, folder, largest, losses):
            damaged = _open(file, largest, losses, types)
            expected += damaged.expected
            channels = _channels(damaged, losses)
            for topic, _ in channels.values():
                if (topic.name, topic.msgtype) not in topics:
                    new.add(topics.setdefault((topic.name, topic.msgtype), topic))
            for number, time, data in damaged.messages():
                if number not in channels:  # counted already
                    continue
                topic, to_cdr = channels[number]
                if not 0 <= time <= LATEST:
                    losses.add(f'a message of {topic.name} has the time {time} ns', messages=1)
                    continue
                try:
                    plain = unpack(data, largest, compression='zstd') if by_message else data
                    cdr = to_cdr(plain)
                except Exception as err:  # noqa: BLE001  on damaged bytes, decoders raise anything
                    what = f'a message of {topic.name} at {time} ns'
                    losses.add(f'{what}: {said_by(err)}', messages=1)
                    continue
                new.write(topics[topic.name, topic.msgtype], time, cdr)
                found += 1
    said = bag.get('message_count')
    expected = said if type(said) is int else expected
    if expected - found > losses.messages:
        missing = expected - found - losses.messages
        losses.add(f'{missing} more messages that it counts are not there', messages=missing)


def _metadata(path: Path, losses: Losses) -> dict[str, Any]:
    """Read metadata.yaml as far as it can be read."""
    if not path.is_dir():
        return {}
    try:
        bag = read_metadata(path)
    except (RecordingError, yaml.YAMLError, OSError, ValueError) as err:
        losses.add(f'metadata.yaml: {said_by(err)}')
        return {}
    if not bag:
        losses.add('metadata.yaml is missing, or empty')
    return bag


def _types(bag: Mapping[str, Any]) -> dict[str, str]:
    """Take the types of topics from metadata."""
    types: dict[str, str] = {}
    with suppress(KeyError, TypeError, AttributeError):
        for item in bag['topics_with_message_count']:
            name, msgtype = item['topic_metadata']['name'], item['topic_metadata']['type']
            if isinstance(name, str) and isinstance(msgtype, str):
                types[name] = msgtype
    return types


def _custom(path: Path, bag: Mapping[str, Any], losses: Losses) -> Mapping[str, str]:
    try:
        return texts_by_name(path, bag.get('custom_data') or {})
    except RecordingError as err:
        losses.add(str(err))
        return {}


def _files(
    path: Path, bag: dict[str, Any], folder: Path, largest: int, losses: Losses
) -> Iterator[Path]:
    """Find the files of a recording, in their order, ready to be read."""
    if not path.is_dir():
        yield _settled(path, folder, losses)
        return
    names = [PurePath(name).name for name in _texts(bag.get('relative_file_paths'))]
    found = sorted(file.name for file in path.iterdir() if _is_storage(file))
    for name in names or found:
        file = path / name
        if not file.is_file():
            losses.add(f'{name} is missing')
        elif is_packed(bag) or file.suffix == '.zstd':
            target = folder / file.stem
            if wrong := unpack_file(file, target, largest):
                losses.add(f'{name}: {wrong}')
            yield target
            target.unlink()
        else:
            yield _settled(file, folder, losses)


def _texts(value: object) -> list[str]:
    """Take the texts of a list; of anything else there are none."""
    return [item for item in value if isinstance(item, str)] if isinstance(value, list) else []


def _is_storage(file: Path) -> bool:
    inner = Path(file.stem) if file.suffix == '.zstd' else file
    return inner.suffix in _SUFFIXES and file.is_file()


def _settled(path: Path, folder: Path, losses: Losses) -> Path:
    """Let SQLite put what is in the log beside a database into a copy of it."""
    logs = [path.with_name(path.name + suffix) for suffix in _LOGS]
    logs = [log for log in logs if log.is_file() and log.stat().st_size]
    if path.suffix != '.db3' or not logs:
        return path
    for file in (path, *logs):
        shutil.copyfile(file, folder / file.name)
    losses.add(f'{path.name}: it was not closed by its recorder, messages in {logs[0].name}')
    copy = folder / path.name
    try:
        with closing(sqlite3.connect(copy)) as database:
            database.execute('PRAGMA wal_checkpoint(TRUNCATE)').fetchall()
            database.execute('SELECT count(*) FROM sqlite_master').fetchall()
    except sqlite3.DatabaseError as err:
        losses.add(f'{logs[0].name}: {said_by(err)}')
    return copy


def _open(path: Path, largest: int, losses: Losses, types: Mapping[str, str]) -> _DamagedFile:
    if path.suffix == '.bag':
        return DamagedBag(path, largest, losses)
    if path.suffix == '.db3':
        return DamagedDatabase(path, largest, losses)
    if path.suffix == '.mcap':
        return DamagedMcap(path, largest, losses, types)
    must_be = 'a ROS 2 bag folder, .mcap, .db3 or a ROS 1 .bag'
    raise RecordingError('the recording', must_be, path)


def _channels(file: _DamagedFile, losses: Losses) -> Channels:
    """Find the topics of those connections that can be understood; those of others are lost."""
    make = ros1_channels if isinstance(file, DamagedBag) else ros2_channels
    good: list[Connection] = []
    digests: dict[str, str] = {}
    for connection in file.connections:
        try:
            make([connection])
            if isinstance(file, DamagedBag) and connection.digest != digests.setdefault(
                connection.msgtype, connection.digest
            ):
                _refuse_second(connection)
        except Exception as err:  # noqa: BLE001  on damaged bytes, decoders raise anything
            lost = connection.msgcount
            losses.add(f'{connection.topic}: {said_by(err)}', messages=lost)
        else:
            good.append(connection)
    return make(good)


def _refuse_second(connection: Connection) -> None:
    what = f'the definition of {connection.msgtype}'
    raise RecordingError(what, 'the same on all topics', connection.digest)
