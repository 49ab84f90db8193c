# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Publishers of one topic's clouds, reading of serialised clouds and scans, and poses by tf.

rclpy copies the points three times under the GIL. So it reads the other fields only; the points
are a view of the received bytes.
"""

import importlib
import struct
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import LaserScan, MultiEchoLaserScan, PointCloud2
from std_msgs.msg import String

from lidar_outlier_filter.errors import CloudError, ParameterError, quote_error
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.compressed import BYTE_ORDERS, DECODERS, decompressed, layout
from lidar_outlier_filter.pipeline.motion import PoseSource
from lidar_outlier_filter.pipeline.pipeline import SplitCloud
from lidar_outlier_filter.pipeline.tf import DYNAMIC, STATIC, Tf, pose_source
from lidar_outlier_filter.pipeline.topics import (
    CLOUD,
    COMPRESSED,
    MULTI_ECHO,
    SCAN,
    output_topics,
)

# Names that a launch may remap instead of `points` and its outputs
INPUT, OUTPUTS = '~/input', ('~/output', '~/outliers')
SCANS = {SCAN: LaserScan, MULTI_ECHO: MultiEchoLaserScan}
OUTPUT_DEPTH = 10  # clouds kept for a slow subscriber
TF_DEPTH = 100  # messages, as tf2's own listener keeps
ACKNOWLEDGE_TIMEOUT = Duration(seconds=2)  # until the last clouds have arrived


class SplitCloudPublisher:
    """Publishes the cleaned and the outlier clouds of one topic."""

    def __init__(self, node: Node, topic: str, kind: type = PointCloud2) -> None:
        """Advertise ``topic``/cleaned and ``topic``/outliers, by the name it is remapped to."""
        self._node = node
        self._context = node.context
        self.cleaned, self.outliers = (
            node.create_publisher(
                kind,
                name,
                QoSProfile(depth=OUTPUT_DEPTH),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
            for name in _output_names(node, topic)
        )
        # Latched: who subscribes later knows it, too.
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._state = node.create_publisher(String, f'{self.cleaned.topic_name}/state', latched)

    @property
    def requested(self) -> tuple[bool, bool]:
        """Whether cleaned and outlier clouds have subscribers.

        Read it for each cloud: a subscription event would arrive after the first cloud.
        """
        cleaned, outliers = self.cleaned, self.outliers
        return bool(cleaned.get_subscription_count()), bool(outliers.get_subscription_count())

    def publish(self, split: SplitCloud) -> bool:
        """Publish both clouds; return False where ROS is shut down."""
        if not self._context.ok():
            return False
        for publisher, cloud in ((self.cleaned, split.cleaned), (self.outliers, split.outliers)):
            if cloud is not None:
                publisher.publish(cloud)
        return True

    def say(self, state: str) -> None:
        """Publish what the clouds are from now on: filtered, unfiltered, or none."""
        if self._context.ok():
            self._state.publish(String(data=state))

    def wait(self) -> None:
        """Wait until every subscriber has the last clouds of both topics."""
        for publisher in (self.cleaned, self.outliers):
            publisher.wait_for_all_acked(ACKNOWLEDGE_TIMEOUT)

    def destroy(self) -> None:
        """Destroy the publishers."""
        for publisher in (self.cleaned, self.outliers, self._state):
            self._node.destroy_publisher(publisher)


def _output_names(node: Node, topic: str) -> list[str]:
    """Name the outputs after the remapped input, unless they are remapped themselves."""
    own = output_topics(node.resolve_topic_name(topic, only_expand=True))
    names = own, OUTPUTS if topic == INPUT else own, output_topics(node.resolve_topic_name(topic))
    return [
        remapped(node, one) or remapped(node, other) or name
        for one, other, name in zip(*names, strict=True)
    ]


def remapped(node: Node, name: str) -> str:
    """Return the topic that replaces ``name`` by a rule; '' without a rule."""
    new = str(node.resolve_topic_name(name))
    return new if new != node.resolve_topic_name(name, only_expand=True) else ''


def make_motion(node: Node, parameters: FilterParameters) -> PoseSource | None:
    """Make the pose source that ``motion.source`` names; None for 'none'. One by tf listens."""
    made = pose_source(parameters)
    if isinstance(made, Tf):
        try:
            kind = importlib.import_module('tf2_msgs.msg').TFMessage
        except ImportError as err:
            must_be = "'none' or 'odometry' where tf2_msgs is not installed"
            raise ParameterError('motion.source', must_be, "'tf'") from err
        latched = QoSProfile(depth=TF_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(kind, DYNAMIC, made.take, TF_DEPTH)
        node.create_subscription(kind, STATIC, made.take_static, latched)
    return made


class InputType(NamedTuple):
    """The type of an input topic, its name and that of its outputs, and how messages are read."""

    received: type
    name: str
    published: type
    read: Callable[[bytes], Any]


def input_type(topic: str, name: str) -> InputType:
    """Return the type that is called ``name`` in ``sensor_msgs``.

    A topic of point_cloud_transport is named after the format; without its messages it is plain.
    """
    full = f'sensor_msgs/msg/{name}'
    if full in SCANS:
        kind = SCANS[full]
        return InputType(kind, full, kind, partial(_by_rclpy, kind=kind))
    if topic.rpartition('/')[2] in DECODERS:
        with suppress(ImportError):
            kind = importlib.import_module('point_cloud_interfaces.msg').CompressedPointCloud2
            read = lambda data: read_cloud(decompressed(data))  # noqa: E731
            return InputType(kind, COMPRESSED, PointCloud2, read)
    return InputType(PointCloud2, CLOUD, PointCloud2, read_cloud)


def read_cloud(received: bytes) -> PointCloud2:
    """Read a serialised cloud; its ``data`` is a read-only memoryview of ``received``.

    Such a cloud can be read and split, not published. A cloud that is not plain CDR is read by
    rclpy as a whole.

    Raises
    ------
    CloudError
        If it is truncated, or not a cloud.

    """
    order = BYTE_ORDERS.get(received[:2])
    if order is None:
        return _by_rclpy(received)
    begin, end, *_ = layout(received, order)
    # The same cloud without points: length 0, then is_dense.
    bare = received[: begin - 4] + bytes(4) + struct.pack('?', received[end])
    msg = _by_rclpy(bare)
    # The setter accepts arrays only, or checks every byte.
    msg._data = memoryview(received)[begin:end]  # noqa: SLF001
    return msg


def _by_rclpy(data: bytes, kind: type = PointCloud2) -> Any:
    try:
        return deserialize_message(data, kind)
    except RuntimeError as err:  # of the middleware
        must_be, got = f'a sensor_msgs/msg/{kind.__name__}', f'other bytes ({quote_error(err)})'
        raise CloudError('a serialised cloud', must_be, got) from err
