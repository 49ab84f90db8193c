# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that lie: about their messages, their index and their size when they are unpacked."""

from __future__ import annotations

import shutil
import struct
import tempfile
import tracemalloc
from itertools import product
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.packed import unpack_file
from lidar_outlier_filter.recordings.salvage.mcap_records import walk

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def drive(recordings: Path, tmp_path: Path) -> Path:
    """Copy a real recording to where it may be changed."""
    return shutil.copytree(
        recordings / 'bags' / 'vlp16_mrpt_mcap', tmp_path / 'drive', copy_function=shutil.copyfile
    )


def read_all(path: Path) -> int:
    """Read a recording to its end."""
    with Recording(path) as recording:
        return sum(1 for _ in recording.messages())


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('message_count: 4', 'message_count: many'),
        ('message_count: 4', 'message_count: -4'),
        ('message_count: 4', 'message_count: [4]'),
        ('message_count: 4', 'message_count: &a [*a]'),
        ('message_count: 4', 'message_count: 4.5'),
        ('nanoseconds: ', 'nanoseconds: x'),
        ('version: ', 'version: x'),
        ('relative_file_paths:', 'relative_file_paths: 5\n  more:'),
        ('storage_identifier: mcap', 'storage_identifier: []'),
        ('name: ', 'name: []\n        other: '),
        ('type: ', 'type: 5\n        other: '),
        ('rosbag2_bagfile_information:', 'rosbag2_bagfile_information:\n  custom_data: [1]'),
        ('rosbag2_bagfile_information:', 'rosbag2_bagfile_information:\n  custom_data: {a: 1}'),
        ('rosbag2_bagfile_information:', 'other:'),
    ],
)
def test_metadata(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str
) -> None:
    """Metadata that cannot be true are refused in one sentence, and nothing is written."""
    path = drive / 'metadata.yaml'
    text = path.read_text()
    assert old in text
    path.write_text(text.replace('  custom_data: null\n', '').replace(old, new))
    assert main(['replay', str(drive)]) == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert ' must be ' in said
    assert 'Traceback' not in said
    assert [item.name for item in tmp_path.iterdir()] == ['drive']
    with pytest.raises(RecordingError):
        read_all(drive)


def test_metadata_that_grow_by_aliases(drive: Path) -> None:
    """Metadata of a kilobyte that stand for a billion values are refused before they are read."""
    bomb = 'a: &a [x, x]\n' + ''.join(
        f'{name}: &{name} [*{before}, *{before}]\n'
        for before, name in zip(
            'abcdefghijklmnopqrstuvwxy', 'bcdefghijklmnopqrstuvwxyz', strict=True
        )
    )
    path = drive / 'metadata.yaml'
    text = path.read_text().replace("compression_format: ''", 'compression_format: *z')
    path.write_text(bomb + text.replace("compression_mode: ''", 'compression_mode: file'))
    with pytest.raises(RecordingError, match='must be of at most 1000000 values'):
        read_all(drive)


# Chunks of an MCAP file ---------------------------------------------------------------------------


def write(
    path: Path,
    compression: CompressionType,
    messages: int = 20,
    size: int = 1000,
    *,
    statistics: bool = True,
) -> Path:
    """Write an MCAP file of ROS 2 with several messages in several chunks."""
    with path.open('wb') as stream:
        writer = Writer(
            stream, chunk_size=4 * size, compression=compression, use_statistics=statistics
        )
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/text', 'cdr', schema)
        for i in range(messages):
            writer.add_message(channel, i, bytes(size), i)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize('compression', list(CompressionType))
def test_chunks_are_read(tmp_path: Path, compression: CompressionType) -> None:
    """Chunks of any compression are read."""
    assert read_all(write(tmp_path / 'a.mcap', compression)) == 20


@pytest.mark.parametrize('compression', [CompressionType.ZSTD, CompressionType.LZ4])
def test_chunks_larger_than_allowed(tmp_path: Path, compression: CompressionType) -> None:
    """A chunk that unpacks to more than is allowed is refused before it is."""
    path = write(tmp_path / 'a.mcap', compression, 4, 10_000_000)
    assert path.stat().st_size < 1_000_000
    tracemalloc.start()
    with (
        pytest.raises(RecordingError, match=r'the chunk at byte \d+ of .* must be of at most 1000'),
        Recording(path, 1_000_000),
    ):
        pass
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2_000_000
    with Recording(path) as recording:
        assert sum(1 for _ in recording.messages()) == 4


@pytest.mark.parametrize('indexed', [True, False])
def test_chunks_that_unpack_to_more_than_they_say(tmp_path: Path, *, indexed: bool) -> None:
    """No byte more is unpacked than a chunk says, in its head and in the index."""
    path = write(tmp_path / 'a.mcap', CompressionType.ZSTD, 4, 50_000_000)
    data = path.read_bytes()
    size = struct.pack('<Q', walk(path, 10**10).chunks[0].uncompressed_size)
    assert data.count(size) == 2
    path.write_bytes(data.replace(size, struct.pack('<Q', 1000)) if indexed else data)
    tracemalloc.start()
    if indexed:
        with pytest.raises(RecordingError, match='must be of at most 1000 bytes, got more'):
            read_all(path)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    else:
        with pytest.raises(RecordingError, match='must be of at most 1000000 bytes'):
            sum(1 for _ in opened(path, 1_000_000))
    tracemalloc.stop()


def opened(path: Path, largest: int) -> Iterator[bytes]:
    """Read the messages of a recording that may be no longer than allowed."""
    with Recording(path, largest) as recording:
        yield from (data for _, _, data in recording.messages())


@pytest.mark.parametrize('compression', ['bz2', 'lz4'])
def test_chunks_of_ros1(tmp_path: Path, compression: str) -> None:
    """So are the chunks of a ROS 1 bag."""
    path = tmp_path / 'a.bag'
    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    types = get_typestore(Stores.ROS1_NOETIC)
    with writer:
        connection = writer.add_connection('/text', 'std_msgs/msg/String', typestore=types)
        message = types.types['std_msgs/msg/String']('x' * 5_000_000)
        data = types.serialize_ros1(message, 'std_msgs/msg/String')
        writer.write(connection, 1, data)
    assert path.stat().st_size < 100_000
    assert [len(data) for data in opened(path, 6_000_000)] == [5_000_009]
    with pytest.raises(RecordingError, match='must be of at most 1000000 bytes, got more'):
        list(opened(path, 1_000_000))


@pytest.mark.parametrize('most', [20_000_000, 1_000_000])
def test_messages_that_are_compressed_themselves(tmp_path: Path, most: int) -> None:
    """A bag may be compressed message by message: no message unpacks to more than is allowed."""
    bag = tmp_path / 'bag'
    writer = Writer2(bag, version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        types = get_typestore(Stores.ROS2_JAZZY)
        connection = writer.add_connection('/text', 'std_msgs/msg/String', typestore=types)
        writer.write(connection, 1, bytes(10_000_000))
    if most > 10_000_000:
        assert [len(data) for data in opened(bag, most)] == [10_000_000]
        return
    with pytest.raises(RecordingError, match='must be of at most 1000000 bytes, got more'):
        list(opened(bag, most))


@pytest.fixture
def packed(tmp_path: Path) -> Path:
    """Write a bag whose file is compressed as a whole: ten messages, each a megabyte of zeros."""
    bag = tmp_path / 'bag'
    writer = Writer2(bag, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        types = get_typestore(Stores.ROS2_JAZZY)
        connection = writer.add_connection('/text', 'std_msgs/msg/String', typestore=types)
        for time in range(10):
            writer.write(connection, time, bytes(1_000_000))
    return bag


def test_files_that_are_compressed_as_a_whole(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such a file unpacks to a folder of its own, which goes, and to no more than is allowed."""
    folder = tmp_path / 'temporary'
    folder.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(folder))
    (file,) = packed.glob('*.zstd')
    assert file.stat().st_size < 20_000
    assert [len(data) for data in opened(packed, 20_000_000)] == [1_000_000] * 10
    with pytest.raises(RecordingError, match='got "more than 100 times its size when'):
        list(opened(packed, 3_000_000))
    assert list(folder.iterdir()) == []
    assert 'more than 100' in unpack_file(file, folder / 'part', 3_000_000)
    assert 1_000_000 < (folder / 'part').stat().st_size <= 3_000_000


@pytest.mark.parametrize('cut', [0.0, 0.5, 0.99])
def test_compressed_files_that_were_cut_off(packed: Path, cut: float) -> None:
    """Where such a file ends within a frame, the bag is refused, in one sentence."""
    (file,) = packed.glob('*.zstd')
    data = file.read_bytes()
    file.write_bytes(data[: int(cut * len(data))])
    with pytest.raises(RecordingError, match='must be readable, got "its end within a frame"'):
        list(opened(packed, 20_000_000))
    file.write_bytes(b'no frame' + data)
    with pytest.raises(RecordingError, match=f'the file {file} must be readable, got "[^"\n]+"$'):
        list(opened(packed, 20_000_000))


@pytest.mark.parametrize('options', list(product([True, False], repeat=4)))
@pytest.mark.parametrize('compression', list(CompressionType))
def test_index(tmp_path: Path, options: tuple[bool, ...], compression: CompressionType) -> None:
    """Whatever of the index a file lacks, its messages are all found."""
    use = dict(zip(('use_chunking', 'use_statistics', 'repeat_channels'), options, strict=False))
    kinds = IndexType.ALL if options[3] else IndexType.NONE
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=4000, compression=compression, index_types=kinds, **use)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/text', 'cdr', schema)
        for i in range(20):
            writer.add_message(channel, i, bytes(1000), i)
        writer.finish()  # type: ignore[no-untyped-call]
    assert read_all(path) == 20


@pytest.mark.parametrize('statistics', [False, True])
@pytest.mark.parametrize('lost', ['chunk', 'messages'])
def test_index_that_lacks_a_part(tmp_path: Path, lost: str, *, statistics: bool) -> None:
    """A chunk that the index does not name, or whose messages it does not name, is read."""
    path = write(tmp_path / 'a.mcap', CompressionType.NONE, statistics=statistics)
    data = bytearray(path.read_bytes())
    (begin,) = struct.unpack('<Q', data[-28:-20])
    offset = begin
    while data[offset] != 8:  # the first record that indexes a chunk
        offset += 9 + struct.unpack('<Q', data[offset + 1 : offset + 9])[0]
    if lost == 'chunk':
        data[offset] = 0x80  # a kind of one's own
    else:
        (length,) = struct.unpack('<I', data[offset + 41 : offset + 45])
        data[offset + 45 : offset + 45 + length] = bytes(length)
        data[offset + 45 + length : offset + 53 + length] = bytes(8)
    path.write_bytes(data)
    assert read_all(path) == 20


@pytest.mark.parametrize('seed', range(20))
def test_lying_lengths(tmp_path: Path, seed: int) -> None:
    """A file in which eight bytes are another number is read to its end, or refused, soon."""
    rng = np.random.default_rng(seed)
    path = write(tmp_path / 'a.mcap', CompressionType.ZSTD)
    whole = path.read_bytes()
    for _ in range(30):
        offset = int(rng.integers(8, len(whole) - 8))
        wrong = struct.pack('<Q', int(rng.choice([0, 2**16, 2**31, 2**40, 2**63])))
        path.write_bytes(whole[:offset] + wrong + whole[offset + 8 :])
        begin = perf_counter()
        try:
            read_all(path)
        except RecordingError as err:
            assert '\n' not in str(err)  # noqa: PT017  either is right
        assert perf_counter() - begin < 2


@pytest.mark.parametrize('lost', [1, 2, 5, 10, 4096])
def test_database_that_was_cut_off(recordings: Path, tmp_path: Path, lost: int) -> None:
    """A database that lost its last bytes is refused, where SQLite reads it without a word."""
    source = next((recordings / 'bags' / 'vlp16_mrpt_db3').glob('*.db3'))
    path = tmp_path / 'a.db3'
    path.write_bytes(source.read_bytes()[:-lost])
    with pytest.raises(RecordingError, match=r'must be readable, got "\d+ bytes instead of \d+'):
        read_all(path)
