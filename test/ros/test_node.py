# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The node inside this process, with the real rclpy and the real middleware."""

import re
import threading
import time

import pytest
from helpers.clouds import SECOND
from helpers.nodes import (
    NO_CLOUD,
    Ros,
    broken,
    flush,
    line,
    process,
    rejected,
    wait_for_thread,
)
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.ros import node as node_module
from lidar_outlier_filter.ros.node import OutlierFilterNode, remappings

# The default rejects next to nothing of a clean recording.
STRICT = {'boosted_trees.threshold': 0.5}


@pytest.mark.parametrize(
    ('topic', 'namespace', 'full'),
    [
        (None, '', '/points'),
        ('/velodyne_points', '', '/velodyne_points'),
        ('velodyne_points', 'left', '/left/velodyne_points'),
        ('/top/points', 'left', '/top/points'),
    ],
)
def test_names_of_topics(ros: Ros, topic: str | None, namespace: str, full: str) -> None:
    """The outputs are named after the input."""
    node = ros.filter(input_topic=topic, namespace=namespace)
    node.start()
    assert full in [item.topic_name for item in node.subscriptions]
    assert node.channels[0].publisher.cleaned.topic_name == f'{full}/cleaned'
    assert node.channels[0].publisher.outliers.topic_name == f'{full}/outliers'


@pytest.mark.parametrize(
    ('rules', 'cleaned'),
    [
        (['points:=/velodyne_points'], '/velodyne_points/cleaned'),
        (['points:=top', '__ns:=/car'], '/car/top/cleaned'),
        (['points:=/top', 'points/cleaned:=/kept'], '/kept'),
        (['points:=/top', '/top/cleaned:=/kept'], '/kept'),
        (['points/cleaned:=/kept'], '/kept'),
        (['~/input:=/top', '~/output:=/kept'], '/kept'),
        (['inputs:=[~/input]', '~/input:=/top', '~/input/cleaned:=/kept'], '/kept'),
    ],
)
def test_outputs_follow_a_remapped_input(ros: Ros, rules: list[str], cleaned: str) -> None:
    """Two nodes on two inputs do not share outputs; a rule for an output itself comes first."""
    options = ['-p' if rule.startswith('inputs') else '-r' for rule in rules]
    node = ros.filter(*[word for pair in zip(options, rules, strict=True) for word in pair])
    node.start()
    publisher = node.channels[0].publisher
    assert publisher.cleaned.topic_name == cleaned
    assert publisher.outliers.topic_name == f'{node.channels[0].resolved}/outliers'


@pytest.mark.parametrize('topic', ['', '/', 'velodyne points', '/a//b', '/points/'])
def test_impossible_topics(ros: Ros, topic: str) -> None:
    """Names that ROS does not allow are refused in a sentence."""
    sentence = f'input_topic must be a topic name that ROS 2 allows, got {topic!r}'
    with pytest.raises(ParameterError, match=re.escape(sentence)):
        remappings(topic)
    with pytest.raises(ParameterError, match='input_topic must be'):
        ros.filter(input_topic=topic)


@pytest.mark.parametrize(
    ('parameters', 'blocks', 'threads'),
    [
        ({'block': 0.25, 'threads': 3}, 'blocks time (0.25 s)', '3'),
        ({'blocks': 'message'}, 'blocks message', str(cores())),
    ],
)
def test_says_once_that_it_is_ready(
    ros: Ros,
    capfd: pytest.CaptureFixture[str],
    parameters: dict[str, object],
    blocks: str,
    threads: str,
) -> None:
    """One line at the start: version, inputs, outputs, chain, blocks, threads."""
    names = {'inputs': ['left/points', '/right'], 'chain': ['alpha_beta_gamma', 'lof']}
    node = ros.filter('-r', '__ns:=/car', parameters=names | parameters)
    assert 'ready' not in capfd.readouterr().err
    node.start()
    expected = (
        f'version {__version__} is ready: '
        '/car/left/points to /car/left/points/cleaned and /car/left/points/outliers, '
        '/right to /right/cleaned and /right/outliers; '
        f'chain alpha_beta_gamma, lof; {blocks}; threads {threads}\n'
    )
    said = capfd.readouterr().err
    assert said.endswith(expected)
    assert said.count('ready') == 1


def test_refusals_are_logged_at_a_bounded_rate(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    """A sensor that sends nonsense at 20 Hz does not fill the log."""
    node = ros.filter()
    for _ in range(20):
        assert process(node, broken()) == []
    assert node.channels[0].statistics.refused == 20
    said = capfd.readouterr().err
    assert said.count('refused a cloud') == 1
    assert 'refused a cloud (1 so far): point_step must be at least 4, the end of field' in said


def test_no_cloud_waits_longer_than_max_delay(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """A live cloud whose block never completes is published in time; the stream goes on."""
    node = ros.filter('-p', 'max_delay:=0.3')
    sensor = ros.sensor(node)
    waits = []
    for number, msg in enumerate(sweeps, 1):
        begin = time.monotonic()
        sensor.publish(msg, expected=number)
        waits.append(sensor.wait_for_outputs() - begin)
    # A loaded machine may hold this process up for a while, but hardly each time.
    assert min(waits) < 0.3
    assert max(waits) < 2.0
    assert node.channels[0].statistics.refused == 0
    for msg, cleaned, outliers in zip(sweeps, sensor.cleaned, sensor.outliers, strict=True):
        assert cleaned.header == outliers.header == msg.header
        assert cleaned.width + outliers.width == msg.width


def test_the_cloud_that_has_waited_longest_counts(ros: Ros) -> None:
    """Clouds that come while others wait do not put the deadline off, whatever is refused."""
    node = ros.filter('-p', 'max_delay:=60.0')
    sensor = ros.sensor(node)
    channel = node.channels[0]

    def deadline_after(msg: PointCloud2 | bytes) -> int:
        """Publish, serve until the cloud was received, and return when it is due (ns)."""
        served = node.channels[0].statistics.refused + node.channels[0].waiting
        sensor.publish(msg, expected=99)
        while node.channels[0].statistics.refused + node.channels[0].waiting == served:
            ros.executor.spin_once(0.05)
        wait_for_thread(node)
        assert channel.worker._due is not None
        return channel.worker._due

    first = deadline_after(line(0.0))
    left = (first - channel._clock.now()) / SECOND
    assert left == pytest.approx(54, abs=1)
    for msg in (line(0.02), broken(), NO_CLOUD, line(0.04)):
        assert deadline_after(msg) == first


def test_finish_serves_what_was_received(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """Clouds that are in the queue of the middleware are judged and published before the end.

    By the default chain; published clouds equal those of a direct call.
    """
    direct = ros.filter(namespace='direct', parameters=STRICT)
    expected = [result for msg in sweeps for result in process(direct, msg)] + flush(direct)
    reliable = 'qos_overrides./points.subscription.reliability:=reliable'
    node = ros.filter('-p', reliable, parameters=STRICT)
    sensor = ros.sensor(node)
    for msg in (NO_CLOUD, *sweeps):
        sensor.publish(msg, expected=4)
    assert sensor._publisher.wait_for_all_acked()
    assert node.channels[0].statistics.messages == 0
    node.finish()
    sensor.wait_for_outputs()
    assert node.channels[0].statistics.messages == 4
    assert node.channels[0].statistics.refusals == {'a serialised cloud': 1}
    assert sensor.cleaned == [result.cleaned for result in expected]
    assert sensor.outliers == [result.outliers for result in expected]
    assert sum(rejected(expected)) > 50


def test_no_executor_serves_a_node_that_is_destroyed(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It lets go of the node first: the middleware calls it from threads of its own."""
    node = OutlierFilterNode(context=ros.context)
    node.start()
    executor = node_module._executor(ros.context)
    monkeypatch.setattr(node_module, '_executor', lambda _: executor)
    destroy = node.destroy_node
    served: list[object] = []

    def note_and_destroy() -> None:
        served.append(list(executor.get_nodes()))
        destroy()

    monkeypatch.setattr(node, 'destroy_node', note_and_destroy)
    stop = threading.Event()
    stop.set()
    node_module._serve(node, stop)
    assert served == [[]]
