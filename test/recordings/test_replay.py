# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Replay: every cloud is filtered, and everything else is copied unchanged."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.drives import DOOR, PERIOD, ROW, STRING, cdr, content, topic_of
from helpers.replays import REAL, check_outputs, cloud, write_drive
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import FilterError, ParameterError, RecordingError
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import NewBag, Recording
from lidar_outlier_filter.recordings.cloud_topic import TopicReport
from lidar_outlier_filter.recordings.replay import replay


@pytest.mark.parametrize('name', REAL)
def test_real_recording(recordings: Path, tmp_path: Path, name: str) -> None:
    """In each real recording, every point is in one output cloud, and every message is copied."""
    strict = {'boosted_trees.threshold': 0.75}  # or next to nothing is rejected
    report = replay(recordings / 'bags' / name, tmp_path / 'out', parameters=strict)
    assert report.is_complete
    before, after = content(recordings / 'bags' / name), content(tmp_path / 'out')
    assert {topic: after[topic] for topic in before} == before
    (topic,) = report.topics
    assert topic.messages == len(before[topic.topic])
    assert 0 < topic.rejected < 0.2 * topic.points
    check_outputs(before, after, topic.topic)


def test_everything_else_is_copied(tmp_path: Path) -> None:
    """Texts, an own type and a silent topic are in the output, which other readers understand."""
    source = write_drive(tmp_path / 'drive', map(cloud, range(12)))
    seen: list[tuple[int, int]] = []
    report = replay(
        source,
        tmp_path / 'out',
        parameters={'chain': ['alpha_beta_gamma']},
        progress=lambda done, total: seen.append((done, total)),
    )
    before, after = content(source), content(tmp_path / 'out')
    assert {topic: after[topic] for topic in before} == before
    assert set(after) - set(before) == {'/lidar/cleaned', '/lidar/outliers'}
    check_outputs(before, after, '/lidar')
    (topic,) = report.topics
    assert (topic.messages, topic.points, topic.refused) == (12, 2400, 0)
    assert topic.rejected >= 30
    assert seen == [(done, 25) for done in range(1, 26)]
    with AnyReader([tmp_path / 'out']) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        assert types['/lidar/cleaned'] == types['/lidar/outliers'] == CLOUD
        (door,) = [c for c in reader.connections if c.topic == '/door']
        messages = [reader.deserialize(data, DOOR) for _, _, data in reader.messages([door])]
    assert [message.angle for message in messages] == [0.5]  # type: ignore[attr-defined]
    with Recording(tmp_path / 'out') as recording:
        (qos,) = next(t.qos for t in recording.topics if t.name == '/lidar/cleaned')
    assert (qos.reliability, qos.durability) == (QosReliability.RELIABLE, QosDurability.VOLATILE)
    assert qos.depth == 10


def test_each_topic_is_its_own_stream(tmp_path: Path) -> None:
    """Two lidars with the same clouds give the same outputs, chosen alone or together."""
    source = write_drive(tmp_path / 'drive', map(cloud, range(6)), ('/left', '/right'))
    both = replay(source, tmp_path / 'both', drop_input=True)
    one = replay(source, tmp_path / 'one', ['/left', '/left'], drop_input=True)
    assert [topic.topic for topic in both.topics] == ['/left', '/right']
    assert [topic.topic for topic in one.topics] == ['/left']
    in_both, in_one = content(tmp_path / 'both'), content(tmp_path / 'one')
    assert in_both['/left/cleaned'] == in_both['/right/cleaned'] == in_one['/left/cleaned']
    assert in_both['/left/outliers'] == in_both['/right/outliers'] == in_one['/left/outliers']
    assert not {'/left', '/right'} & set(in_both)
    assert in_one['/right'] == content(source)['/right']
    assert '/left' not in in_one


def test_refused_clouds_are_counted(tmp_path: Path) -> None:
    """An inconsistent cloud and an undecodable one are refused; all others are filtered."""
    liar = cloud(2)
    liar.data = liar.data[:-1]
    clouds = [cloud(0), cloud(1), liar, b'\0\1\0\0nothing', cloud(4), cloud(5)]
    source = write_drive(tmp_path / 'drive', clouds)
    report = replay(source, tmp_path / 'out')
    (topic,) = report.topics
    assert not report.is_complete
    assert (topic.messages, topic.refused) == (6, 2)
    assert topic.refusals == {'data': 1, 'the CDR bytes': 1}
    before, after = content(source), content(tmp_path / 'out')
    assert {name: after[name] for name in before} == before
    del before['/lidar'][2:4]
    check_outputs(before, after, '/lidar')


@pytest.mark.parametrize(
    ('points', 'value', 'because'),
    [
        (3, 1.0, 'alpha_beta_gamma needs longer scan lines, sor needs more points'),
        (30, np.nan, 'all are missing returns'),
        (0, 1.0, 'its clouds have none'),
    ],
)
def test_no_point_is_tested(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    points: int,
    value: float,
    because: str,
) -> None:
    """If no point of a topic could be tested, the reason is reported, with exit status 3."""
    clouds = []
    for index in range(2):
        msg = cloud(index)
        rows = np.frombuffer(bytes(msg.data), ROW)[:points].copy()
        rows['x'] *= np.float32(value)
        msg.data, msg.width, msg.row_step = rows.tobytes(), points, rows.nbytes
        clouds.append(msg)
    source = write_drive(tmp_path / 'drive', clouds)
    command = ['replay', str(source), '--set', 'chain=[alpha_beta_gamma, sor]']
    assert main(command) == 3
    assert f'no point of /lidar could be tested: {because}\n' in capsys.readouterr().err


def test_two_types_on_one_topic(tmp_path: Path) -> None:
    """Messages of another type on the topic of the clouds are copied, not refused."""
    source = tmp_path / 'drive'
    clouds, texts = topic_of('/lidar', CLOUD), topic_of('/lidar', STRING)
    with NewBag(source) as bag:
        bag.add(texts)
        bag.add(clouds)
        for index in range(6):
            bag.write(texts, index * PERIOD, cdr(STRING, f'cloud {index}'))
            bag.write(clouds, index * PERIOD, serialize_message(cloud(index)))
    report = replay(source, tmp_path / 'out')
    (topic,) = report.topics
    assert report.is_complete
    assert (topic.messages, topic.points, topic.refusals) == (6, 1200, {})
    assert content(tmp_path / 'out')['/lidar'] == content(source)['/lidar']
    replay(source, tmp_path / 'without', drop_input=True)
    assert [data for _, data in content(tmp_path / 'without')['/lidar']] == [
        cdr(STRING, f'cloud {index}') for index in range(6)
    ]


@pytest.mark.parametrize(
    'values',
    [
        *({'blocks': blocks} for blocks in ('auto', 'message', 'time')),
        {'block': 60.0, 'max_delay': 100.0},  # published at the end
    ],
)
def test_a_cloud_stands_before_its_outputs(tmp_path: Path, values: dict[str, object]) -> None:
    """At equal times a cloud comes before its outputs: cleaned, then outliers."""
    source = write_drive(tmp_path / 'drive', map(cloud, range(6)))
    replay(source, tmp_path / 'out', parameters=values)
    with Recording(tmp_path / 'out') as recording:
        order = [(time, topic.name) for topic, time, _ in recording.messages()]
    names = ('/lidar', '/lidar/cleaned', '/lidar/outliers')
    assert [item for item in order if item[1] in names] == [
        (index * PERIOD, name) for index in range(6) for name in names
    ]


def test_lost_messages_are_counted(tmp_path: Path) -> None:
    """A recording that counts more messages than it has gives an incomplete output."""
    source = write_drive(tmp_path / 'drive', map(cloud, range(2)))
    metadata = source / 'metadata.yaml'
    information = yaml.safe_load(metadata.read_text())
    information['rosbag2_bagfile_information']['topics_with_message_count'][0]['message_count'] += 3
    metadata.write_text(yaml.safe_dump(information))
    report = replay(source, tmp_path / 'out')
    assert report.unread == 3
    assert not report.is_complete


def test_what_cannot_be_replayed(tmp_path: Path) -> None:
    """No clouds, an unknown topic, a taken name and a wrong parameter: one sentence, no output."""
    source = write_drive(tmp_path / 'drive', [cloud(0)], ('/lidar', '/lidar/cleaned'))
    clouds = write_drive(tmp_path / 'none', [], ())
    out, wrong = tmp_path / 'out', {'alpha_beta_gamma.before': -1}
    for error, sentence, arguments in (
        (RecordingError, r'LaserScan, got /text \(std_msgs/msg/String\), /door', (clouds, out)),
        (RecordingError, "one of /lidar, /lidar/cleaned, got '/text'", (source, out, ['/text'])),
        (RecordingError, 'output topic of /lidar must be new', (source, out)),
        (ParameterError, r'alpha_beta_gamma\.before must be', (source, out, ['/lidar'], wrong)),
        (FilterError, 'must be a new folder', (source, source, ['/lidar/cleaned'])),
    ):
        with pytest.raises(error, match=sentence):
            replay(*arguments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['drive', 'none']
    replay(source, out, ['/lidar/cleaned'])


def test_output_within_the_recording(tmp_path: Path) -> None:
    """A recording stays as it is: nothing is written into its folder."""
    source = write_drive(tmp_path / 'drive', [cloud(0)])
    before = sorted(source.iterdir())
    for name in ('out', 'deep/out', '../drive/out'):
        with pytest.raises(RecordingError, match=r'the output must be outside of .*drive, which'):
            replay(source, source / name)
    assert sorted(source.iterdir()) == before


def test_name_that_only_ros1_allows(tmp_path: Path) -> None:
    """A topic that cannot be named in ROS 2 is refused in a sentence."""
    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / 'old.bag'
    with Writer1(path) as writer:
        writer.add_connection('/lidar/0/points', CLOUD, typestore=store)
        text = writer.add_connection('/text', STRING, typestore=store)
        writer.write(text, 0, store.serialize_ros1(store.types[STRING]('hello'), STRING))
    with pytest.raises(RecordingError, match='a name that ROS 2 allows, got /lidar/0/points'):
        replay(path, tmp_path / 'out')


REPLAY = """
import sys
from pathlib import Path
from lidar_outlier_filter.recordings.replay import replay

def show(done, total):
    if done % 1200 == 0:
        print(Path('/proc/self/status').read_text())

replay(Path(sys.argv[1]), Path(sys.argv[2]), progress=show)
"""


@pytest.mark.slow
def test_memory_does_not_grow(tmp_path: Path) -> None:
    """An hour at 10 clouds and 10 texts a second takes less than 500 MB.

    Foretold from five minutes: what is taken after the first of them, and how it grows from there.
    """
    source = write_drive(tmp_path / 'drive', (cloud(index) for index in range(3000)))
    command = [sys.executable, '-c', REPLAY, str(source), str(tmp_path / 'out')]
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    minutes = [int(kilobytes) for kilobytes in re.findall(r'VmHWM:\s+(\d+) kB', said)]
    assert len(minutes) == 5
    growth = (minutes[-1] - minutes[0]) / 4
    assert minutes[0] + 59 * max(growth, 0.0) < 500_000


@pytest.mark.parametrize(
    ('untested', 'invalid', 'masked', 'because'),
    [
        (8, 0, 2, 'sor needs more points'),
        (0, 5, 5, 'all are missing returns, or on the own vehicle'),
        (0, 10, 0, 'all are missing returns'),
        (7, 0, 2, ''),
    ],
)
def test_untested_beside_the_own_vehicle(
    untested: int, invalid: int, masked: int, because: str
) -> None:
    """Points on the own vehicle are not tested either."""
    report = TopicReport(
        topic='/points',
        messages=1,
        points=10,
        rejected=masked,
        untested=untested,
        invalid=invalid,
        dropped=0,
        refused=0,
        refusals={},
        rejected_by={'sor': 0, 'mask': masked},
        undecided_by={'sor': untested},
        sentences={},
    )
    assert report.untested_because == because
