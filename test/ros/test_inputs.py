# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Several sensors: one process that serves them all, each as a stream of its own."""

import pytest
from helpers.nodes import PLOTTED, Ros, Sensor, broken, line, receive
from helpers.programs import TIMEOUT
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from lidar_outlier_filter.ros.health import WARN

BOTH = {
    'inputs': ['/left/points', 'right'],
    'chain': ['alpha_beta_gamma'],
    'line_source': 'message',
    'block': 0.01,
    'halo': 0.0,
    'max_delay': 60.0,
}


def test_each_has_its_own_stream(ros: Ros) -> None:
    """Clouds of one neither complete nor refuse those of the other; outputs go to their topics."""
    node = ros.filter(namespace='front', parameters=BOTH)
    node.start()
    node._diagnostics._timer.cancel()
    sensors = [Sensor(ros, '/left/points'), Sensor(ros, '/front/right')]
    assert [channel.resolved for channel in node.channels] == ['/left/points', '/front/right']
    for sensor, channel in zip(sensors, node.channels, strict=True):
        sensor.wait_for_filter(channel)
    # The right one is an hour behind, and sends nonsense.
    for number in range(4):
        for sensor, channel, msg in (
            (sensors[0], node.channels[0], line(3600 + 0.01 * number)),
            (sensors[1], node.channels[1], line(0.01 * number)),
            (sensors[1], node.channels[1], broken()),
        ):
            received = channel.health._tally.clouds
            sensor.publish(msg, expected=3)
            while channel.health._tally.clouds == received:
                ros.executor.spin_once(0.05)
    for sensor in sensors:
        sensor.wait_for_outputs()
        assert [msg.width for msg in sensor.outliers] == [1, 1, 1]
    # The last cloud may still wait to be refused.
    ros.serve_while(lambda: node.channels[1].statistics.refused < 4)
    assert [channel.statistics.resets for channel in node.channels] == [0, 0]
    assert [channel.statistics.refused for channel in node.channels] == [0, 4]
    node.finish()
    assert [channel.statistics.messages for channel in node.channels] == [4, 4]


def test_the_end_of_one_is_not_that_of_the_others(ros: Ros) -> None:
    """Where the thread of one has failed, the others publish what they have received."""
    node = ros.filter(parameters=BOTH)
    node.start()
    node.channels[0].worker.inbox.order(lambda: 1 / 0)
    thread = node.channels[0].worker._thread
    assert thread is not None
    thread.join(TIMEOUT)
    receive(node.channels[1], line(0.0))
    with pytest.raises(ZeroDivisionError):
        node.finish()
    assert node.channels[1].statistics.messages == 1


def test_parameters_and_services_are_for_all(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """One set, one switch."""
    node = ros.filter(parameters=BOTH)
    node.start()
    assert ros.set(alpha_beta_gamma__sigma=100.0) == ['']
    for channel in node.channels:
        receive(channel, sweeps[0])
    ros.call(SetBool, 'enable', SetBool.Request(data=False))
    for channel in node.channels:
        receive(channel, sweeps[1])
    node.finish()
    for channel in node.channels:
        assert channel.statistics.outliers == 0
        assert channel.statistics.bypassed == {'disabled': 1}


def test_each_has_a_row_of_the_table(ros: Ros) -> None:
    """Under the name of its topic."""
    ros.filter(parameters=BOTH).start()
    table = ros.wait_for_message(Float64MultiArray, '/outlier_filter_node/statistics', bool)
    rows, _ = table.layout.dim
    assert (rows.label, rows.size) == ('/left/points,right', 2)
    assert len(table.data) == rows.stride == 2 * len(PLOTTED)


def test_a_topic_given_by_the_caller_is_the_only_one(ros: Ros) -> None:
    """As in a replay, whatever the parameter file says."""
    node = ros.filter(input_topic='/top', parameters=BOTH)
    assert [channel.resolved for channel in node.channels] == ['/top']


def test_two_nodes_on_one_input(ros: Ros) -> None:
    """They would publish on the same topics: the diagnostics warn of it."""
    for _ in range(2):
        ros.filter('-p', 'chain:=[alpha_beta_gamma]').start()
    sentence = '2 publishers on /points/cleaned: another node has the same outputs'
    assert ros.diagnosis(lambda found: sentence in found.message).level >= WARN


def test_overrides_for_topics_of_nobody(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    """The quality of service follows the remapped topic; a key for another is warned of."""
    wrong = 'qos_overrides./points.subscription.reliability'
    right = wrong.replace('/points', '/velodyne_points')
    for name in (wrong, right):
        node = ros.filter('-r', 'points:=/velodyne_points', '-p', f'{name}:=reliable')
        node.start()
        warned = f'{wrong} has no effect: no such topic or setting; did you mean {right}?'
        assert (warned in capfd.readouterr().err) == (name == wrong)
