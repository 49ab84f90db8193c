# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A small drive in each kind of recording, how it is damaged, and what must hold of its salvage."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from hypothesis import strategies as st
from mcap.reader import SeekingReader, make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as WriterMcap
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from helpers.clouds import STORE, to_bytes
from helpers.drives import PERIOD, STRING, cdr
from helpers.drives import content as read_content
from helpers.replays import cloud
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.replay import ReplayReport, replay

NOETIC = get_typestore(Stores.ROS1_NOETIC)
TOPICS = {'/lidar': CLOUD, '/text': STRING}
COUNT = 12  # clouds, one each PERIOD
POINTS = 120
FAST: dict[str, object] = {
    'chain': ('alpha_beta_gamma',),
    'threads': 1,
    'blocks': 'time',
    'block': 0.05,
    'halo': 0.02,
}
KINDS = (
    'mcap',
    'mcap lz4',
    'mcap zstd',
    'mcap without chunks',
    'mcap without index',
    'db3',
    'bag',
    'bag bz2',
    'bag lz4',
    'folder',
    'folder split',
    'folder db3',
    'folder file',
    'folder message',
)


class Content(dict[str, list[tuple[int, bytes]]]):
    """Bag time and bytes of all messages, by topic."""

    def __repr__(self) -> str:
        """Say no more than how many there are: hypothesis shows it."""
        return f'Content of {sum(map(len, self.values()))} messages'


class Sent(NamedTuple):
    """A message: its topic, bag time and bytes."""

    topic: str
    time: int
    data: bytes


def drive() -> list[Sent]:
    """Make clouds of a wall with outliers, 0.1 s each, and a text before each."""
    sent = []
    for i in range(COUNT):
        sent.append(Sent('/text', i * PERIOD, cdr(STRING, f'cloud {i}')))
        sent.append(Sent('/lidar', i * PERIOD, to_bytes(cloud(i, POINTS))))
    return sent


def write_recording(kind: str, folder: Path) -> Path:
    """Write the drive in small chunks; return the recording."""
    name, _, form = kind.partition(' ')
    if name == 'mcap':
        return _write_mcap(folder / 'drive.mcap', form)
    if name == 'bag':
        return _write_ros1(folder / 'drive.bag', form)
    if name == 'db3':
        bag = _write_ros2(folder / 'made', StoragePlugin.SQLITE3, '')
        return (bag / 'made.db3').rename(folder / 'drive.db3')
    if form == 'split':
        return _write_split(folder / 'drive')
    plugin = StoragePlugin.SQLITE3 if form in {'db3', 'message'} else StoragePlugin.MCAP
    return _write_ros2(folder / 'drive', plugin, form)


def _write_mcap(path: Path, form: str) -> Path:
    compression = CompressionType[form.upper()] if form in {'lz4', 'zstd'} else CompressionType.NONE
    kinds = IndexType.NONE if 'index' in form else IndexType.ALL
    with path.open('wb') as stream:
        writer = WriterMcap(
            stream,
            chunk_size=4000,
            compression=compression,
            index_types=kinds,
            use_chunking='chunks' not in form,
        )
        writer.start('ros2')
        channels = {}
        for topic, msgtype in TOPICS.items():
            definition = STORE.generate_msgdef(msgtype, ros_version=2)[0].encode()
            schema = writer.register_schema(msgtype, 'ros2msg', definition)
            channels[topic] = writer.register_channel(topic, 'cdr', schema)
        for topic, time, data in drive():
            writer.add_message(channels[topic], time, data, time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def _write_ros1(path: Path, form: str) -> Path:
    writer = Writer1(path)
    writer.chunk_threshold = 4000
    if form:
        writer.set_compression(Writer1.CompressionFormat[form.upper()])
    with writer:
        connections = {
            topic: writer.add_connection(topic, msgtype, typestore=NOETIC)
            for topic, msgtype in TOPICS.items()
        }
        for topic, time, data in drive():
            writer.write(connections[topic], time, STORE.cdr_to_ros1(data, TOPICS[topic]))
    return path


def _write_ros2(path: Path, plugin: StoragePlugin, form: str, parts: slice = slice(None)) -> Path:
    writer = Writer2(path, version=9, storage_plugin=plugin)
    writer.set_custom_data('robot', 'seven')
    if form in {'file', 'message'}:
        writer.set_compression(CompressionMode[form.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, msgtype, typestore=STORE)
            for topic, msgtype in TOPICS.items()
        }
        for topic, time, data in drive()[parts]:
            writer.write(connections[topic], time, data)
    return path


def _write_split(path: Path) -> Path:
    """Write the drive into a bag of three files."""
    bags = []
    for i in range(3):
        part = path.with_name(f'part_{i}')
        bag = _write_ros2(part, StoragePlugin.MCAP, '', slice(8 * i, 8 * i + 8))
        bags.append(yaml.safe_load((bag / 'metadata.yaml').read_text()))
    path.mkdir()
    whole = bags[0]['rosbag2_bagfile_information']
    others = [bag['rosbag2_bagfile_information'] for bag in bags[1:]]
    for other in others:
        whole['message_count'] += other['message_count']
        for mine, its in zip(
            whole['topics_with_message_count'], other['topics_with_message_count'], strict=True
        ):
            mine['message_count'] += its['message_count']
        whole['files'] += other['files']
        whole['relative_file_paths'] += other['relative_file_paths']
    (path / 'metadata.yaml').write_text(yaml.safe_dump(bags[0]))
    for i in range(3):
        (path.with_name(f'part_{i}') / f'part_{i}.mcap').rename(path / f'part_{i}.mcap')
    return path


WAYS = ('cut', 'flip', 'zero', 'wild', 'leave out', 'metadata', 'missing')


class Damage(NamedTuple):
    """What is done to a recording: a way, an offset as a share of the file, and a seed."""

    way: str
    share: float
    seed: int


@st.composite
def damages(draw: st.DrawFn) -> list[Damage]:
    """Draw one to three ways to damage a recording."""
    one = st.builds(Damage, st.sampled_from(WAYS), st.floats(0, 1), st.integers(0, 2**32 - 1))
    return draw(st.lists(one, min_size=1, max_size=3))


def inflict(recording: Path, damage: Damage) -> None:
    """Damage a recording in place; of a folder, the second of several files."""
    if recording.is_dir() and damage.way == 'metadata':
        (recording / 'metadata.yaml').unlink(missing_ok=True)
        return
    files = [recording]
    if recording.is_dir():
        files = sorted(file for file in recording.iterdir() if file.name != 'metadata.yaml')
    if not files:
        return
    file = files[len(files) // 2]
    if recording.is_dir() and damage.way == 'missing':
        file.unlink()
        return
    rng = np.random.default_rng(damage.seed)
    data = bytearray(file.read_bytes())
    offset = int(damage.share * len(data))
    if damage.way == 'cut':
        del data[offset:]
    elif damage.way == 'flip':
        for at in rng.integers(0, max(1, len(data)), 3):
            data[at : at + 1] = bytes([int(rng.integers(256))])
    elif damage.way == 'zero':
        data[offset : offset + 600] = bytes(len(data[offset : offset + 600]))
    elif damage.way == 'wild':
        data[offset : offset + 8] = b'\xff' * len(data[offset : offset + 8])
    else:
        del data[offset : offset + int(rng.integers(1, 3000))]
    file.write_bytes(data)


def content(path: Path) -> Content:
    """Read all messages of a recording, by topic."""
    return Content(read_content(path))


def salvage(recording: Path, output: Path) -> ReplayReport | None:
    """Filter what can be read; the output is whole and indexed, or a sentence says why not."""
    try:
        report = replay(recording, output, parameters=FAST, salvage=True)
    except RecordingError as err:
        assert str(err).isprintable()  # noqa: PT017  either is right
        assert ' must be ' in str(err)  # noqa: PT017
        assert not output.exists()
        return None
    with (output / f'{output.name}.mcap').open('rb') as stream:
        reader = make_reader(stream)
        assert isinstance(reader, SeekingReader)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(list(reader.iter_messages())) == summary.statistics.message_count
        assert sum(chunk.chunk_length > 0 for chunk in summary.chunk_indexes) > 0
    return report


def check(recording: Path, output: Path, unbroken: Content) -> ReplayReport | None:
    """Salvage a recording, and hold that nothing is lost quietly, and no verdict is another one.

    ``unbroken`` is what the replay of the undamaged recording has. Where every message that came
    out is one of its messages, every output equals its output, of which the block, with its halo on
    both sides, has the points of no cloud that is lost. Without checksums, bytes of a message may
    be changed: then this cannot be said.
    """
    report = salvage(recording, output)
    if report is None:
        return None
    found = content(output)
    kept = [time for time, _ in found['/lidar']]
    count = len(kept) + len(found.get('/text', []))
    assert count <= 2 * COUNT
    assert count == 2 * COUNT or report.lost.reasons
    if any(set(found.get(topic, [])) - set(unbroken[topic]) for topic in TOPICS):
        return report
    lost = [i * PERIOD for i in range(COUNT) if i * PERIOD not in kept]
    for topic in ('/lidar/cleaned', '/lidar/outliers'):
        expected = dict(unbroken[topic])
        for time, data in found[topic]:
            if not is_near(time, lost):
                assert data == expected[time]
    return report


def is_near(time: int, lost: list[int]) -> bool:
    """Return whether a lost cloud has points in the blocks of a cloud, or in their halo."""
    block, halo = 50_000_000, 20_000_000
    begin = time // block * block - halo
    end = (time + PERIOD - 1) // block * block + block + halo
    return any(one < end and begin < one + PERIOD for one in lost)
