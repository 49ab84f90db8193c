# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The way of one topic through a node: subscription, filter, publishers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.pipeline import Answer, CloudFilter, Statistics

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

    from lidar_outlier_filter.parameters import FilterParameters

OUTPUT_DEPTH = 10  # clouds kept for a subscriber that is slow
REFUSAL_PERIOD = 5.0  # seconds between two log lines about refused clouds
PATIENCE = 0.9  # share of max_delay that a cloud may wait; the rest is for its verdict
ACKNOWLEDGE = Duration(seconds=2)  # how long the last clouds may take to arrive


class Channel:
    """The way of one topic: its clouds come in, cleaned and outlier clouds go out.

    Made, it has its compiled kernels and its publishers. ``start`` subscribes; a replay does not
    start it but calls ``process`` itself.
    """

    def __init__(self, node: Node, topic: str, parameters: FilterParameters) -> None:
        """Make the filter and the publishers of ``topic``/cleaned and ``topic``/outliers."""
        self._node = node
        self._topic = topic
        self._log = node.get_logger()
        self._filter = CloudFilter(parameters, self._log_info, self._log_warning)
        self._enabled = True
        self.cleaned_publisher = self._advertise(f'{topic}/cleaned')
        self.outliers_publisher = self._advertise(f'{topic}/outliers')
        self._subscription: Subscription | None = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    @property
    def statistics(self) -> Statistics:
        """Counts since the start."""
        return self._filter.statistics

    @property
    def waiting(self) -> int:
        """Count the clouds that were taken and have no answer yet."""
        return self._filter.waiting

    def start(self) -> None:
        """Subscribe, and watch over ``max_delay``."""
        self._alarm = self._node.create_timer(1.0, self._hurry, clock=self._steady, autostart=False)
        self._subscription = self._node.create_subscription(
            PointCloud2,
            self._topic,
            self._receive,
            qos_profile_sensor_data,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def process(self, msg: PointCloud2, tag: object = None) -> list[Answer]:
        """Filter the next cloud; return the answers that are finished by it, the oldest first.

        A cloud that makes no sense is counted and logged, at a bounded rate, and has no answer.
        """
        try:
            if not self._enabled:
                return self._filter.pass_by(msg, 'disabled', tag)
            return self._filter.push(msg, tag)
        except CloudError as err:
            self._log.warning(
                f'refused a cloud ({self.statistics.refused} so far): {err}',
                throttle_duration_sec=REFUSAL_PERIOD,
            )
            return []

    def flush(self) -> list[Answer]:
        """Answer all that is pending, and begin anew."""
        return self._filter.flush()

    def change(self, parameters: FilterParameters) -> None:
        """Filter by other parameters from the next block on."""
        self._filter.change(parameters)

    def enable(self, *, on: bool) -> None:
        """Filter the clouds to come, or let them pass as they are."""
        if self._enabled and not on:
            # What would complete their blocks is not looked at any more.
            self._publish(self._filter.hurry())
        self._enabled = on

    def finish(self) -> None:
        """Answer and publish all that was received, before the node goes."""
        if self._subscription is not None:
            received = _take_all(self._subscription)
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
            for msg in received:
                self._publish(self.process(msg))
        self._publish(self.flush())
        for publisher in (self.cleaned_publisher, self.outliers_publisher):
            publisher.wait_for_all_acked(ACKNOWLEDGE)

    def _advertise(self, name: str) -> Publisher:
        return self._node.create_publisher(
            PointCloud2,
            name,
            QoSProfile(depth=OUTPUT_DEPTH),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def _receive(self, msg: PointCloud2) -> None:
        self._publish(self.process(msg, self._steady.now()))
        self._set_alarm()

    def _hurry(self) -> None:
        """Answer all that waits with what is there."""
        self._publish(self._filter.hurry())
        self._set_alarm()

    def _set_alarm(self) -> None:
        """Wake when the cloud that has waited longest must be answered."""
        received = self._filter.oldest
        if received is None:
            self._alarm.cancel()
            return
        patience = Duration(seconds=PATIENCE * self._filter.parameters.max_delay)
        left = received + patience - self._steady.now()
        self._alarm.timer_period_ns = max(left.nanoseconds, 0)
        self._alarm.reset()

    def _publish(self, answers: Iterable[Answer]) -> None:
        for answer in answers:
            self.cleaned_publisher.publish(answer.cleaned)
            self.outliers_publisher.publish(answer.outliers)

    def _log_info(self, text: str) -> None:
        self._log.info(text)

    def _log_warning(self, text: str) -> None:
        self._log.warning(text)


def _take_all(subscription: Subscription) -> list[PointCloud2]:
    """Take the clouds that were received, but that no executor will serve any more."""
    received = []
    with subscription.handle:
        while taken := subscription.handle.take_message(PointCloud2, False):  # noqa: FBT003
            received.append(taken[0])
    return received
