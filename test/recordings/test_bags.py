# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: nothing of the input is lost or changed, and no half output is left."""

import sqlite3
from dataclasses import astuple, replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml
from helpers.clouds import NAME as CLOUD
from helpers.clouds import STORE as JAZZY
from helpers.drives import STRING, cdr, topic_of
from mcap.reader import SeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import LATCHED, NewBag, Recording, Topic

CAMERA = 'sensor_msgs/msg/CameraInfo'
OLD_TF = 'tf/msg/tfMessage'
DOOR = 'shop_msgs/msg/Door'
BEST_EFFORT = Qos(
    QosHistory.KEEP_LAST,
    5,
    QosReliability.BEST_EFFORT,
    QosDurability.VOLATILE,
    QosTime(1, 500),
    QosTime(9223372036, 854775807),
    QosLiveliness.MANUAL_BY_TOPIC,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=True,
)


def known(name: str, msgtype: str, *qos: Qos) -> Topic:
    """Describe a topic of a type that ROS 2 Jazzy knows."""
    return replace(topic_of(name, msgtype), qos=qos)


TOPICS = (
    known('/points', CLOUD, BEST_EFFORT),
    known('/text', STRING, LATCHED, BEST_EFFORT),
    known('/silent', STRING),
    # rosbags cannot parse this one, and its hash is somebody else's word
    Topic('/wide', 'shop_msgs/msg/Wide', 'wstring<=3[<=2] text\n', 'RIHS01_' + 'ab' * 32),
)
# Topic and bag time of each message: not in order, and the same time on one topic and on several.
MESSAGES = [(0, 30), (1, 30), (1, 10), (1, 10), (3, 10), (0, 20), (3, 40), (0, 40), (1, 40)]


def text(words: str) -> bytes:
    """Make the CDR bytes of a text."""
    return cdr(STRING, words)


def write_bag(path: Path, plugin: StoragePlugin) -> Path:
    """Write MESSAGES into a ROS 2 bag."""
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_custom_data('robot', 'seven')
    with writer:
        connections = [
            writer.add_connection(
                topic.name,
                topic.msgtype,
                msgdef=topic.definition,
                rihs01=topic.digest,
                offered_qos_profiles=topic.qos,
            )
            for topic in TOPICS
        ]
        for index, (topic, time) in enumerate(MESSAGES):
            writer.write(connections[topic], time, text(f'message {index}'))
    return path


def copy(source: Path, target: Path) -> Path:
    """Write all of a recording into a new bag."""
    with Recording(source) as recording, NewBag(target, recording.custom_data) as bag:
        for topic in recording.topics:
            bag.add(topic)
        for topic, time, data in recording.messages():
            bag.write(topic, time, data)
    return target


@pytest.mark.parametrize('plugin', list(StoragePlugin))
@pytest.mark.parametrize(
    ('qos', 'digest'),
    [([], ''), ('of another', 'RIHS01_' + 'cd' * 32), ([], 'RIHS01_' + 'cd' * 32)],
)
def test_metadata_that_says_another_qos(
    tmp_path: Path, plugin: StoragePlugin, qos: Any, digest: str
) -> None:
    """Where metadata.yaml says another QoS or hash than the files, all is read as the files say."""
    source = write_bag(tmp_path / 'source', plugin)
    path = source / 'metadata.yaml'
    data = yaml.safe_load(path.read_text())
    topics = data['rosbag2_bagfile_information']['topics_with_message_count']
    other = topics[0]['topic_metadata']['offered_qos_profiles'] if qos else []
    for one in topics:
        one['topic_metadata'] |= {'offered_qos_profiles': other, 'type_description_hash': digest}
    path.write_text(yaml.safe_dump(data))
    with Recording(source) as recording:
        assert recording.message_count == len(MESSAGES)
        assert len(list(recording.messages())) == len(MESSAGES)
        assert [topic.name for topic in recording.topics] == [topic.name for topic in TOPICS]
        assert [topic.qos for topic in recording.topics[:2]] == [t.qos for t in TOPICS[:2]]


def described(connections: list[Connection]) -> list[tuple[object, ...]]:
    """Return everything of the connections that does not depend on the file."""
    return [(c.topic, c.msgtype, c.msgdef, c.digest, c.msgcount, c.ext) for c in connections]


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_copy_of_a_folder_keeps_everything(tmp_path: Path, plugin: StoragePlugin) -> None:
    """Topics, empty ones too, QoS, types and hashes, all bytes, times and custom data stay."""
    source = write_bag(tmp_path / 'source', plugin)
    target = copy(source, tmp_path / 'target')
    with Reader(source) as before, Reader(target) as after:
        assert described(after.connections) == described(before.connections)
        assert len(after.connections) == len(TOPICS)
        order = sorted(range(len(MESSAGES)), key=lambda index: MESSAGES[index][1])
        assert [(c.topic, time, data) for c, time, data in after.messages()] == [
            (TOPICS[MESSAGES[i][0]].name, MESSAGES[i][1], text(f'message {i}')) for i in order
        ]
    information = yaml.safe_load((target / 'metadata.yaml').read_text())
    assert information['rosbag2_bagfile_information']['custom_data'] == {'robot': 'seven'}


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_lone_file_is_read_as_its_folder(tmp_path: Path, plugin: StoragePlugin) -> None:
    """A lone file gives what its folder gives; hashes that the file does not keep are computed."""
    source = write_bag(tmp_path / 'source', plugin)
    (lone,) = set(source.iterdir()) - {source / 'metadata.yaml'}
    with Recording(source) as folder, Recording(lone) as file:
        assert list(folder.messages()) != []
        assert [(t.name, *m) for t, *m in file.messages()] == [
            (t.name, *m) for t, *m in folder.messages()
        ]
        for found in (file.topics, folder.topics):
            assert [astuple(topic) for topic in found[:3]] == [astuple(t) for t in TOPICS[:3]]
        assert (file.duration, file.message_count) == (31, len(MESSAGES))


def test_idl_definition_and_its_hash(tmp_path: Path) -> None:
    """A type that is defined in IDL keeps its text; its hash is that of the same type in MSG."""
    idl = (
        '=' * 80 + '\nIDL: shop_msgs/msg/Door\n'
        'module shop_msgs { module msg { struct Door { string name; double angle; }; }; };\n'
    )
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg('string name\nfloat64 angle\n', DOOR))
    topic = Topic('/door', DOOR, idl, store.hash_rihs01(DOOR))
    with NewBag(tmp_path / 'bag') as bag:
        bag.add(topic)
    with Recording(tmp_path / 'bag' / 'bag.mcap') as recording:
        assert [astuple(found) for found in recording.topics] == [astuple(topic)]


def test_bag_without_definitions(tmp_path: Path) -> None:
    """Recordings older than Iron define no type: what never changed is defined, the rest is not."""
    source = tmp_path / 'old.db3'
    with sqlite3.connect(source) as database:
        database.executescript(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,'
            ' serialization_format TEXT, offered_qos_profiles TEXT);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,'
            ' data BLOB);'
        )
        types = [CLOUD, 'sensor_msgs/msg/Range', DOOR]  # Range was changed in Iron
        for number, msgtype in enumerate(types):
            topic = (number, f'/t{number}', msgtype)
            database.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", topic)
            message = (number, 50, text(msgtype))
            database.execute('INSERT INTO messages VALUES(NULL, ?, ?, ?)', message)
    database.close()
    target = copy(source, tmp_path / 'target')
    with AnyReader([target]) as reader:
        assert [c.digest for c in reader.connections] == [known('', CLOUD).digest, '', '']
        assert [bytes(data) for _, _, data in reader.messages()] == [text(name) for name in types]


def write_ros1(path: Path) -> Path:
    """Write a ROS 1 bag: two publishers of a topic, one of them latched, and an own type."""
    store = get_typestore(Stores.ROS1_NOETIC)
    definition = 'std_msgs/Header header\nfloat64 angle\ntime seen\n'
    store.register(get_types_from_msg(definition, DOOR))
    store.register(get_types_from_msg('geometry_msgs/TransformStamped[] transforms\n', OLD_TF))
    stamp, header = store.types['builtin_interfaces/msg/Time'], store.types['std_msgs/msg/Header']
    door = store.types[DOOR](header(7, stamp(1, 2), 'map'), 0.5, stamp(3, 4))
    with Writer1(path) as writer:
        for number, (topic, msgtype, latching, message) in enumerate(
            [
                ('/text', STRING, None, store.types[STRING]('hello')),
                ('/text', STRING, 1, store.types[STRING]('world')),
                ('/door', DOOR, None, door),
                ('/tf', OLD_TF, None, store.types[OLD_TF]([])),
                ('/camera', CAMERA, None, None),
            ]
        ):
            connection = writer.add_connection(
                topic, msgtype, typestore=store, callerid=f'/node{number}', latching=latching
            )
            if message is not None:
                writer.write(connection, 10, store.serialize_ros1(message, msgtype))
    return path


def test_ros1_becomes_ros2(tmp_path: Path) -> None:
    """Publishers of a topic are one, latched ones last, headers lose their number."""
    target = copy(write_ros1(tmp_path / 'old.bag'), tmp_path / 'target')
    with AnyReader([target]) as reader:
        topics = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
        (camera,) = (c.digest for c in reader.connections if c.topic == '/camera')
        read: list[Any] = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
    frames_type = 'tf2_msgs/msg/TFMessage'
    others = {'/tf': (frames_type, 1), '/camera': (CAMERA, 0)}
    assert topics == {'/text': (STRING, 2), '/door': (DOOR, 1), **others}
    assert camera == JAZZY.hash_rihs01(CAMERA)
    hello, world, door, frames = read
    assert (hello.data, world.data) == ('hello', 'world')
    assert (door.header.stamp.nanosec, door.header.frame_id, door.angle) == (2, 'map', 0.5)
    assert not hasattr(door.header, 'seq')
    assert frames.transforms == []
    with Recording(target) as recording:
        offered = {topic.name: topic.qos for topic in recording.topics}
    assert offered == dict.fromkeys(topics, ()) | {'/text': (LATCHED,)}


def test_ros1_type_with_two_definitions_is_refused(tmp_path: Path) -> None:
    """One name for two types cannot be written into one bag, so it is not."""
    with Writer1(tmp_path / 'two.bag') as writer:
        for topic, definition in (('/a', 'float64 angle\n'), ('/b', 'float32 angle\n')):
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(definition, DOOR))
            connection = writer.add_connection(topic, DOOR, typestore=store)
            writer.write(connection, 0, store.serialize_ros1(store.types[DOOR](1.0), DOOR))
    refused = pytest.raises(
        RecordingError, match='definition of shop_msgs/msg/Door must be the same'
    )
    with refused, Recording(tmp_path / 'two.bag'):
        pass


def test_other_readers_find_index_and_names(tmp_path: Path) -> None:
    """The mcap reader finds every message by index; no file names the hidden folder."""
    target = copy(write_bag(tmp_path / 'source', StoragePlugin.SQLITE3), tmp_path / 'target')
    assert sorted(path.name for path in target.iterdir()) == ['metadata.yaml', 'target.mcap']
    assert not any(b'partial' in path.read_bytes() for path in target.iterdir())
    with (target / 'target.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert isinstance(reader, SeekingReader)
        summary = reader.get_summary()
        assert summary is not None
        indexed = {
            channel for index in summary.chunk_indexes for channel in index.message_index_offsets
        }
        names = {TOPICS[topic].name for topic, _ in MESSAGES}
        assert {summary.channels[channel].topic for channel in indexed} == names
        words = [item.decoded_message.data for item in reader.iter_decoded_messages('/text')]
        assert words == ['message 2', 'message 3', 'message 1', 'message 8']


def write_until(target: Path, time: int, error: type[BaseException]) -> None:
    """Write a message, check that it is hidden, and raise an error."""
    with NewBag(target) as bag:
        bag.add(TOPICS[1])
        (hidden,) = target.parent.iterdir()
        assert hidden.name.startswith('.target.partial-')
        bag.write(TOPICS[1], time, text('lost'))
        raise error


def test_bag_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    """Before the end there is only a hidden folder; after an error or a Ctrl-C there is nothing."""
    target = tmp_path / 'target'
    for time, error in ((1, ValueError), (1, KeyboardInterrupt), (1, SystemExit)):
        with pytest.raises(error):
            write_until(target, time, error)
        assert list(tmp_path.iterdir()) == []
    for time in (-1, 2**63):
        must_be = 'the bag time of a message of /text must be from 0'
        with pytest.raises(RecordingError, match=must_be):
            write_until(target, time, ValueError)
        assert list(tmp_path.iterdir()) == []
    with NewBag(target) as bag:
        bag.add(TOPICS[1])
        assert not target.exists()
    assert list(tmp_path.iterdir()) == [target]


def test_messages_are_written_as_they_come(tmp_path: Path) -> None:
    """Of 16 MiB, no more than two chunks are not yet in the file."""
    megabyte = bytes(2**20)
    with NewBag(tmp_path / 'bag') as bag:
        bag.add(TOPICS[0])
        for count in range(1, 17):
            bag.write(TOPICS[0], count, megabyte)
            (file,) = tmp_path.rglob('*.mcap')
            assert file.stat().st_size > (count - 2) * len(megabyte)


def read_all(path: Path) -> int:
    """Read a recording to its end."""
    with Recording(path) as recording:
        return sum(1 for _ in recording.messages())


def test_log_of_a_database(tmp_path: Path) -> None:
    """Messages in the log beside a database would be lost: refused; an empty log loses nothing."""
    source = write_bag(tmp_path / 'source', StoragePlugin.SQLITE3)
    for path, ending in product((source, source / 'source.db3'), ('wal', 'journal')):
        log = source / f'source.db3-{ending}'
        log.write_bytes(b'')
        assert read_all(path) == len(MESSAGES)
        log.write_bytes(b'messages')
        with pytest.raises(RecordingError, match=f'closed by its recorder, got .*-{ending}'):
            read_all(path)
        log.unlink()


def test_other_encoding_is_refused(tmp_path: Path) -> None:
    """A lone MCAP file with another encoding than CDR is refused."""
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = known('/text', STRING)
        writer.add_connection(
            topic.name,
            topic.msgtype,
            msgdef=topic.definition,
            rihs01=topic.digest,
            serialization_format='json',
        )
    with pytest.raises(RecordingError, match="encoding of /text must be 'cdr', got 'json'"):
        read_all(tmp_path / 'bag' / 'bag.mcap')
