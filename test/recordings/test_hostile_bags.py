# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that lie about their messages, their index and their size; files that are pipes."""

import os
import re
import shutil
import struct
import tracemalloc
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.writer import CompressionType, IndexType, Writer

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.salvage import salvaged


@pytest.fixture
def drive(recordings: Path, tmp_path: Path) -> Path:
    """Copy a real recording to where it may be changed."""
    return shutil.copytree(
        recordings / 'bags' / 'vlp16_mrpt_mcap', tmp_path / 'drive', copy_function=shutil.copyfile
    )


BOMB = 'a0: &a0 [lol]\n' + ''.join(
    f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]\n' for i in range(1, 10)
)


def read_all(path: Path, largest: int = 10**9) -> int:
    """Read a recording to its end."""
    with Recording(path, largest) as recording:
        return sum(1 for _ in recording.messages())


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('message_count: 4', 'message_count: many'),
        ('message_count: 4', 'message_count: -4'),
        ('message_count: 4', 'message_count: [4]'),
        ('message_count: 4', 'message_count: 4.5'),
        ('nanoseconds: ', 'nanoseconds: x'),
        ('relative_file_paths:', 'relative_file_paths: 5\n  more:'),
        ('storage_identifier: mcap', 'storage_identifier: []'),
        ('name: ', 'name: /other\n        other: '),
        ('type: ', 'type: 5\n        other: '),
        ('rosbag2_bagfile_information:', 'rosbag2_bagfile_information:\n  custom_data: [1]'),
        ('rosbag2_bagfile_information:', 'rosbag2_bagfile_information:\n  custom_data: {a: 1}'),
        ('rosbag2_bagfile_information:', 'other:'),
        ('rosbag2_bagfile_information:', 'a: &a [*a]\nrosbag2_bagfile_information:'),
        ('rosbag2_bagfile_information:', f'{BOMB}rosbag2_bagfile_information:'),
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


@pytest.mark.parametrize('is_real', [True, False])
def test_aliases_are_not_expanded(
    drive: Path,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    *,
    is_real: bool,
) -> None:
    """Of aliases that expand to gigabytes, salvage names one loss, and reads the messages."""
    path = drive / 'metadata.yaml'
    mode = re.sub('compression_mode: .*', 'compression_mode: *a9', path.read_text())
    path.write_text(BOMB + mode)
    if is_real:
        drive = request.getfixturevalue('real_data') / 'hostile' / 'alias_bomb_bag'
    tracemalloc.start()
    with salvaged(drive, tmp_path / 'out', 10**9) as (_, losses):
        assert tracemalloc.get_traced_memory()[1] < 100_000_000
        assert losses.reasons[0].startswith('metadata.yaml: "')
        assert 'more once its aliases are expanded' in losses.reasons[0]
    tracemalloc.stop()


def test_few_aliases_are_read(drive: Path) -> None:
    """What programs write that meet one value several times is read."""
    path = drive / 'metadata.yaml'
    data = yaml.safe_load(path.read_text())
    about = data['rosbag2_bagfile_information']
    about['files'] = [about['files'][0]] * 200
    path.write_text(yaml.safe_dump(data))
    assert path.read_text().count('*id') > 100
    assert read_all(drive) == 4


@pytest.mark.parametrize('name', ['drive.mcap', 'drive.db3', 'drive.bag', 'drive'])
def test_pipes(drive: Path, tmp_path: Path, name: str) -> None:
    """A pipe is refused, not waited for: as the recording, and within its folder."""
    path = tmp_path / name
    if path == drive:
        (drive / 'metadata.yaml').unlink()
        path = drive / 'metadata.yaml'
    os.mkfifo(path)
    recording = drive if path.parent == drive else path
    for more in ([], ['--salvage']):
        assert main(['replay', str(recording), '--output', str(tmp_path / 'out'), *more]) == 1
    with pytest.raises(RecordingError, match=f'{path} must be a regular file or a folder'):
        read_all(recording)


def write(path: Path, compression: CompressionType, size: int = 1000, **use: Any) -> Path:
    """Write an MCAP file of ROS 2 with 20 messages in several chunks."""
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=4 * size, compression=compression, **use)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/text', 'cdr', schema)
        for i in range(20):
            writer.add_message(channel, i, bytes(size), i)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize('compression', [CompressionType.ZSTD, CompressionType.LZ4])
def test_chunks_larger_than_allowed(tmp_path: Path, compression: CompressionType) -> None:
    """A chunk that is larger than allowed by its index is refused before it is decompressed."""
    path = write(tmp_path / 'a.mcap', compression, 2_000_000)
    assert path.stat().st_size < 1_000_000
    tracemalloc.start()
    with pytest.raises(RecordingError, match=r'a chunk of .* must be of at most 1000'):
        read_all(path, 1_000_000)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2_000_000
    assert read_all(path, 20_000_000) == 20


@pytest.mark.parametrize('options', list(product([True, False], repeat=4)))
@pytest.mark.parametrize('compression', list(CompressionType))
def test_index(tmp_path: Path, options: tuple[bool, ...], compression: CompressionType) -> None:
    """With any part of the index missing, all messages are found, or the file is refused."""
    use = dict(zip(('use_chunking', 'use_statistics', 'repeat_channels'), options, strict=False))
    kinds = IndexType.ALL if options[3] else IndexType.NONE
    path = write(tmp_path / 'a.mcap', compression, 99, index_types=kinds, **use)
    chunks, statistics, channels, index = options
    if (statistics and channels) or not (statistics or (chunks and index)):
        assert read_all(path) == 20
    else:
        check_refused(path)


@pytest.mark.parametrize('lost', ['chunk', 'messages', 'statistics'])
def test_index_that_lacks_a_part(tmp_path: Path, lost: str) -> None:
    """Chunks or messages that the index does not name are not left out without a word."""
    path = write(tmp_path / 'a.mcap', CompressionType.NONE)
    data = bytearray(path.read_bytes())
    (begin,) = struct.unpack('<Q', data[-28:-20])
    offset = begin
    while data[offset] != (11 if lost == 'statistics' else 8):
        offset += 9 + struct.unpack('<Q', data[offset + 1 : offset + 9])[0]
    if lost == 'messages':
        (length,) = struct.unpack('<I', data[offset + 41 : offset + 45])
        data[offset + 45 : offset + 45 + length] = bytes(length)
        data[offset + 45 + length : offset + 53 + length] = bytes(8)
    else:
        data[offset] = 0x80  # a private kind
    path.write_bytes(data)
    check_refused(path)


def check_refused(path: Path) -> None:
    """Hold that a file is refused, and that all of it can be salvaged."""
    with pytest.raises(RecordingError, match='with an index that names all of its messages'):
        read_all(path)
    with salvaged(path, path.with_name('out'), 10**9) as (copy, lost):
        assert read_all(copy) == 20
        assert not lost.reasons
