# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The node: parameters, subscription, process(msg), publishers."""

from __future__ import annotations

import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_full_topic_name import validate_full_topic_name
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.errors import CloudError, FilterError, ParameterError
from lidar_outlier_filter.parameter_files import NODE_NAME
from lidar_outlier_filter.parameters import FilterParameters, describe
from lidar_outlier_filter.pipeline import Answer, CloudFilter, Statistics
from lidar_outlier_filter.start import leave, on_stop

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

    from lidar_outlier_filter.parameter import Parameter

POINTS, CLEANED, OUTLIERS = 'points', 'points/cleaned', 'points/outliers'
OUTPUT_DEPTH = 10  # clouds kept for a subscriber that is slow
REFUSAL_PERIOD = 5.0  # seconds between two log lines about refused clouds
PATIENCE = 0.9  # share of max_delay that a cloud may wait; the rest is for its verdict
ACKNOWLEDGE = Duration(seconds=2)  # how long the last clouds may take to arrive
SIGNAL_PERIOD = 0.1  # seconds between two looks for a signal: the middleware wakes for none


def remappings(input_topic: str) -> list[tuple[str, str]]:
    """Say how the node's topics are named for a sensor on ``input_topic``.

    Raises
    ------
    ParameterError
        If ROS 2 does not allow the name.

    """
    try:
        validate_full_topic_name(expand_topic_name(input_topic, NODE_NAME, '/'))
    except (InvalidTopicNameException, ValueError) as err:
        must_be = 'a topic name that ROS 2 allows'
        raise ParameterError('input_topic', must_be, repr(input_topic)) from err
    cleaned, outliers = f'{input_topic}/cleaned', f'{input_topic}/outliers'
    return [(POINTS, input_topic), (CLEANED, cleaned), (OUTLIERS, outliers)]


class OutlierFilterNode(Node):  # type: ignore[misc]
    """Filters the clouds of one topic.

    Made, it has its parameters, its compiled kernels and its publishers. ``start`` subscribes; a
    replay does not start it but calls ``process`` itself.
    """

    def __init__(
        self,
        *,
        parameters: Mapping[str, object] | None = None,
        input_topic: str | None = None,
        **options: Any,
    ) -> None:
        """Declare the parameters and make the publishers.

        Parameters
        ----------
        parameters : values that replace defaults, by flat name
        input_topic : names the topics as :func:`remappings` says
        options : of rclpy.node.Node

        Raises
        ------
        ParameterError
            If a parameter, given here or on the command line, makes no sense.

        """
        values = parameters or {}
        given = [RosParameter(name, value=_to_ros(values[name])) for name in values]
        if input_topic is not None:
            rules = [f'{old}:={new}' for old, new in remappings(input_topic)]
            remap = [word for rule in rules for word in ('-r', rule)]
            options['cli_args'] = [*options.get('cli_args', []), '--ros-args', *remap]
        super().__init__(NODE_NAME, parameter_overrides=given, **options)
        self._filter = CloudFilter(self._declare(), self._log_info, self._log_warning)
        self.add_pre_set_parameters_callback(_with_floats)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self.cleaned_publisher = self._advertise(CLEANED)
        self.outliers_publisher = self._advertise(OUTLIERS)
        self._subscription: Subscription | None = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    @property
    def statistics(self) -> Statistics:
        """Counts since the start."""
        return self._filter.statistics

    @property
    def filter_parameters(self) -> FilterParameters:
        """The parameters in force."""
        return self._filter.parameters

    def start(self) -> None:
        """Subscribe, and watch over ``max_delay``."""
        self._patience = PATIENCE * self._filter.parameters.max_delay
        self._alarm = self.create_timer(
            self._patience, self._hurry, clock=self._steady, autostart=False
        )
        self._subscription = self.create_subscription(
            PointCloud2,
            POINTS,
            self._receive,
            qos_profile_sensor_data,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def process(self, msg: PointCloud2, tag: object = None) -> list[Answer]:
        """Filter the next cloud; return the answers that are finished by it, the oldest first.

        A cloud that makes no sense is counted and logged, at a bounded rate, and has no answer.
        """
        try:
            return self._filter.push(msg, tag)
        except CloudError as err:
            self.get_logger().warning(
                f'refused a cloud ({self.statistics.refused} so far): {err}',
                throttle_duration_sec=REFUSAL_PERIOD,
            )
            return []

    def flush(self) -> list[Answer]:
        """Answer all that is pending, and begin anew."""
        return self._filter.flush()

    def finish(self) -> None:
        """Answer and publish all that was received, before the node goes.

        Does nothing where ROS is shut down already: nobody would hear of it.
        """
        if not self.context.ok():
            return
        if self._subscription is not None:
            received = _take_all(self._subscription)
            self.destroy_subscription(self._subscription)
            self._subscription = None
            for msg in received:
                self._publish(self.process(msg))
        self._publish(self.flush())
        for publisher in (self.cleaned_publisher, self.outliers_publisher):
            publisher.wait_for_all_acked(ACKNOWLEDGE)

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set all or none; refuse in our own words, before rclpy does in words without units."""
        result = self._check_parameters(parameter_list)
        return super().set_parameters_atomically(parameter_list) if result.successful else result

    def _advertise(self, name: str) -> Publisher:
        return self.create_publisher(
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
        left = received + Duration(seconds=self._patience) - self._steady.now()
        self._alarm.timer_period_ns = max(left.nanoseconds, 0)
        self._alarm.reset()

    def _publish(self, answers: Iterable[Answer]) -> None:
        for answer in answers:
            self.cleaned_publisher.publish(answer.cleaned)
            self.outliers_publisher.publish(answer.outliers)

    def _log_info(self, text: str) -> None:
        self.get_logger().info(text)

    def _log_warning(self, text: str) -> None:
        self.get_logger().warning(text)

    def _declare(self) -> FilterParameters:
        """Declare every parameter, and refuse values that make no sense, alone or together."""
        given = {
            name: parameter.value
            for name, parameter in self._parameter_overrides.items()
            # Those that ROS declares itself are not for us.
            if not (self.has_parameter(name) or name.startswith('qos_overrides.'))
        }
        parameters = FilterParameters().changed(given)
        values = parameters.flat()
        for item in describe():
            # Not the override but its checked value: a whole number may stand for a float.
            self.declare_parameter(
                item.name, _to_ros(values[item.name]), _descriptor(item), ignore_override=True
            )
        return parameters

    def _changed(self, parameters: Iterable[RosParameter]) -> FilterParameters:
        known = {parameter.name for parameter in describe()}
        values = {item.name: item.value for item in parameters if item.name in known}
        return self._filter.parameters.changed(values)

    def _check_parameters(self, parameters: list[RosParameter]) -> SetParametersResult:
        """Refuse a set of parameters as a whole, or let it pass; no side effects."""
        try:
            self._changed(parameters)
        except ParameterError as err:
            return SetParametersResult(successful=False, reason=str(err))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[RosParameter]) -> None:
        """Apply what passed, between two messages."""
        self._filter.change(self._changed(parameters))


def _to_ros(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _take_all(subscription: Subscription) -> list[PointCloud2]:
    """Take the clouds that were received, but that no executor will serve any more."""
    received = []
    with subscription.handle:
        while taken := subscription.handle.take_message(PointCloud2, False):  # noqa: FBT003
            received.append(taken[0])
    return received


def _with_floats(parameters: list[RosParameter]) -> list[RosParameter]:
    """Let a whole number stand for a float, as in a file."""
    floats = {item.name for item in describe() if isinstance(item.default, float)}
    return [
        RosParameter(item.name, value=float(item.value))
        if item.name in floats and item.type_ is RosParameter.Type.INTEGER
        else item
        for item in parameters
    ]


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Tell ROS what there is to know of a parameter."""
    descriptor = ParameterDescriptor(
        description=parameter.text + (f' [{parameter.unit}]' if parameter.unit else ''),
        additional_constraints=parameter.range_text,
        read_only=parameter.fixed,
    )
    if parameter.low is not None and parameter.high is not None:
        if isinstance(parameter.default, float):
            low, high = float(parameter.low), float(parameter.high)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        else:
            first, last = int(parameter.low), int(parameter.high)
            descriptor.integer_range = [IntegerRange(from_value=first, to_value=last, step=1)]
    return descriptor


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; what is pending is judged and published first.

    Returns
    -------
    int
        The exit status: 0, or 1 where the arguments make no sense; stderr says why.

    """
    on_stop(leave)  # nothing to lose yet, and compiling the kernels may take half a minute
    stop = threading.Event()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = OutlierFilterNode()
        on_stop(stop.set)
        node.start()
    # A RuntimeError is rclpy's, for arguments and QoS overrides that it cannot read.
    except (FilterError, ParameterException, RuntimeError) as err:
        sys.stderr.write(f'{NODE_NAME}: {err}\n')
        return 1
    else:
        _serve(node, stop)
        return 0
    finally:
        rclpy.try_shutdown()


def _serve(node: OutlierFilterNode, stop: threading.Event) -> None:
    """Serve until ``stop`` is set or ROS is shut down, and finish."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        while node.context.ok() and not stop.is_set():
            executor.spin_once(timeout_sec=SIGNAL_PERIOD)
    node.finish()
    node.destroy_node()


if __name__ == '__main__':
    sys.exit(main())
