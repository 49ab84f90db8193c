# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The way of one topic through a node: subscription, filter, publishers."""

from __future__ import annotations

import threading
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration

from lidar_outlier_filter.core.points import SECOND
from lidar_outlier_filter.errors import CloudError, JudgingError
from lidar_outlier_filter.ros.backlog import Inbox, Overload, Received, Treatment
from lidar_outlier_filter.ros.cdr import read_cloud
from lidar_outlier_filter.ros.clocks import DelayClock
from lidar_outlier_filter.ros.health import Backlog, Health, Report
from lidar_outlier_filter.ros.subscriptions import (
    advertise,
    end,
    subscribe,
    subscribe_odometry,
)
from lidar_outlier_filter.ros.tf import make_motion
from lidar_outlier_filter.stream.cloud_filter import Answer, CloudFilter, Statistics
from lidar_outlier_filter.stream.topics import answers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from nav_msgs.msg import Odometry
    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from sensor_msgs.msg import PointCloud2

    from lidar_outlier_filter.parameters.filter import FilterParameters

REFUSAL_PERIOD = 5.0  # seconds between two log lines about refused clouds
ACKNOWLEDGE = Duration(seconds=2)  # how long the last clouds may take to arrive
MEGABYTE = 1e6


class Channel:
    """The way of one topic: its clouds come in, cleaned and outlier clouds go out.

    Made, it has its compiled kernels and its publishers. A replay calls ``process`` itself, and
    has its answers at once. ``start`` subscribes instead: clouds are received in the executor's
    thread, and filtered and published, in order, in a thread of their own.
    """

    def __init__(self, node: Node, topic: str, parameters: FilterParameters) -> None:
        """Make the filter and the publishers of ``topic``/cleaned and ``topic``/outliers."""
        self.topic = topic
        self.resolved: str = node.resolve_topic_name(topic)
        self.health = Health()
        self._node = node
        self._log = node.get_logger()
        self._parameters = parameters
        self._motion = make_motion(node, parameters)
        self._filter = CloudFilter(parameters, self._log_info, self._log_warning, self._motion)
        self._filter.refuse = self._log_refusal
        self._filter.fail = self._log_failure
        self._enabled = True
        publishers = (advertise(node, name) for name in answers(topic))
        self.cleaned_publisher, self.outliers_publisher = publishers
        self._subscription: Subscription | None = None
        self._odometry: Subscription | None = None
        self._clock = DelayClock(node)
        self._inbox = Inbox(parameters.load)
        self._overload = Overload()
        self._due: int | None = None  # when the cloud that waits longest must be answered, ns
        self._set_back_at = -(2**62)  # when the sensor's or the node's clock was, steady ns
        self._failure: BaseException | None = None
        self._thread: threading.Thread | None = None

    @property
    def statistics(self) -> Statistics:
        """Counts since the start."""
        return self._filter.statistics

    @property
    def waiting(self) -> int:
        """Count the clouds that were taken and have no answer yet."""
        return self._filter.waiting + self._inbox.clouds

    # For all threads --------------------------------------------------------------------------

    def start(self) -> None:
        """Subscribe, and filter what comes in a thread of its own."""
        self._filter.pass_failed = self._parameters.load.policy == 'pass_through'
        self._clock.watch(self._went_on, self._went_back, self._clock_changed)
        self._thread = threading.Thread(target=self._work, name=f'filter {self.topic}', daemon=True)
        self._thread.start()
        if self._motion is not None and self._motion.topic:
            self._odometry = subscribe_odometry(self._node, self._motion.topic, self._receive_pose)
        self._subscription = subscribe(self._node, self.topic, self._receive_bytes, self._lost)

    def change(self, parameters: FilterParameters) -> None:
        """Filter by other parameters from the next block on."""

        def apply() -> None:
            self._filter.change(parameters)
            self._filter.pass_failed = parameters.load.policy == 'pass_through'
            self._parameters = parameters

        self._inbox.load = parameters.load
        self._do(apply)

    def enable(self, *, on: bool) -> None:
        """Filter the clouds that come from now on, or let them pass as they are."""

        def apply() -> None:
            if self._enabled and not on:
                # What would complete their blocks is not looked at any more.
                self._publish(self._filter.hurry())
            self._enabled = on

        self._do(apply, in_turn=True)

    def hurry(self) -> None:
        """Answer all that waits with what is there."""
        self._do(lambda: self._publish(self._filter.hurry()))

    def look(self, seconds: float) -> Report:
        """Tell what became of the clouds in the seconds since the last look."""
        self.raise_failure()
        if self._clock.has_stopped and self._filter.waiting:
            self.hurry()  # the recording has ended: there is no time any more that could pass
        remarks = []
        if not self._enabled:
            remarks.append('disabled: clouds pass unfiltered')
        if self._overload.treatment is not Treatment.FILTER:
            remarks.append(f'too much to filter: clouds are {self._overload.treatment.value}')
        if self._clock.has_stopped:
            remarks.append('use_sim_time is set and nobody publishes /clock')
        size = self._inbox.size / MEGABYTE
        publishers = self._node.count_publishers(self.resolved)
        backlog = Backlog(self._inbox.clouds, size, self._filter.waiting, publishers)
        parameters = self._parameters
        return self.health.look(seconds, parameters.health, parameters.max_delay, backlog, remarks)

    def close(self) -> None:
        """Receive no more; what was received is filtered, however much it is."""
        self._inbox.close([self._received(msg) for msg in self._read(self._unsubscribe())])

    def finish(self) -> None:
        """Answer and publish all that was received, before the node goes."""
        self.close()
        self._join()
        self.raise_failure()
        self._publish(self.flush())
        for publisher in (self.cleaned_publisher, self.outliers_publisher):
            publisher.wait_for_all_acked(ACKNOWLEDGE)

    def stop(self) -> None:
        """Let go of all that was received: nobody would hear of it."""
        self._inbox.close(discard=True)
        self._join()

    def raise_failure(self) -> None:
        """Raise what has ended the thread that filters."""
        if self._failure is not None:
            raise self._failure

    def _do(self, command: Callable[[], object], *, in_turn: bool = False) -> None:
        """Do something to the filter between two clouds: at once, where it has no thread."""
        if self._thread is None:
            command()
        else:
            self._inbox.order(command, in_turn=in_turn)

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._clock.stop()

    # In the executor's thread -----------------------------------------------------------------

    def _receive_bytes(self, data: bytes) -> None:
        for msg in self._read([data]):
            self._receive(msg)

    def _receive(self, msg: PointCloud2) -> None:
        self.raise_failure()
        self.health.dropped(self._inbox.put(self._received(msg)))

    def _read(self, received: Iterable[bytes]) -> Iterator[PointCloud2]:
        """Read clouds; those that make no sense are counted."""
        for data in received:
            try:
                yield read_cloud(data)
            except CloudError as err:
                self._do(partial(self._filter.refused, err))

    def _received(self, msg: PointCloud2) -> Received:
        """Count a cloud, and note when it was received."""
        self.health.received(msg.width * msg.height)
        return Received(msg, self._clock.now(), len(msg.data))

    def _receive_pose(self, msg: Odometry) -> None:
        if self._motion is not None:
            self._motion.take(msg)
            self._inbox.wake()

    def _went_on(self) -> None:
        """Wake the thread that filters where a cloud has waited long enough."""
        due = self._due
        if due is not None and self._clock.now() >= due:
            self._inbox.wake()

    def _went_back(self) -> None:
        """Begin anew after the clouds of before."""
        self._inbox.received_now(self._clock.now())
        self._inbox.order(self._begin_anew, in_turn=True)

    def _clock_changed(self) -> None:
        """Answer what waits by a clock that is none any more."""
        self._inbox.received_now(self._clock.now())
        self.hurry()

    # In the thread that filters ---------------------------------------------------------------

    def _work(self) -> None:
        try:
            while self._step():
                self.health.counted(self.statistics)
        except BaseException as err:  # noqa: BLE001  raised in the executor's thread
            self._failure = err

    def _step(self) -> bool:
        """Do what comes next; tell whether there will be more."""
        left = self._time_left()
        if left is not None and left <= 0 and not self._inbox.closed:
            # Poses may have come while a block was being judged.
            self._publish(self._filter.advance() or self._filter.hurry_oldest())
            return True
        job = self._inbox.take(None if self._clock.is_simulated else left)
        if isinstance(job, Received):
            self._take(job)
        elif job is not None:
            job()
        else:
            self._publish(self._filter.advance())
            # Something may have come meanwhile, and the end behind it.
            return not self._inbox.done
        return True

    def _time_left(self) -> float | None:
        """Tell until when the cloud that waits longest may wait: seconds; None where none does."""
        received = self._filter.oldest
        if received is None:
            self._due = None
            return None
        max_delay = self._parameters.max_delay
        patience = max_delay - self._overload.lead(max_delay)
        # Noted before the clock is read: should it go on meanwhile, we are woken.
        self._due = received.at + round(patience * SECOND)
        return (self._due - self._clock.now()) / SECOND

    def _take(self, received: Received) -> None:
        """Do with a cloud what the load allows."""
        began = perf_counter()
        treatment = self._treatment(received)
        if treatment is Treatment.DROP:
            self.health.dropped()
        elif treatment is Treatment.PASS and self._enabled:
            # Nothing completes the blocks of those before it for now.
            self._publish(self._filter.hurry())
            self._publish(self._process(received.msg, received, 'overload'))
        else:
            self._filter.shed(on=treatment is Treatment.SHED)
            self.statistics.shed += treatment is Treatment.SHED
            resets = self.statistics.resets
            self._publish(self.process(received.msg, received))
            if self.statistics.resets > resets:
                self._set_back_at = self._clock.steady_now()
        seconds = perf_counter() - began
        self._overload.took(seconds)
        self.health.spent(seconds)

    def _treatment(self, received: Received) -> Treatment:
        if self._inbox.closed:
            return Treatment.FILTER
        age = (self._clock.now() - received.at) / SECOND
        load, max_delay = self._inbox.load, self._parameters.max_delay
        treatment = self._overload.decide(load.policy, self._inbox.fill, age, max_delay)
        if treatment is Treatment.SHED and not self._filter.can_shed:
            return Treatment.PASS
        return treatment

    def _begin_anew(self) -> None:
        """Begin anew after the clock went back, unless the clouds have shown that already."""
        since = (self._clock.steady_now() - self._set_back_at) / SECOND
        if since > self._parameters.time_jump:
            self._publish(self._filter.reset())
            self._set_back_at = self._clock.steady_now()

    def _publish(self, answers: Iterable[Answer]) -> None:
        for answer in answers:
            if not self._node.context.ok():
                return
            if answer.cleaned is not None:
                self.cleaned_publisher.publish(answer.cleaned)
            if answer.outliers is not None:
                self.outliers_publisher.publish(answer.outliers)
            if isinstance(answer.tag, Received):
                self._note(answer.tag)

    def _note(self, received: Received) -> None:
        stamp = received.msg.header.stamp
        age = self._clock.ros_now() - stamp.sec * SECOND - stamp.nanosec
        self.health.answered((self._clock.now() - received.at) / SECOND, age / SECOND)

    # In any one thread ------------------------------------------------------------------------

    def process(self, msg: PointCloud2, tag: object = None) -> list[Answer]:
        """Filter the next cloud; return the answers that are finished by it, the oldest first.

        A cloud that makes no sense is counted and logged, at a bounded rate, and has no answer.
        """
        return self._process(msg, tag, '' if self._enabled else 'disabled')

    def take_pose(self, msg: Any) -> list[Answer]:
        """Take the next odometry; return the answers that are finished by it, the oldest first."""
        if self._motion is not None:
            self._motion.take(msg)
        return self._filter.advance()

    def flush(self) -> list[Answer]:
        """Answer all that is pending, and begin anew."""
        return self._filter.flush()

    def _process(self, msg: PointCloud2, tag: object, passed: str) -> list[Answer]:
        if self._thread is not None:
            # What nobody subscribes to is not made. (Asked for at each cloud: an event that tells
            # of the first subscriber would come after its first cloud.)
            publishers = (self.cleaned_publisher, self.outliers_publisher)
            cleaned, outliers = (bool(item.get_subscription_count()) for item in publishers)
            self._filter.wanted = (cleaned, outliers)
        try:
            if passed:
                return self._filter.pass_by(msg, passed, tag)
            return self._filter.push(msg, tag)
        except CloudError as err:
            self._log_refusal(err)
            return self._filter.advance()

    # ROS --------------------------------------------------------------------------------------

    def _unsubscribe(self) -> list[bytes]:
        """Take what was received and not served: poses are kept, clouds returned."""
        clouds, self._subscription = self._subscription, None
        odometry, self._odometry = self._odometry, None
        # The poses last: those of the last clouds may come behind them.
        received = [] if clouds is None else end(self._node, clouds)
        for msg in [] if odometry is None else end(self._node, odometry):
            self._receive_pose(msg)
        return received

    def _lost(self, event: Any) -> None:
        self.health.lost(event.total_count_change)

    def _log_refusal(self, err: CloudError) -> None:
        self._log.warning(
            f'{self.resolved}: refused a cloud ({self.statistics.refused} so far): {err}',
            throttle_duration_sec=REFUSAL_PERIOD,
        )

    def _log_failure(self, err: JudgingError) -> None:
        self._log.error(f'{self.resolved}: a detector raised an error: {err}\n{err.trace}')

    def _log_info(self, text: str) -> None:
        self._log.info(f'{self.resolved}: {text}')

    def _log_warning(self, text: str) -> None:
        self._log.warning(f'{self.resolved}: {text}')
