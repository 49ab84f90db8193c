# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated time: a clock that is slow, that jumps, that stops, and that is another."""

import time

import pytest
from helpers.clouds import SECOND, STAMP
from helpers.nodes import Ros, Sensor, hold_up, line, wait_for_thread
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from lidar_outlier_filter.ros.backlog import Received
from lidar_outlier_filter.ros.node import OutlierFilterNode

# Chain that says the outlier of 10 ms of a line that is alone.
SMOOTHER = ('-p', 'chain:=[alpha_beta_gamma]', '-p', 'line_source:=message')


class Player:
    """What plays a recording: a clock and a sensor."""

    def __init__(self, ros: Ros, *arguments: str, simulated: bool = True) -> None:
        self.ros = ros
        self.node: OutlierFilterNode = ros.filter(
            '-p', f'use_sim_time:={str(simulated).lower()}', *SMOOTHER, *arguments
        )
        self.node.start()
        self._clock: Publisher = ros.client.create_publisher(Clock, '/clock', 10)
        self.sensor = Sensor(ros, '/points')
        self.sensor.wait_for_filter(self.node)
        ros.serve_while(lambda: simulated and not self._clock.get_subscription_count())
        self.sent = 0

    def set(self, seconds: float) -> None:
        """Publish a time, after the beginning; serve until the node and its thread have it."""
        self.set_node(seconds)
        wait_for_thread(self.node)

    def set_node(self, seconds: float) -> None:
        """Publish a time, and serve until the node has it."""
        now = STAMP + round(seconds * SECOND)
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = divmod(now, SECOND)
        self._clock.publish(msg)
        self.ros.serve_while(lambda: self.node.get_clock().now().nanoseconds != now)

    def send(self, seconds: float) -> None:
        """Send 10 ms of a line, and serve until the node has filtered or keeps it."""
        self.sent += 1
        self.sensor.publish(line(seconds), expected=10**9)
        while self.node.channels[0].waiting + self.node.channels[0].statistics.messages < self.sent:
            self.ros.executor.spin_once(0.05)
        wait_for_thread(self.node)

    def published(self) -> int:
        """Count the clouds that were published."""
        wait_for_thread(self.node)
        return self.node.channels[0].statistics.messages

    def stop_the_clock(self) -> None:
        """End the program that says the time."""
        self.ros.client.destroy_publisher(self._clock)


def test_a_recording_played_slowly_flushes_nothing_early(ros: Ros) -> None:
    """Simulated time counts: until max_delay is over on /clock, a cloud waits for its block."""
    player = Player(ros, '-p', 'max_delay:=0.4')
    player.set(0.0)
    player.send(0.0)
    began = time.monotonic()
    seconds = 0.0
    while time.monotonic() < began + 0.5:
        seconds += 0.001
        player.set(min(seconds, 0.19))  # half of max_delay is kept for the verdict, at most
        assert player.published() == 0
    player.set(0.37)
    player.set(0.371)  # the thread was woken by the one before
    assert player.published() == 1
    assert player.node.channels[0].statistics.outliers == 1


def test_delay_and_age_of_a_cloud(ros: Ros) -> None:
    """The delay counts from when it was received, the age from its stamp, by the same clock."""
    player = Player(ros, '-p', 'max_delay:=60.0')
    player.node._diagnostics._timer.cancel()
    player.set(0.25)
    player.send(0.137)
    player.set(0.75)
    player.send(5.0)
    assert player.published() == 1
    tally = player.node.channels[0].health._tally
    assert tally.delays == pytest.approx([0.5], abs=1e-6)
    assert tally.ages == pytest.approx([0.75 - 0.137], abs=1e-6)


def test_back_to_the_beginning(ros: Ros) -> None:
    """A recording that loops: pending clouds are published, the stream is reset; counted once."""
    player = Player(ros, '-p', 'max_delay:=5.0')
    for _ in range(3):
        player.set(0.0)
        player.send(0.0)
        player.set(10.0)
        player.send(10.0)
    assert player.published() == 5
    assert player.node.channels[0].statistics.resets == 2
    assert player.node.channels[0].statistics.refused == 0
    player.node.finish()
    assert player.node.channels[0].statistics.messages == 6
    assert player.node.channels[0].statistics.rejected == {'alpha_beta_gamma': 6}


def test_clouds_that_come_before_the_clock_goes_back(ros: Ros) -> None:
    """The first clouds of the next loop may overtake its clock: they stay with those after them."""
    player = Player(ros, '-p', 'max_delay:=5.0')
    player.set(10.0)
    player.send(10.0)
    player.send(0.0)  # the sensor's clock goes back
    assert (player.published(), player.node.channels[0].statistics.resets) == (1, 1)
    player.set(0.0)
    player.send(0.01)
    assert (player.published(), player.node.channels[0].statistics.resets) == (1, 1)
    player.send(0.2)
    assert player.published() == 3


def test_clouds_that_wait_while_the_clock_goes_back(ros: Ros) -> None:
    """The new beginning comes in its turn among them, and they were received by the new clock."""
    player = Player(ros, '-p', 'max_delay:=60.0')
    inbox = player.node.channels[0].worker.inbox
    player.set(10.0)
    go_on = hold_up(player.node)
    for seconds in (10.0, 0.0):
        player.set_node(seconds)
        player.sensor.publish(line(seconds), expected=10**9)
        clouds = inbox.clouds
        while inbox.clouds == clouds:
            ros.executor.spin_once(0.05)
    received = [item.at - STAMP for item in inbox._items if isinstance(item, Received)]
    assert received == [0, 0]
    go_on.set()
    assert (player.published(), player.node.channels[0].statistics.resets) == (1, 1)


def test_the_thread_is_woken_when_a_cloud_has_waited_enough(ros: Ros) -> None:
    """By the clock alone, and not before."""
    player = Player(ros, '-p', 'max_delay:=10.0')
    inbox = player.node.channels[0].worker.inbox
    player.set(0.0)
    player.send(0.0)
    woken: list[int] = []
    wake = inbox.wake

    def note() -> None:
        woken.append(player.node.get_clock().now().nanoseconds - STAMP)
        wake()

    inbox.wake = note  # type: ignore[method-assign]
    for seconds in (1.0, 4.0, 9.5):
        player.set_node(seconds)
    ros.serve_while(lambda: not player.node.channels[0].statistics.messages)
    assert woken == [9_500_000_000]


def test_a_clock_that_goes_back_twice_at_once(ros: Ros) -> None:
    """Within time_jump of real time that is one new beginning."""
    player = Player(ros)
    clock = player.node.channels[0]._clock
    now = clock.steady_now()
    clock.steady_now = lambda: now  # type: ignore[method-assign]
    for resets, seconds in ((0, 10.0), (1, 0.0), (1, 10.0), (1, 0.0)):
        player.set(seconds)
        assert player.published() == 0
        assert player.node.channels[0].statistics.resets == resets
    now += 60 * SECOND
    player.set(-1.0)
    player.published()
    assert player.node.channels[0].statistics.resets == 2


def test_the_clock_ends(ros: Ros) -> None:
    """At the end of a recording no more clouds can come: all are published, and the node warns."""
    player = Player(ros, '-p', 'max_delay:=5.0')
    player.set(0.0)
    player.send(0.0)
    player.stop_the_clock()
    found = ros.diagnosis(lambda found: found['messages'] == 1)
    assert 'use_sim_time is set but /clock is not published' in found.message
    assert player.node.channels[0].statistics.outliers == 1


@pytest.mark.parametrize('simulated', [False, True])
def test_another_clock(ros: Ros, *, simulated: bool) -> None:
    """Clouds timed by the previous clock are published when another is set, which then counts."""
    player = Player(ros, '-p', 'max_delay:=5.0', simulated=simulated)
    if simulated:
        player.set(0.0)
    player.send(0.0)
    player.node.set_parameters([Parameter('use_sim_time', value=not simulated)])
    assert player.published() == 1
    assert player.node.channels[0]._clock.is_simulated != simulated
    player.send(0.3)
    assert player.published() == 1
