# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The node: parameters, a channel for each topic, services and diagnostics."""

import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException, ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_full_topic_name import validate_full_topic_name
from std_srvs.srv import SetBool

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.errors import FilterError, ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters, installed
from lidar_outlier_filter.parameters.yaml_files import NODE_NAME
from lidar_outlier_filter.pipeline.topics import output_topics
from lidar_outlier_filter.ros.channel import Channel, Show
from lidar_outlier_filter.ros.diagnostics import Diagnostics
from lidar_outlier_filter.ros.endpoints import INPUT, remapped
from lidar_outlier_filter.ros.live_parameters import TunableNode

POINTS = 'points'
SIGNAL_PERIOD = 0.1  # seconds between two polls for a signal: the middleware wakes for none


def remappings(input_topic: str) -> list[tuple[str, str]]:
    """Say how the node's topics are named for a sensor on ``input_topic``.

    Raises
    ------
    ParameterError
        If ROS 2 does not allow the name.

    """
    _refuse_topic('input_topic', input_topic)
    return [
        (POINTS, input_topic),
        *zip(output_topics(POINTS), output_topics(input_topic), strict=True),
    ]


def _refuse_topic(what: str, name: str) -> None:
    try:
        validate_full_topic_name(expand_topic_name(name, NODE_NAME, '/'))
    except (InvalidTopicNameException, ValueError) as err:
        raise ParameterError(what, 'a topic name that ROS 2 allows', repr(name)) from err


class OutlierFilterNode(TunableNode):
    """Filters the clouds of one topic, or of several, each as a stream of its own.

    The constructor declares parameters and makes publishers. ``start`` subscribes.
    """

    is_managed = False  # and has its channels when it is configured

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
        if input_topic is not None:
            rules = [f'{old}:={new}' for old, new in remappings(input_topic)]
            remap = [word for rule in rules for word in ('-r', rule)]
            options['cli_args'] = [*options.get('cli_args', []), '--ros-args', *remap]
            parameters = {**(parameters or {}), 'inputs': (POINTS,)}
        super().__init__(parameters or {}, **options)
        for refused in installed().refused.values():
            self.get_logger().warning(str(refused))
        self._is_started = False
        self._show: Show | None = None
        if not self.is_managed:
            self.channels = self.make_channels()

    def make_channels(self) -> tuple[Channel, ...]:
        """Create a channel, with its publishers, for each input."""
        channels = tuple(Channel(self, name, self.filter_parameters) for name in self._names())
        if self._show is not None:
            for channel in channels:
                channel.show(self._show)
        return channels

    def show(self, show_cloud: Show) -> None:
        """Pass the judged clouds of all present and future channels to a function."""
        self._show = show_cloud
        for channel in self.channels:
            channel.show(show_cloud)

    def start(self) -> None:
        """Offer the services, and filter."""
        self.serve()
        self.run()

    def serve(self) -> None:
        """Offer the services."""
        self._serve_parameters()
        self.create_service(SetBool, '~/enable', self._enable)

    def run(self) -> None:
        """Subscribe, and watch over ``max_delay``."""
        self._diagnostics = Diagnostics(self, self.channels)
        for channel in self.channels:
            channel.start()
        self._warn_of_overrides()
        self._is_started = True
        self.get_logger().info(ready_line(self.filter_parameters, self.channels))

    def _warn_of_overrides(self) -> None:
        """Warn of overrides of the quality of service for topics that this node has not."""
        for name in self._parameter_overrides:
            prefix, _, setting = name.partition('.')[2].partition('.')
            if not name.startswith('qos_overrides.') or self.has_parameter(name):
                continue
            known = [str(one) for one in self._parameters if one.startswith('qos_overrides.')]
            meant = [one for one in known if one.endswith(f'.{setting}') and prefix not in one]
            hint = f'; did you mean {" or ".join(meant)}?' if meant else ''
            self.get_logger().warning(f'{name} has no effect: no such topic or setting{hint}')

    def finish(self) -> None:
        """Filter and publish all received clouds before the node ends.

        Does nothing after ROS was shut down: nothing can be published any more.
        """
        if self.context.ok():
            # Before one is waited for, so that the queues of the others do not run over meanwhile.
            for channel in self.channels:
                channel.close()
            with ExitStack() as others:  # which finish where one has failed
                for channel in reversed(self.channels):
                    others.callback(channel.finish)
        self._is_started, self.statuses = False, ()

    def destroy_node(self) -> None:
        """Stop all threads and release all resources."""
        for channel in self.channels:
            channel.stop()
        super().destroy_node()

    def _names(self) -> tuple[str, ...]:
        """Return the topics of the sensors, checked."""
        names = self.filter_parameters.inputs
        if names == (POINTS,) and remapped(self, INPUT):
            names = (INPUT,)
        for name in names:
            _refuse_topic('a topic of inputs', name)
        if len({self.resolve_topic_name(name) for name in names}) < len(names):
            raise ParameterError('inputs', 'different topics', repr(list(names)))
        if len({output_topics(self.resolve_topic_name(name)) for name in names}) < len(names):
            must_be = 'one topic of a sensor, plain or compressed: both have the same outputs'
            raise ParameterError('inputs', must_be, repr(list(names)))
        return names

    def apply(self, parameters: FilterParameters) -> None:
        """Apply parameters from the next block."""
        for channel in self.channels:
            channel.change(parameters)

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        for channel in self.channels:
            channel.worker.enable(on=request.data)
        response.success = True
        response.message = 'filtering' if request.data else 'clouds pass unfiltered'
        self.get_logger().info(f'now: {response.message}')
        return response


class ManagedFilterNode(LifecycleNodeMixin, OutlierFilterNode):  # type: ignore[misc]
    """Filters while it is active: inactive it has idle publishers, unconfigured only services.

    Clouds received while active are published before the node becomes inactive.
    """

    is_managed = True

    def __init__(self, **options: Any) -> None:
        OutlierFilterNode.__init__(self, **options)
        LifecycleNodeMixin.__init__(self)
        self._change = self._service_change_state.callback
        self._service_change_state.callback = self._change_state

    def _change_state(self, request: Any, response: Any) -> Any:
        """Refuse a transition that the state lacks: rclpy would raise an error."""
        allowed = {number for number, *_ in self._state_machine.available_transitions}
        if not request.transition.label and request.transition.id not in allowed:
            response.success = False
            return response
        return self._change(request, response)

    def start(self) -> None:
        """Offer the services, and wait for a manager."""
        self.serve()
        self.get_logger().info('managed node: waiting to be configured')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the publishers from the current parameters."""
        try:
            self.channels = self.make_channels()
        except FilterError as err:
            self.get_logger().error(f'not configured: {err}')
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe, and filter."""
        self.run()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the outputs of all received clouds; then receive and publish nothing."""
        self._pause()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy the publishers."""
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the outputs of all received clouds, and remove the publishers."""
        self._pause()
        self._release()
        return super().on_shutdown(state)

    def _pause(self) -> None:
        if self._is_started:
            self.finish()
            self._diagnostics.end()

    def _release(self) -> None:
        for channel in self.channels:
            channel.destroy()
        self.channels = ()


def run(
    make: Callable[[], OutlierFilterNode],
    attach: Callable[[OutlierFilterNode], object],
    on_stop: Callable[[Callable[[], object]], object],
) -> int:
    """Make a node and run it, as :func:`lidar_outlier_filter.ros.executable.main` says.

    ``on_stop`` gets the function to call on the first signal.
    """
    stop = threading.Event()
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = make()
        on_stop(stop.set)
        attach(node)
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
    executor = _executor(node.context)
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        while node.context.ok() and not stop.is_set():
            executor.spin_once(timeout_sec=SIGNAL_PERIOD)
    node.finish()
    # First: threads of the middleware call an executor for what it serves.
    executor.shutdown()
    node.destroy_node()


def _executor(context: Context) -> Executor:
    """Make the executor that takes the least time, where this ROS has it."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor  # noqa: PLC0415
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def ready_line(parameters: FilterParameters, channels: Iterable[Channel]) -> str:
    """Describe the started node in one line: version, topics, chain, blocks, threads."""
    length = f' ({parameters.block:g} s)' if parameters.blocks != 'message' else ''
    topics = ', '.join(
        f'{channel.resolved} to {channel.publisher.cleaned.topic_name} and '
        f'{channel.publisher.outliers.topic_name}'
        for channel in channels
    )
    return (
        f'version {__version__} is ready: {topics}; '
        f'chain {", ".join(parameters.chain)}; blocks {parameters.blocks}{length}; '
        f'threads {parameters.threads or cores()}'
    )
