# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that point_cloud_transport has compressed: the same outputs as of plain ones."""

import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from helpers.clouds import NAME, cloud, table
from helpers.compressed import COMPRESS, STORE, compressed
from helpers.drives import content
from helpers.replays import cloud as turn
from rclpy.serialization import serialize_message

from lidar_outlier_filter.errors import CloudError, RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.compressed import MAX_CLOUD_BYTES, decompressed
from lidar_outlier_filter.pipeline.topics import CLOUD, COMPRESSED
from lidar_outlier_filter.recordings.bags import NewBag, Recording, Topic
from lidar_outlier_filter.recordings.info import describe_recording
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.recordings.replay import replay

ENDS = {'little': True, 'big': False}


def write_compressed(path: Path, topic: str, messages: list[tuple[int, bytes]]) -> Path:
    """Write compressed clouds with their bag times."""
    digest = STORE.hash_rihs01(COMPRESSED)
    clouds = Topic(topic, COMPRESSED, STORE.generate_msgdef(COMPRESSED, ros_version=2)[0], digest)
    with NewBag(path) as bag:
        bag.add(clouds)
        for time, data in messages:
            bag.write(clouds, time, data)
    return path


@pytest.mark.parametrize('name', COMPRESS)
@pytest.mark.parametrize('recording', ['vlp16_mrpt_mcap', 'os1_128_db3'])
def test_outputs_are_those_of_plain_clouds(
    recordings: Path, tmp_path: Path, recording: str, name: str
) -> None:
    """To the byte, and with the definition of a plain cloud; the input stays as it is."""
    plain = recordings / 'bags' / recording
    (topic,) = replay(plain, tmp_path / 'plain').topics
    expected = content(tmp_path / 'plain')
    sent = [(time, compressed(data, name)) for time, data in expected[topic.topic]]
    source = write_compressed(tmp_path / 'sent', f'{topic.topic}/{name}', sent)
    report = replay(source, tmp_path / 'out')
    assert report.is_complete
    found = content(tmp_path / 'out')
    assert found[f'{topic.topic}/{name}'] == sent
    for output in ('cleaned', 'outliers'):
        assert found[f'{topic.topic}/{output}'] == expected[f'{topic.topic}/{output}']
    with Recording(tmp_path / 'plain') as one, Recording(tmp_path / 'out') as other:
        (a, *_), (b, *_) = (
            [(t.definition, t.digest) for t in bag.topics if t.name.endswith('/cleaned')]
            for bag in (one, other)
        )
    assert a == b
    seen, known = (next(iter(describe_recording(one).clouds.values())) for one in (source, plain))
    assert (seen.fields, seen.shape, seen.geometry) == (known.fields, known.shape, known.geometry)
    assert len(list(RecordedClouds(source, FilterParameters()))) == len(sent)


def test_a_copy_of_a_recorded_topic_is_left_alone(tmp_path: Path) -> None:
    """``ros2 bag record --all`` records both: the plain one is filtered, and only it can be."""
    data = [serialize_message(turn(index)) for index in range(3)]
    plain = Topic('/lidar', CLOUD, *_definition(CLOUD))
    copy = Topic('/lidar/zlib', COMPRESSED, *_definition(COMPRESSED))
    with NewBag(tmp_path / 'both') as bag:
        for topic in (plain, copy):
            bag.add(topic)
        for index, one in enumerate(data):
            bag.write(plain, index, one)
            bag.write(copy, index, compressed(one, 'zlib'))
    report = replay(tmp_path / 'both', tmp_path / 'out')
    assert [topic.topic for topic in report.topics] == ['/lidar']
    assert [topic.name for topic in describe_recording(tmp_path / 'both').clouds] == ['/lidar']
    with pytest.raises(RecordingError, match="must be one of /lidar, got '/lidar/zlib'"):
        replay(tmp_path / 'both', tmp_path / 'other', ['/lidar/zlib'])


def _definition(msgtype: str) -> tuple[str, str]:
    return STORE.generate_msgdef(msgtype, ros_version=2)[0], STORE.hash_rihs01(msgtype)


@pytest.mark.parametrize('order', ENDS)
@pytest.mark.parametrize('name', COMPRESS)
@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'abcd', 'ü'])
@pytest.mark.parametrize('count', [0, 1, 5])
def test_it_is_the_plain_cloud(order: str, name: str, frame: str, count: int) -> None:
    """Wherever its parts lie, and with padding behind its rows."""
    msg = cloud(table(count, t=('u1', np.arange(count))), row_padding=3)
    msg.header.frame_id = frame
    msg.is_dense = count % 2 == 1
    data = serialize_message(msg)
    little = ENDS[order]
    plain = bytes(
        STORE.serialize_cdr(STORE.deserialize_cdr(data, NAME), NAME, little_endian=little)
    )
    assert decompressed(compressed(data, name, little_endian=little)) == plain


def test_zlib_without_the_header_of_gzip() -> None:
    """The subscriber of point_cloud_transport reads both."""
    data = serialize_message(turn(0))
    points = zlib.compress(turn(0).data.tobytes())
    sent = compressed(data, 'zlib', compressed_data=points)
    assert decompressed(sent) == decompressed(compressed(data, 'zstd'))


POINTS = turn(0).data.tobytes()
PACKED = {name: compress(POINTS) for name, compress in COMPRESS.items()}
BOMB = {name: compress(bytes(30_000_000)) for name, compress in COMPRESS.items()}


@pytest.mark.parametrize('name', COMPRESS)
@pytest.mark.parametrize('what', ['cut', 'damaged', 'followed', 'bomb', 'empty', 'noise', 'less'])
def test_damaged(name: str, what: str) -> None:
    """Refused in one sentence that says how many bytes there must be; a bomb takes no memory."""
    packed = PACKED[name]
    middle = len(packed) // 2
    data = {
        'cut': packed[:-1],
        'damaged': packed[:middle] + bytes(64) + packed[middle + 64 :],
        'followed': packed + b'x',
        'bomb': BOMB[name],
        'empty': b'',
        'noise': bytes(range(100)),
        'less': COMPRESS[name](POINTS[:-1]),
    }[what]
    sent = compressed(serialize_message(turn(0)), name, compressed_data=data)
    tracemalloc.start()
    sentence = f'the data of a compressed cloud must be {name} of row_step × height = {len(POINTS)}'
    with pytest.raises(CloudError, match=sentence):
        decompressed(sent)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 300_000


@pytest.mark.parametrize('name', COMPRESS)
@pytest.mark.parametrize(('height', 'row_step'), [(2**32 - 1, 2**32 - 1), (1, MAX_CLOUD_BYTES + 1)])
def test_a_shape_that_lies(name: str, height: int, row_step: int) -> None:
    """Nothing is allocated because a header says so."""
    sent = compressed(serialize_message(turn(0)), name, height=height, row_step=row_step)
    with pytest.raises(
        CloudError, match=f'at most {MAX_CLOUD_BYTES} bytes, got {height * row_step}'
    ):
        decompressed(sent)


@pytest.mark.parametrize('name', ['draco', 'cloudini', '', 'Zlib'])
def test_other_formats(name: str) -> None:
    """They are refused by name."""
    sent = compressed(serialize_message(turn(0)), 'zlib', format=name)
    sentence = f"the format of a compressed cloud must be 'zlib' or 'zstd', got '{name}'"
    with pytest.raises(CloudError, match=sentence):
        decompressed(sent)


def test_cut_short() -> None:
    """Wherever it ends, it is refused."""
    sent = compressed(serialize_message(turn(0)), 'zstd')
    for size in range(len(sent) - 1):
        with pytest.raises(CloudError):
            decompressed(sent[:size])
