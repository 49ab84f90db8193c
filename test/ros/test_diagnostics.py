# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the node says of itself, and what it does only where somebody listens."""

import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from helpers.clouds import SECOND
from helpers.nodes import (
    PLOTTED,
    Diagnosis,
    Ros,
    broken,
    flush,
    line,
    process,
    receive,
    wait_for_thread,
)
from helpers.programs import TIMEOUT
from rclpy.context import Context
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from lidar_outlier_filter.ros.health import ERROR, OK, WARN


def test_diagnostics_say_what_was_done(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """Counts, reasons, rates and times, as the node itself has them, under its name and topic."""
    smoother = ('-p', 'chain:=[alpha_beta_gamma]')
    node = ros.filter('-p', 'max_delay:=0.5', *smoother, namespace='front')
    sensor = ros.sensor(node, '/front/points')
    ros.diagnosis()  # from here on none is missed
    for number, msg in enumerate(sweeps, 1):
        sensor.publish(msg, expected=number)
        sensor.publish(broken(), expected=number)
        sensor.wait_for_outputs()
    counts = node.channels[0].statistics
    history: list[Diagnosis] = []

    def is_all(found: Diagnosis) -> bool:
        history.append(found)
        return found['messages'] == found['refused'] == 4

    found = ros.diagnosis(is_all)
    result = ros.wait_for_message(DiagnosticArray, '/diagnostics', bool)
    age = node.get_clock().now() - Time.from_msg(result.header.stamp)
    assert 0 <= age.nanoseconds < TIMEOUT * SECOND
    assert found.name == 'front/outlier_filter_node: /front/points'
    assert found['points'] == counts.points == sum(msg.width for msg in sweeps)
    assert found['rejected by alpha_beta_gamma'] == counts.outliers == found['outliers'] > 0
    assert found['untested'] == counts.untested
    assert found['invalid'] == counts.invalid
    assert found['refused'] == found['refused for point_step'] == 4
    for name in ('delay since received', 'processing time'):
        for one in history:
            assert one[f'{name}, p50, ms'] <= one[f'{name}, p95, ms'] <= one[f'{name}, max, ms']
        assert max(one[f'{name}, p50, ms'] for one in history) > 0
    # The stamps are of the day that the clouds were recorded.
    assert max(one['delay since stamp, p50, ms'] for one in history) > 1e9


@pytest.mark.slow
def test_once_in_a_second(ros: Ros) -> None:
    """Of real time; silent, then a warning, then an error."""
    node = ros.filter('-p', 'health.silence_warn:=0.0')
    node.start()
    received = [(ros.diagnosis(), time.monotonic())]
    while received[-1][0].level != ERROR:
        received.append((ros.diagnosis(), time.monotonic()))
    times = np.array([at for _, at in received])
    assert np.median(np.diff(times)) == pytest.approx(1.0, abs=0.2)
    assert [found.level for found, _ in received][-2:] == [WARN, ERROR]
    assert received[-2][0].message.startswith('no cloud for ')


def test_statistics_are_a_table(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """A row for the topic, and a column for each value, under its name."""
    node = ros.filter('-p', 'max_delay:=0.5')
    sensor = ros.sensor(node)
    sensor.publish(sweeps[0], expected=1)
    topic = '/outlier_filter_node/statistics'
    table = ros.wait_for_message(Float64MultiArray, topic, lambda table: table.data[0] > 0)
    rows, columns = table.layout.dim
    assert (rows.label, rows.size, rows.stride) == ('points', 1, len(PLOTTED))
    assert (columns.size, columns.stride) == (len(PLOTTED), len(PLOTTED))
    values = dict(zip(columns.label.split(','), table.data, strict=True))
    assert list(values) == list(PLOTTED)
    # One cloud in about a second.
    assert 0.3 < values['clouds_per_second'] <= 1.1
    points = values['points_per_second'] / values['clouds_per_second']
    assert points == pytest.approx(sweeps[0].width)


def test_what_is_disabled_is_said(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """A node that lets everything pass warns of it, until it filters again."""
    node = ros.filter('-p', 'health.silence_warn:=1e5')
    node.start()
    ros.call(SetBool, 'enable', SetBool.Request(data=False))

    def is_disabled(found: Diagnosis) -> bool:
        return 'disabled: clouds pass unfiltered' in found.message

    assert ros.diagnosis(is_disabled).level == WARN
    receive(node.channels[0], sweeps[0])
    assert ros.diagnosis(lambda found: found['messages'] == 1)['unfiltered for disabled'] == 1
    ros.call(SetBool, 'enable', SetBool.Request(data=True))
    assert ros.diagnosis(lambda found: not is_disabled(found)).level == OK


def test_messages_of_another_type_are_named(ros: Ros) -> None:
    """The middleware connects no publisher of another type, and does not say so."""
    ros.filter('-p', 'chain:=[crop_box]').start()
    context = Context()  # in the same one Fast DDS refuses a second type
    rclpy.init(args=[], context=context, domain_id=ros.context.get_domain_id())
    other = rclpy.create_node('other', context=context)
    other.create_publisher(DiagnosticArray, '/points', 1)
    sentence = 'Array is published, sensor_msgs/msg/PointCloud2 is received (input_type)'
    ros.diagnosis(lambda found: sentence in found.message)
    context.try_shutdown()


def test_what_nobody_wants_is_not_made(ros: Ros, sweeps: list[PointCloud2]) -> None:
    """Neither of the clouds is made without a subscriber; all points are judged."""
    node = ros.filter('-p', 'scores:=true')
    (output,) = process(node, sweeps[0]) + flush(node)
    assert output.cleaned is not None
    assert output.outliers is not None
    outliers = node.channels[0].statistics.outliers
    node.start()
    cleaned: list[PointCloud2] = []

    def taken(msg: PointCloud2) -> list[tuple[bool, bool]]:
        made = process(node, msg) + flush(node)
        cleaned.extend(output.cleaned for output in made)
        return [(output.cleaned is not None, output.outliers is not None) for output in made]

    assert taken(sweeps[0]) == [(False, False)]
    assert node.channels[0].statistics.outliers == 2 * outliers > 0
    topic = node.channels[0].publisher.cleaned.topic_name
    ros.client.create_subscription(PointCloud2, topic, cleaned.append, 10)
    ros.serve_while(lambda: not node.channels[0].publisher.cleaned.get_subscription_count())
    assert taken(sweeps[1]) == [(True, False)]
    topic = node.channels[0].publisher.outliers.topic_name
    subscription = ros.client.create_subscription(PointCloud2, topic, cleaned.append, 10)
    ros.serve_while(lambda: not node.channels[0].publisher.outliers.get_subscription_count())
    assert taken(sweeps[2]) == [(True, True)]
    ros.client.destroy_subscription(subscription)
    ros.serve_while(node.channels[0].publisher.outliers.get_subscription_count)
    assert taken(sweeps[3]) == [(True, False)]


def test_the_size_that_a_refused_cloud_claims(ros: Ros) -> None:
    """Points are counted by the bytes that came."""
    node = ros.filter('-p', 'chain:=[alpha_beta_gamma]')
    node.start()
    node._diagnostics._timer.cancel()
    msg = line(0.0)
    msg.height = msg.width = 2**31
    receive(node.channels[0], msg)
    wait_for_thread(node)
    assert node.channels[0].statistics.refused == 1
    assert node.channels[0].sample(1.0).values['points/s'] == '100'
