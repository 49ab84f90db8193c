# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a channel: advertised, subscribed to, and emptied at the end."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import PointCloud2

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

# Clouds kept while the executor is busy: nobody is called with those that the middleware replaces.
INPUT_DEPTH = 50
OUTPUT_DEPTH = 10  # clouds kept for a subscriber that is slow
ODOMETRY_DEPTH = 1000  # poses kept while the executor is busy


def advertise(node: Node, name: str) -> Publisher:
    """Make the publisher of clouds."""
    return node.create_publisher(
        PointCloud2,
        name,
        QoSProfile(depth=OUTPUT_DEPTH),
        qos_overriding_options=QoSOverridingOptions.with_default_policies(),
    )


def subscribe(
    node: Node, name: str, receive: Callable[[bytes], object], lost: Callable[[Any], object]
) -> Subscription:
    """Subscribe to clouds as bytes; ``lost`` is called where the middleware says of losses."""

    def create(events: SubscriptionEventCallbacks) -> Subscription:
        return node.create_subscription(
            PointCloud2,
            name,
            receive,
            QoSProfile(depth=INPUT_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT),
            raw=True,
            event_callbacks=events,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    try:
        return create(SubscriptionEventCallbacks(message_lost=lost))
    except UnsupportedEventTypeError:  # not by every middleware
        return create(SubscriptionEventCallbacks())


def subscribe_odometry(
    node: Node, name: str, receive: Callable[[Odometry], object]
) -> Subscription:
    """Subscribe to odometry."""
    return node.create_subscription(
        Odometry,
        name,
        receive,
        QoSProfile(depth=ODOMETRY_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT),
        qos_overriding_options=QoSOverridingOptions.with_default_policies(),
    )


def end(node: Node, subscription: Subscription) -> list[Any]:
    """End a subscription; return what was received and no executor will serve any more."""
    take = partial(subscription.handle.take_message, subscription.msg_type, subscription.raw)
    with subscription.handle:
        received = [taken[0] for taken in iter(take, None)]
    node.destroy_subscription(subscription)
    return received
