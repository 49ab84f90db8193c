# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Motion in the node and in a replay: odometry over the middleware, and out of a recording."""

from pathlib import Path

import pytest
from helpers.clouds import SECOND
from helpers.nodes import Ros, Sensor, hold_up, wait_for_thread
from helpers.profile_scanner import (
    MOVING,
    REPLAYED,
    SHOTS,
    SOR,
    Drive,
    Moving,
    nanoseconds,
    rejected,
    write,
    write_tf,
)
from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import ParameterError, RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.ros.health import ERROR
from lidar_outlier_filter.ros.node import OutlierFilterNode


def start(ros: Ros, **parameters: object) -> tuple[OutlierFilterNode, Sensor, Publisher]:
    """Start a node that knows of motion, and what it receives."""
    given = MOVING | {name.replace('__', '.'): value for name, value in parameters.items()}
    node = ros.filter(parameters=given | {'motion.topic': 'odom'})
    node.start()
    sensor = Sensor(ros, '/points')
    odometry = ros.client.create_publisher(Odometry, '/odom', 1000)
    sensor.wait_for_filter(node)
    ros.serve_while(lambda: not odometry.get_subscription_count())
    return node, sensor, odometry


def test_live(ros: Ros) -> None:
    """Clouds wait for the odometry that comes after them; the verdicts are as in a direct call."""
    drive = Drive(0.5)
    clouds, odometry = drive.clouds(drive.own), drive.odometry()
    expected = rejected(drive, Moving().run(clouds, odometry))
    node, sensor, publisher = start(ros, max_delay=60.0)
    for msg in clouds:
        sensor.publish(msg, expected=len(clouds))
    ros.serve_while(lambda: node.channels[0].waiting < len(clouds))
    for msg in odometry:
        publisher.publish(msg)
        ros.executor.spin_once(0.0)
    publisher.wait_for_all_acked()
    ros.serve_while(lambda: node.channels[0].statistics.messages < len(clouds) - 1)
    node.finish()
    sensor.wait_for_outputs()
    assert [msg.header for msg in sensor.outliers] == [msg.header for msg in clouds]
    results = [type('SplitCloud', (), {'outliers': msg}) for msg in sensor.outliers]
    assert (rejected(drive, results) == expected).all()  # type: ignore[arg-type]
    assert node.channels[0].statistics.without_pose == 0


def test_without_odometry_clouds_are_published_in_time(ros: Ros) -> None:
    """Judged without, and said of; when it comes, the next ones are judged with it."""
    drive = Drive(0.5)
    clouds = drive.clouds(drive.own)
    node, sensor, publisher = start(ros, max_delay=0.5)
    ros.diagnosis()  # from here on none is missed
    sensor.publish(clouds[0], expected=1)
    sensor.wait_for_outputs()
    assert node.channels[0].statistics.without_pose == 1
    found = ros.diagnosis(lambda found: found['without_pose'] == 1)
    assert '1 (1 judged without poses)' in found.message
    assert found.level == ERROR
    for msg in drive.odometry():
        publisher.publish(msg)
        ros.executor.spin_once(0.0)
    wait_for_thread(node)
    for number, msg in enumerate(clouds[1:], 2):
        sensor.publish(msg, expected=number)
        sensor.wait_for_outputs()
    assert node.channels[0].statistics.without_pose == 1
    assert node.channels[0].statistics.refused == 0


def test_poses_wake_the_thread(ros: Ros) -> None:
    """A cloud goes on when its last pose has come, though nothing else happens."""
    drive = Drive(0.2)
    node, sensor, publisher = start(ros, max_delay=60.0, blocks='message')
    sensor.publish(drive.clouds(drive.own)[0], expected=1)
    ros.serve_while(lambda: not node.channels[0]._filter.pending)
    wait_for_thread(node)
    for pose in drive.odometry():
        publisher.publish(pose)
    sensor.wait_for_outputs()
    assert node.channels[0].statistics.without_pose == 0


def test_poses_that_come_while_a_block_is_judged(ros: Ros) -> None:
    """They are used, though the cloud has waited by then for as long as it may."""
    drive = Drive(0.2)
    (msg, *_), odometry = drive.clouds(drive.own), drive.odometry()
    node, sensor, publisher = start(ros, max_delay=60.0)
    channel = node.channels[0]
    sensor.publish(msg, expected=1)
    ros.serve_while(lambda: not channel._filter.pending)
    wait_for_thread(node)
    go_on = hold_up(node)
    later = channel._clock.now() + 60 * SECOND
    channel._clock.now = lambda: later  # type: ignore[method-assign]
    for pose in odometry:
        publisher.publish(pose)
    last = nanoseconds(odometry[-1])
    motion = channel._motion
    assert motion is not None
    ros.serve_while(lambda: not motion.reaches(last, ''))
    go_on.set()
    sensor.wait_for_outputs()
    assert node.channels[0].statistics.without_pose == 0


def test_poses_that_come_behind_the_last_cloud(ros: Ros) -> None:
    """At the end poses are received for longer than clouds."""
    drive = Drive(0.2)
    reliable = {'qos_overrides./odom.subscription.reliability': 'reliable'}
    node, sensor, publisher = start(ros, max_delay=60.0, **reliable)
    sensor.publish(drive.clouds(drive.own)[0], expected=1)
    assert sensor._publisher.wait_for_all_acked()
    clouds, destroy = node.channels[0]._clouds, node.destroy_subscription

    def publish_and_destroy(subscription: object) -> bool:
        if subscription is clouds:
            for pose in drive.odometry():
                publisher.publish(pose)
            assert publisher.wait_for_all_acked()
        return bool(destroy(subscription))

    node.destroy_subscription = publish_and_destroy
    node.finish()
    assert node.channels[0].statistics.messages == 1
    assert node.channels[0].statistics.without_pose == 0


def test_replay(tmp_path: Path) -> None:
    """In a replay the odometry comes from the recording: the same verdicts."""
    drive = Drive(0.5)
    bag = write(tmp_path / 'drive', drive)
    report = replay(bag, tmp_path / 'cleaned', parameters=REPLAYED)
    expected = rejected(drive, Moving().run(drive.clouds(drive.own), drive.odometry()))
    assert report.is_complete
    assert report.topics[0].rejected == expected.sum()


def test_replay_by_tf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The poses of the recording's own tf, for each of its sensors: the same verdicts."""
    drive = Drive(0.5)
    bag = write_tf(tmp_path / 'drive', drive, ('/points', '/again'))
    report = replay(bag, tmp_path / 'cleaned', parameters=SOR | {'motion.source': 'tf'})
    expected = rejected(drive, Moving().run(drive.clouds(drive.own), drive.odometry()))
    assert report.is_complete
    assert [topic.rejected for topic in report.topics] == [expected.sum()] * 2
    assert [topic.without_pose for topic in report.topics] == [0, 0]
    lost = tmp_path / 'lost'
    settings = ['--set', 'motion.source=tf', '--set', 'motion.fixed_frame=nowhere']
    assert main(['replay', str(bag), '--output', str(lost), '--chain', 'sor', *settings]) == 0
    said = '5 of 5 clouds of /again have points without poses, which were judged in the frame of'
    assert said in ' '.join(capsys.readouterr().err.split())
    # Where the sensor was is known, too.
    parameters = FilterParameters().changed(SOR | {'motion.source': 'tf'})
    eyes = [one.eye for one in RecordedClouds(bag, parameters, '/points', with_eyes=True)]
    assert all(eye is not None and len(eye) == 10 * SHOTS for eye in eyes)


@pytest.mark.parametrize(
    ('topics', 'parameters', 'sentence'),
    [
        (
            ['/points'],
            {'motion.topic': 'odometry'},
            r"motion.topic must be one of .* /odom, got '/od",
        ),
        (['/points'], {'motion.source': 'tf'}, "'none' or 'odometry' "),
        (['/left', '/right'], {}, "motion.source must be 'none' for several topics, "),
    ],
)
def test_replays_that_cannot_be(
    tmp_path: Path, topics: list[str], parameters: dict[str, object], sentence: str
) -> None:
    """Refused before anything is written."""
    bag = write(tmp_path / 'drive', Drive(0.2), tuple(topics))
    with pytest.raises((ParameterError, RecordingError), match=sentence):
        replay(bag, tmp_path / 'cleaned', parameters=REPLAYED | parameters)
    assert not (tmp_path / 'cleaned').exists()
