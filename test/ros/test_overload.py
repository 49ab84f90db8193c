# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A node that is given more than it can filter, with the real middleware."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from helpers.nodes import Ros, hold_up, line, wait_for_thread
from helpers.overload import results, send, start
from helpers.programs import TIMEOUT
from rclpy.serialization import serialize_message

from lidar_outlier_filter.ros.backlog import Treatment
from lidar_outlier_filter.ros.node import OutlierFilterNode


@contextmanager
def held_up(node: OutlierFilterNode) -> Iterator[None]:
    """Hold up the thread that filters for a while."""
    go_on = hold_up(node)
    yield
    go_on.set()
    wait_for_thread(node)


def test_what_waits_is_reported(ros: Ros) -> None:
    """Clouds and bytes to be filtered, clouds without output, who publishes, what is done."""
    node, sensor = start(ros, block=0.1)
    channel = node.channels[0]
    send(ros, node, sensor, 1)
    wait_for_thread(node)
    with held_up(node):
        send(ros, node, sensor, 3, first=1)
        plotted = channel.sample(2.0).plotted
    assert plotted['clouds_per_second'] == 2
    assert plotted['points_per_second'] == 50  # those of one cloud were read
    assert plotted['backlog_clouds'] == 3
    assert plotted['backlog_megabytes'] == pytest.approx(3e-6 * len(serialize_message(line(0.0))))
    assert plotted['waiting_clouds'] == 1
    channel.worker._overload.treatment = Treatment.DEGRADE
    message = channel.sample(3.0).message
    assert 'no cloud for 3 s, publishers: 1 (' in message
    assert 'overload: clouds are filtered by alpha_beta_gamma alone' in message


def test_drop_oldest(ros: Ros) -> None:
    """What does not fit is dropped, the oldest first, and counted; the rest is filtered."""
    node, sensor = start(ros)
    with held_up(node):
        send(ros, node, sensor, 25)
        assert node.channels[0].waiting == 10
    node.finish()
    assert results(ros, sensor, 10) == [(number, 1) for number in range(15, 25)]
    assert node.channels[0].statistics.messages == 10
    assert node.channels[0].health._missed['dropped'] == 15


@pytest.mark.parametrize(
    ('policy', 'lost'),
    [('drop_oldest', '15 dropped'), ('pass_through', '15 dropped, 9 passed unfiltered')],
)
def test_losses_are_in_the_log(
    ros: Ros, capfd: pytest.CaptureFixture[str], policy: str, lost: str
) -> None:
    """A line at the end names the policy and counts clouds after the last sample."""
    node, sensor = start(ros, load__policy=policy)
    with held_up(node):
        send(ros, node, sensor, 25)
    node.finish()
    said = [line for line in capfd.readouterr().err.splitlines() if 'not filtered fully' in line]
    (line_,) = said
    assert line_.endswith(f'since the last warning: {lost} (load.policy is {policy})')
    assert '/points: ' in line_


def test_what_has_waited_too_long_is_dropped(ros: Ros) -> None:
    """Also where there is room: it could not be published within max_delay."""
    node, sensor = start(ros, max_delay=0.4, load__clouds=100)
    with held_up(node):
        send(ros, node, sensor, 20)
        clock = node.channels[0]._clock
        oldest = node.channels[0].worker.inbox._items[18].at  # type: ignore[union-attr]
        while clock.now() - oldest < 0.4e9:
            ros.executor.spin_once(0.05)
    node.finish()
    # The newest is filtered: nothing is gained by dropping it.
    assert results(ros, sensor, 1) == [(19, 1)]
    assert node.channels[0].health._missed['dropped'] == 19


def test_pass_through(ros: Ros) -> None:
    """From half of the queue on clouds pass unfiltered, in order, until nothing waits."""
    node, sensor = start(ros, load__policy='pass_through')
    with held_up(node):
        send(ros, node, sensor, 9)
    send(ros, node, sensor, 3, first=9)
    node.finish()
    expected = [0] * 8 + [1] * 4  # behind the ninth nothing waits
    assert results(ros, sensor, 12) == list(enumerate(expected))
    assert node.channels[0].statistics.bypassed == {'overload': 8}
    assert [msg.width for msg in sensor.cleaned[:8]] == [100] * 8


def test_what_passes_waits_for_nobody(ros: Ros) -> None:
    """Clouds before it are published at once: their blocks would not be complete soon."""
    node, sensor = start(ros, load__policy='pass_through', block=0.1, max_delay=60.0)
    send(ros, node, sensor, 1)
    wait_for_thread(node)
    assert node.channels[0].waiting == 1
    with held_up(node):
        send(ros, node, sensor, 9, first=1)
    # Behind the last one nothing waits: it is filtered.
    assert (node.channels[0].statistics.messages, node.channels[0].waiting) == (9, 1)
    assert node.channels[0].statistics.bypassed == {'overload': 8}


def test_degrade(ros: Ros) -> None:
    """The slow detectors are off while there is too much; each cloud is tested along its line."""
    node, sensor = start(
        ros, chain=['alpha_beta_gamma', 'sor'], load__policy='degrade', sor__multiplier=0.0
    )
    with held_up(node):
        send(ros, node, sensor, 7)
    send(ros, node, sensor, 3, first=7)
    wait_for_thread(node)
    node.finish()
    # A cloud is judged with the next one, and behind the seventh nothing waits; with this
    # multiplier sor rejects many.
    found = [width > 10 for _, width in results(ros, sensor, 10)]
    assert found == [False] * 5 + [True] * 5
    assert [width for _, width in results(ros, sensor, 10)][:5] == [1] * 5
    assert node.channels[0].statistics.degraded == 6


@pytest.mark.parametrize(
    'parameters',
    [
        {'chain': ['boosted_trees']},
        {'chain': ['sor']},
        {'chain': ['alpha_beta_gamma', 'sor'], 'vote': 2},
    ],
)
def test_nothing_to_degrade(ros: Ros, parameters: dict[str, object]) -> None:
    """Where the smoother alone could reject nothing, degraded clouds pass unfiltered."""
    node, sensor = start(ros, load__policy='degrade', **parameters)
    with held_up(node):
        send(ros, node, sensor, 7)
    node.finish()
    assert node.channels[0].statistics.bypassed == {'overload': 6}
    assert node.channels[0].statistics.degraded == 0


def test_the_policy_can_be_set(ros: Ros) -> None:
    """While it is too much."""
    node, sensor = start(ros)
    with held_up(node):
        send(ros, node, sensor, 9)
        assert ros.set(load__policy='pass_through', load__clouds=8) == ['', '']
        send(ros, node, sensor, 1, first=9)
    node.finish()
    assert node.channels[0].health._missed['dropped'] == 2
    assert node.channels[0].statistics.bypassed == {'overload': 7}


def test_the_end_of_the_thread_is_heard_of(ros: Ros) -> None:
    """An error that nobody foresaw ends the process, not the filtering alone."""
    node, sensor = start(ros)
    node.channels[0].worker.inbox.order(lambda: 1 / 0)
    thread = node.channels[0].worker._thread
    assert thread is not None
    thread.join(TIMEOUT)
    sensor.publish(line(0), expected=1)
    with pytest.raises(ZeroDivisionError):
        send(ros, node, sensor, 1)
