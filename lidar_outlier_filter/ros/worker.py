# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The thread that filters the clouds of one topic and publishes them, and its clock."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from time import perf_counter
from typing import Any

from rclpy.clock import Clock, ClockChange, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud
from lidar_outlier_filter.ros.backlog import Inbox, Overload, Received, Treatment
from lidar_outlier_filter.ros.endpoints import SplitCloudPublisher, read_cloud
from lidar_outlier_filter.ros.health import DROPPED, Health

# What ~/state says of the clouds on `cleaned`, with a reason
UNFILTERED, FILTERED = 'unfiltered: ', Treatment.FILTER.value
OVERLOAD, DISABLED = 'overload', 'disabled'
SMALLEST, BACK = Duration(nanoseconds=1), Duration(nanoseconds=-1)


class Worker:
    """Filters, passes or drops the clouds of its inbox, by load policy, and publishes in order.

    Before ``start`` there is no thread, and commands run at once.
    """

    def __init__(
        self,
        filter_: Pipeline,
        publisher: SplitCloudPublisher,
        clock: DelayClock,
        health: Health,
        parameters: FilterParameters,
    ) -> None:
        self.inbox = Inbox(parameters.load)
        self.clock = clock
        self.enabled = True
        self.read: Callable[[bytes], Any] = read_cloud
        self._filter = filter_
        self._publisher = publisher
        self._health = health
        self._parameters = parameters
        self.overload = Overload()
        self._due: int | None = None  # when the cloud that waits longest must be published, ns
        self._set_back_at = -(2**62)  # when the sensor's or the node's clock was, steady ns
        self._failure: BaseException | None = None
        self._thread: threading.Thread | None = None
        self._state = ''  # published last
        self._taken: Received | None = None  # the cloud that is filtered
        self._waits: Received | None = None  # the cloud that has waited longest for its output

    # For all threads --------------------------------------------------------------------------

    def start(self, name: str) -> None:
        """Filter in a thread of its own."""
        self._filter.pass_failed = self._parameters.load.policy == 'pass_through'
        self._say(FILTERED if self.enabled else UNFILTERED + DISABLED)
        self.clock.watch(self._went_on, self._went_back, self._clock_changed)
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    @property
    def oldest(self) -> int | None:
        """When the cloud was received that has waited longest; None where none waits."""
        waiting = self._waits or self._taken
        return self.inbox.oldest if waiting is None else waiting.at

    def join(self) -> None:
        """Wait until all that the closed inbox held is filtered."""
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self.clock.stop()

    def raise_failure(self) -> None:
        """Raise what has ended the thread."""
        if self._failure is not None:
            raise self._failure

    def change(self, parameters: FilterParameters) -> None:
        """Filter by other parameters from the next block on."""

        def apply() -> None:
            self._filter.change(parameters)
            self._filter.pass_failed = parameters.load.policy == 'pass_through'
            self._parameters = parameters

        self.inbox.load = parameters.load
        if self._thread is None:
            apply()
        else:
            self.inbox.change(apply)

    def enable(self, *, on: bool) -> None:
        """Filter the clouds that come from now on, or let them pass as they are."""

        def apply() -> None:
            if self.enabled and not on:
                # Clouds that would complete their blocks are not read any more.
                self._publish(self._filter.flush_pending())
            self.enabled = on
            self._say(FILTERED if on else UNFILTERED + DISABLED)

        self.between_clouds(apply, in_turn=True)

    def flush_pending(self) -> None:
        """Publish all clouds that wait for their blocks, judged with the points that there are."""
        self.between_clouds(lambda: self._publish(self._filter.flush_pending()))

    def between_clouds(self, command: Callable[[], object], *, in_turn: bool = False) -> None:
        """Do something to the filter between two clouds: at once, where there is no thread."""
        if self._thread is None:
            command()
        else:
            self.inbox.order(command, in_turn=in_turn)

    # In the executor's thread, by the clock ---------------------------------------------------

    def _went_on(self) -> None:
        """Wake the thread where a cloud has waited long enough."""
        due = self._due
        if due is not None and self.clock.now() >= due:
            self.inbox.wake()

    def _went_back(self) -> None:
        """Reset after the pending clouds."""
        self.inbox.received_now(self.clock.now())
        self.inbox.order(self._reset, in_turn=True)

    def _clock_changed(self) -> None:
        """Flush clouds that were timed by the previous clock."""
        self.inbox.received_now(self.clock.now())
        self.flush_pending()

    # In the thread that filters ---------------------------------------------------------------

    def _work(self) -> None:
        try:
            while self._step():
                self._health.counted(self._filter.statistics)
        except BaseException as err:  # noqa: BLE001  raised in the executor's thread
            self._failure = err

    def _step(self) -> bool:
        """Do what comes next; return whether there will be more."""
        left = self._time_left()
        if left is not None and left <= 0 and not self.inbox.closed:
            # Poses may have come while a block was being judged.
            self._publish(self._filter.advance() or self._filter.release_oldest())
            return True
        job = self.inbox.take(None if self.clock.is_simulated else left)
        if isinstance(job, Received):
            self._taken = job
            self._take(job)
            self._taken = None
        elif job is not None:
            job()
        else:
            self._publish(self._filter.advance())
            # Something may have come meanwhile, and the end behind it.
            return not self.inbox.done
        return True

    def _time_left(self) -> float | None:
        """Return how long the oldest cloud may still wait: seconds; None where none waits."""
        received = self._waits = self._filter.oldest
        if received is None:
            self._due = None
            return None
        max_delay = self._parameters.max_delay
        patience = max_delay - self.overload.lead(max_delay)
        # Noted before the clock is read: should it go on meanwhile, we are woken.
        self._due = received.at + round(patience * SECOND)
        return (self._due - self.clock.now()) / SECOND

    def _take(self, received: Received) -> None:
        """Filter a cloud, or do with it what the load allows."""
        began = perf_counter()
        treatment = self._treat(received)
        if treatment is Treatment.DROP:
            self._health.missed(DROPPED)
            return
        try:
            received.msg = self.read(received.data)
        except CloudError as err:
            self._filter.refused(err)
            return
        self._health.read(_count(received.msg))
        if treatment is Treatment.PASS and self.enabled:
            # Nothing completes the blocks of those before it for now.
            self._publish(self._filter.flush_pending())
            self._say(UNFILTERED + OVERLOAD)
            self._publish(self._process(received.msg, received, OVERLOAD))
        else:
            self._filter.degrade(on=treatment is Treatment.DEGRADE)
            if self.enabled:
                self._say(treatment.value)
            resets = self._filter.statistics.resets
            self._publish(self._process(received.msg, received))
            if self._filter.statistics.resets > resets:
                self._set_back_at = self.clock.steady_now()
        seconds = perf_counter() - began
        self.overload.took(seconds)
        self._health.spent(seconds)

    def _treat(self, received: Received) -> Treatment:
        if self.inbox.closed:
            return Treatment.FILTER
        age = (self.clock.now() - received.at) / SECOND
        load, max_delay = self.inbox.load, self._parameters.max_delay
        treatment = self.overload.decide(load.policy, self.inbox.fill, age, max_delay)
        if treatment is Treatment.DEGRADE and not self._filter.has_line_detectors:
            return Treatment.PASS
        return treatment

    def _reset(self) -> None:
        """Reset after the clock went back, unless the times of clouds have just caused one."""
        since = (self.clock.steady_now() - self._set_back_at) / SECOND
        if since > self._parameters.time_jump:
            self._publish(self._filter.reset())
            self._set_back_at = self.clock.steady_now()

    def _say(self, state: str) -> None:
        """Publish what the clouds are from now on, where that changes."""
        if state != self._state:
            self._state = state
            self._publisher.say(state)

    def _publish(self, results: Iterable[SplitCloud]) -> None:
        for result in results:
            if not self._publisher.publish(result):
                return
            if isinstance(result.tag, Received):
                self._note(result.tag)

    def _note(self, received: Received) -> None:
        stamp = received.msg.header.stamp
        age = self.clock.ros_now() - stamp.sec * SECOND - stamp.nanosec
        self._health.published((self.clock.now() - received.at) / SECOND, age / SECOND)

    # In any one thread ------------------------------------------------------------------------

    def finish(self) -> None:
        """Filter and publish what is left, once the inbox is closed."""
        self.join()
        self.raise_failure()
        self._publish(self._filter.flush())
        self._health.counted(self._filter.statistics)
        self._publisher.wait()

    def _process(self, msg: Any, tag: object, bypassed: str = '') -> list[SplitCloud]:
        """Filter the next cloud; return the outputs that it completes, the oldest first.

        An invalid cloud is counted and logged, at a bounded rate, and has no output.
        ``bypassed`` says why it is not to be filtered.
        """
        bypassed = bypassed or ('' if self.enabled else DISABLED)
        if self._thread is not None:
            self._filter.requested_outputs = self._publisher.requested
        try:
            return self._filter.process(msg, tag, bypassed=bypassed)
        except CloudError as err:
            self._filter.refuse(err)
            return self._filter.advance()


def _count(msg: Any) -> int:
    """Count the points of a cloud, or the shots of a scan."""
    if isinstance(msg, PointCloud2):
        return int(len(msg.data) // max(msg.point_step, 1))
    return len(msg.ranges)


class DelayClock:
    """A steady clock; under ``use_sim_time`` that of ``/clock``.

    So a recording that is played slowly, or that pauses, forces no flush.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._ros = node.get_clock()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    @property
    def is_simulated(self) -> bool:
        """Whether time comes from ``/clock``."""
        return bool(self._ros.ros_time_is_active)

    @property
    def has_stopped(self) -> bool:
        """Whether time comes from ``/clock``, and ``/clock`` has no publisher."""
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
        """Call back when simulated time advances, jumps back, or switches on or off.

        It switches with ``use_sim_time``, and on with the first message on ``/clock``.
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
