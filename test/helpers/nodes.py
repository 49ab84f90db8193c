# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes inside the process of a test: the filter, a client that sets parameters, and a sensor."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2

from helpers.clouds import SECOND, STAMP, cloud, table
from helpers.live import KEEP_ALL, new_domain
from helpers.programs import TIMEOUT
from lidar_outlier_filter.parameters.filter import describe
from lidar_outlier_filter.parameters.node import HealthLimits
from lidar_outlier_filter.parameters.yaml_files import NODE_NAME
from lidar_outlier_filter.pipeline.pipeline import SplitCloud
from lidar_outlier_filter.ros.channel import Channel
from lidar_outlier_filter.ros.health import Backlog, Health
from lidar_outlier_filter.ros.node import OutlierFilterNode


def process(node: OutlierFilterNode, msg: PointCloud2, tag: object = None) -> list[SplitCloud]:
    """Filter a cloud in a node that is not started; return the outputs that it completes."""
    return node.channels[0].worker._process(msg, tag)


def flush(node: OutlierFilterNode) -> list[SplitCloud]:
    """Flush all that is pending in a node that is not started."""
    return node.channels[0]._filter.flush()


def values(node: OutlierFilterNode) -> dict[str, object]:
    """Read all parameters of the node from ROS."""
    return {item.name: node.get_parameter(item.name).value for item in describe()}


# The columns of ~/statistics.
PLOTTED = tuple(Health().sample(1.0, HealthLimits(), 1.0, Backlog(0, 0.0, 0)).plotted)


class Diagnosis:
    """The diagnostics of one topic."""

    def __init__(self, status: DiagnosticStatus) -> None:
        self.name = str(status.name)
        self.level = int.from_bytes(status.level, 'little')
        self.message = str(status.message)
        self.values = {item.key: item.value for item in status.values}

    def __getitem__(self, key: str) -> float:
        """Return a value that is a number; what is not said is 0."""
        return float(self.values.get(key, 0))


class Ros:
    """A domain of its own, a client and filters in it, and one executor that serves them."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=new_domain())
        self.executor = SingleThreadedExecutor(context=self.context)
        self.client = rclpy.create_node('client', context=self.context)
        self.executor.add_node(self.client)
        self._received: dict[str, deque[Any]] = {}
        self._filters: list[OutlierFilterNode] = []

    def filter(self, *arguments: str, **options: Any) -> OutlierFilterNode:
        """Make the node with ROS arguments, which follow ``--ros-args``."""
        cli_args = ['--ros-args', *arguments, '--']
        node = OutlierFilterNode(context=self.context, cli_args=cli_args, **options)
        self.add(node)
        return node

    def add(self, node: OutlierFilterNode) -> None:
        """Serve a node, and destroy it at the end."""
        self.executor.add_node(node)
        self._filters.append(node)

    def wait(self, future: Future) -> Any:
        """Serve until there is a result."""
        self.executor.spin_until_future_complete(future, TIMEOUT)
        assert future.done()
        return future.result()

    def serve_while(self, condition: Callable[[], object]) -> None:
        """Serve until a condition holds no more."""
        end = time.monotonic() + TIMEOUT
        while condition():
            assert time.monotonic() < end
            self.executor.spin_once(0.05)

    def sensor(self, node: OutlierFilterNode, topic: str = '/points') -> 'Sensor':
        """Start a filter, and a sensor that is connected to it."""
        node.start()
        sensor = Sensor(self, topic)
        sensor.wait_for_filter(node)
        return sensor

    def parameters(self) -> AsyncParameterClient:
        """Reach the parameters of the node through its services."""
        services = AsyncParameterClient(self.client, NODE_NAME)
        assert services.wait_for_services(TIMEOUT)
        return services

    def set(self, **values: object) -> list[str]:
        """Set parameters one by one; return the reasons of refusal, '' if it was accepted."""
        response = self.wait(self.parameters().set_parameters(_to_set(values)))
        return [str(result.reason) for result in response.results]

    def set_together(self, **values: object) -> str:
        """Set parameters atomically; return the reason of refusal, '' if it was accepted."""
        response = self.wait(self.parameters().set_parameters_atomically(_to_set(values)))
        return str(response.result.reason)

    def call(self, kind: Any, name: str, request: Any, namespace: str = '') -> Any:
        """Call one of the node's own services, and return the response."""
        client = self.client.create_client(kind, f'{namespace}/{NODE_NAME}/{name}')
        assert client.wait_for_service(TIMEOUT)
        return self.wait(client.call_async(request))

    def wait_for_message(self, kind: Any, topic: str, requested: Callable[[Any], bool]) -> Any:
        """Serve until a message fulfils the condition, and return it; earlier ones are dropped."""
        if topic not in self._received:
            received = self._received[topic] = deque()
            # rclpy does not take a method of C.
            listen = lambda msg: received.append(msg)  # noqa: E731, PLW0108
            self.client.create_subscription(kind, topic, listen, KEEP_ALL)
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end:
            while self._received[topic]:
                msg = self._received[topic].popleft()
                if requested(msg):
                    return msg
            self.executor.spin_once(0.05)
        raise AssertionError(f'nothing on {topic} fulfilled the condition')

    def diagnosis(self, requested: Callable[[Diagnosis], bool] = bool) -> Diagnosis:
        """Serve until the diagnostics of the (first) filter fulfil a condition; return them."""

        def condition(msg: DiagnosticArray) -> bool:
            return requested(Diagnosis(msg.status[0]))

        return Diagnosis(
            self.wait_for_message(DiagnosticArray, '/diagnostics', condition).status[0]
        )

    def close(self) -> None:
        """End all."""
        self.executor.shutdown()
        for node in [self.client, *self._filters]:
            node.destroy_node()
        self.context.try_shutdown()


def _to_set(changes: dict[str, object]) -> list[Parameter]:
    """Make parameters; two underscores stand for the dot."""
    return [Parameter(name.replace('__', '.'), value=value) for name, value in changes.items()]


class Sensor:
    """Publishes clouds for a filter and collects its outputs."""

    def __init__(
        self,
        ros: Ros,
        topic: str,
        kind: Any = PointCloud2,
        outputs: str = '',
        published: Any = PointCloud2,
    ) -> None:
        self._ros = ros
        self._matched = Future()
        self.cleaned: list[PointCloud2] = []
        self.outliers: list[PointCloud2] = []
        self._expected = 0
        matched = PublisherEventCallbacks(matched=lambda _: self._matched.set_result(None))
        self._publisher = ros.client.create_publisher(
            kind, topic, KEEP_ALL, event_callbacks=matched
        )
        self._published = Future()
        self._subscriptions: list[Subscription] = []
        for name, received in (('cleaned', self.cleaned), ('outliers', self.outliers)):
            self._subscriptions.append(
                ros.client.create_subscription(
                    published, f'{outputs or topic}/{name}', self._collect(received), KEEP_ALL
                )
            )

    def _collect(self, outputs: list[PointCloud2]) -> Any:
        def collect(msg: PointCloud2) -> None:
            outputs.append(msg)
            if len(self.cleaned) == len(self.outliers) == self._expected:
                self._published.set_result(time.monotonic())

        return collect

    def destroy(self) -> None:
        """Let go of its topics."""
        self._ros.client.destroy_publisher(self._publisher)
        for subscription in self._subscriptions:
            self._ros.client.destroy_subscription(subscription)

    def wait_for_filter(self, node: OutlierFilterNode | Channel) -> None:
        """Serve until the topics of both sides are connected, all three."""
        self._ros.wait(self._matched)
        channel = node.channels[0] if isinstance(node, OutlierFilterNode) else node
        publishers = (channel.publisher.cleaned, channel.publisher.outliers)
        # The filter's side knows of the sensor later than the sensor of the filter, and what it
        # does not know of it does not receive: it does not ask for clouds again.
        clouds = channel._clouds
        assert clouds is not None
        while not (
            clouds.get_publisher_count()
            and all(publisher.get_subscription_count() for publisher in publishers)
        ):
            self._ros.executor.spin_once(0.05)

    def publish(self, msg: PointCloud2 | bytes, expected: int) -> None:
        """Publish a cloud, or bytes as one; ``expected`` outputs are due in all."""
        self._expected = expected
        self._published = Future()
        self._publisher.publish(msg)

    def wait_for_outputs(self) -> float:
        """Serve until the expected outputs are there; return when (monotonic, seconds)."""
        return float(self._ros.wait(self._published))


def receive(channel: Channel, msg: PointCloud2) -> None:
    """Let a channel that filters receive a cloud, as from the middleware."""
    channel.take(serialize_message(msg))


def wait_for_thread(node: OutlierFilterNode) -> None:
    """Wait until the threads of a node that is started have done all they were given."""
    for channel in node.channels:
        done = threading.Event()
        channel.worker.inbox.order(done.set, in_turn=True)
        assert done.wait(TIMEOUT)


def hold_up(node: OutlierFilterNode) -> threading.Event:
    """Hold up the thread that filters, as a block that takes long does, until the event is set."""
    begun, go_on = threading.Event(), threading.Event()

    def wait() -> None:
        begun.set()
        assert go_on.wait(TIMEOUT)

    node.channels[0].worker.inbox.order(wait)
    assert begun.wait(TIMEOUT)
    return go_on


def line(begin: float, count: int = 100) -> PointCloud2:
    """Make 10 ms of a straight scan line with one outlier, from ``begin`` seconds on."""
    t = np.arange(count) * 0.01 / count
    z = np.random.default_rng(7).normal(0, 0.005, count)
    z[count // 2] = 1
    columns = {'y': ('f4', 10 * t), 'z': ('f4', z), 'time': ('f4', t)}
    rows = table(count, ring=('u2', np.ones(count)), **columns)
    return cloud(rows, STAMP + round(begin * SECOND))


def broken() -> PointCloud2:
    """Make a cloud that cannot be read."""
    msg = line(0)
    msg.point_step = 3
    return msg


NO_CLOUD = b'\xff' * 40  # as another program may publish it under the name of a cloud


def rejected(outputs: list[SplitCloud]) -> list[int]:
    """Count the outliers of each output."""
    return [output.outliers.width for output in outputs]
