# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The clock that ``max_delay`` runs on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockChange, ClockType, JumpThreshold
from rclpy.duration import Duration

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.clock import TimeJump
    from rclpy.node import Node

SMALLEST = Duration(nanoseconds=1)
BACK = Duration(nanoseconds=-1)


class DelayClock:
    """A steady clock; under ``use_sim_time`` that of ``/clock``.

    A recording that is played slowly, or that pauses, hurries nobody then.
    """

    def __init__(self, node: Node) -> None:
        """Take the clock of the node."""
        self._node = node
        self._ros = node.get_clock()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    @property
    def is_simulated(self) -> bool:
        """Whether time comes from ``/clock``."""
        return bool(self._ros.ros_time_is_active)

    @property
    def has_stopped(self) -> bool:
        """Whether time comes from ``/clock``, and nobody says it any more, or yet."""
        return self.is_simulated and self._node.count_publishers('/clock') == 0

    def now(self) -> int:
        """Return the time, nanoseconds."""
        clock = self._ros if self.is_simulated else self._steady
        return int(clock.now().nanoseconds)

    def ros_now(self) -> int:
        """Return the time that stamps are compared with, nanoseconds."""
        return int(self._ros.now().nanoseconds)

    def steady_now(self) -> int:
        """Return the time of a clock that nobody sets, nanoseconds."""
        return int(self._steady.now().nanoseconds)

    def watch(
        self,
        went_on: Callable[[], object],
        went_back: Callable[[], object],
        changed: Callable[[], object],
    ) -> None:
        """Call back when simulated time goes on, goes back, or is another than before.

        It is another when ``use_sim_time`` is set, and when ``/clock`` says it for the first time.
        """

        def jumped(jump: TimeJump) -> None:
            delta = jump.delta.nanoseconds
            if jump.clock_change in {
                ClockChange.ROS_TIME_ACTIVATED,
                ClockChange.ROS_TIME_DEACTIVATED,
            }:
                changed()
            elif delta < 0:
                went_back()
            elif delta == self._ros.now().nanoseconds:  # from 0: there was no time before
                changed()
            else:
                went_on()

        threshold = JumpThreshold(min_forward=SMALLEST, min_backward=BACK, on_clock_change=True)
        self._watched = self._ros.create_jump_callback(threshold, post_callback=jumped)

    def stop(self) -> None:
        """Call nobody back any more."""
        self._watched.unregister()
