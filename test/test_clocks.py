# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated time: a clock that is slow, that jumps, that stops, and that is another."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from clouds import SECOND, STAMP
from nodes import Ros, Sensor, line, wait_for_thread
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from lidar_outlier_filter.ros.node import OutlierFilterNode

# Chain that tells the outlier of 10 ms of a line that is alone.
SMOOTHER = ('-p', 'chain:=[alpha_beta_gamma]')


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
        while simulated and not self._clock.get_subscription_count():
            ros.executor.spin_once(0.05)
        self.sent = 0

    def tell(self, seconds: float) -> None:
        """Tell the time, after the beginning, and serve until the node has it."""
        now = STAMP + round(seconds * SECOND)
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = divmod(now, SECOND)
        self._clock.publish(msg)
        while self.node.get_clock().now().nanoseconds != now:
            self.ros.executor.spin_once(0.05)
        wait_for_thread(self.node)

    def send(self, seconds: float) -> None:
        """Send 10 ms of a line, and serve until the node has filtered or keeps it."""
        self.sent += 1
        self.sensor.publish(line(seconds), expected=10**9)
        while self.node.waiting + self.node.statistics.messages < self.sent:
            self.ros.executor.spin_once(0.05)
        wait_for_thread(self.node)

    def answered(self) -> int:
        """Count the clouds that were answered."""
        wait_for_thread(self.node)
        return self.node.statistics.messages

    def stop_the_clock(self) -> None:
        """End the program that tells the time."""
        self.ros.client.destroy_publisher(self._clock)


def test_a_recording_played_slowly_hurries_nobody(ros: Ros) -> None:
    """Simulated time counts: until max_delay is over on /clock, a cloud waits for its block."""
    player = Player(ros, '-p', 'max_delay:=0.4')
    player.tell(0.0)
    player.send(0.0)
    began = time.monotonic()
    seconds = 0.0
    while time.monotonic() < began + 0.5:
        seconds += 0.001
        player.tell(min(seconds, 0.19))  # half of max_delay is kept for the verdict, at most
        assert player.answered() == 0
    player.tell(0.37)
    player.tell(0.371)  # the thread was woken by the one before
    assert player.answered() == 1
    assert player.node.statistics.outliers == 1


def test_delay_and_age_of_a_cloud(ros: Ros) -> None:
    """The delay counts from when it was received, the age from its stamp, by the same clock."""
    player = Player(ros, '-p', 'max_delay:=60.0')
    player.node._diagnostics._timer.cancel()
    player.tell(0.25)
    player.send(0.137)
    player.tell(0.75)
    player.send(5.0)
    assert player.answered() == 1
    tally = player.node.channels[0].health._tally
    assert tally.delays == pytest.approx([0.5], abs=1e-6)
    assert tally.ages == pytest.approx([0.75 - 0.137], abs=1e-6)


def test_without_simulated_time_real_time_counts(ros: Ros) -> None:
    """Whatever somebody tells on /clock."""
    player = Player(ros, '-p', 'max_delay:=0.3', simulated=False)
    player.send(0.0)
    while not player.answered():
        ros.executor.spin_once(0.05)


def test_back_to_the_beginning(ros: Ros) -> None:
    """A recording that loops: what waits is answered, the stream begins anew; counted once."""
    player = Player(ros, '-p', 'max_delay:=5.0')
    for _ in range(3):
        player.tell(0.0)
        player.send(0.0)
        player.tell(10.0)
        player.send(10.0)
    assert player.answered() == 5
    assert player.node.statistics.resets == 2
    assert player.node.statistics.refused == 0
    player.node.finish()
    assert player.node.statistics.messages == 6
    assert player.node.statistics.rejected == {'alpha_beta_gamma': 6}


def test_clouds_that_come_before_the_clock_goes_back(ros: Ros) -> None:
    """The first clouds of the next loop may overtake its clock: they stay with those after them."""
    player = Player(ros, '-p', 'max_delay:=5.0')
    player.tell(10.0)
    player.send(10.0)
    player.send(0.0)  # the sensor's clock goes back
    assert (player.answered(), player.node.statistics.resets) == (1, 1)
    player.tell(0.0)
    player.send(0.01)
    assert (player.answered(), player.node.statistics.resets) == (1, 1)
    player.send(0.2)
    assert player.answered() == 3


def test_a_jump_ahead(ros: Ros) -> None:
    """What waits is answered: it has waited too long; what comes is another segment."""
    player = Player(ros, '-p', 'max_delay:=0.5')
    player.tell(0.0)
    player.send(0.0)
    player.tell(1000.0)
    player.tell(1000.001)
    assert player.answered() == 1
    player.send(1000.0)
    player.send(1000.2)
    assert player.answered() == 2
    assert player.node.statistics.rejected == {'alpha_beta_gamma': 2}
    assert player.node.statistics.resets == 0


def test_the_clock_ends(ros: Ros) -> None:
    """At the end of a recording nothing can come any more: all is answered, and the node warns."""
    player = Player(ros, '-p', 'max_delay:=5.0')
    player.tell(0.0)
    player.send(0.0)
    player.stop_the_clock()
    found = ros.diagnosis(lambda found: found['messages'] == 1)
    assert 'use_sim_time is set and nobody publishes /clock' in found.message
    assert player.node.statistics.outliers == 1


@pytest.mark.parametrize('simulated', [False, True])
def test_another_clock(ros: Ros, *, simulated: bool) -> None:
    """What waits by one clock is answered when another is set; then that one counts."""
    player = Player(ros, '-p', 'max_delay:=5.0', simulated=simulated)
    if simulated:
        player.tell(0.0)
    player.send(0.0)
    player.node.set_parameters([Parameter('use_sim_time', value=not simulated)])
    assert player.answered() == 1
    assert player.node.channels[0]._clock.is_simulated != simulated
    player.send(0.3)
    assert player.answered() == 1
