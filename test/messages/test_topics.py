# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the topics of a node are subscribed to and advertised."""

from types import SimpleNamespace

from helpers.nodes import Ros
from rclpy.qos import ReliabilityPolicy

MOVING = {'motion.source': 'odometry', 'motion.topic': 'odom'}


def test_quality_of_service(ros: Ros) -> None:
    """Best effort in, as any sensor can be received then; reliable out; and how much is kept."""
    node = ros.filter(parameters=MOVING)
    node.start()
    received = {item.topic_name: item.qos_profile for item in node.subscriptions}
    for name, depth in (('/points', 50), ('/odom', 1000)):
        assert received[name].reliability is ReliabilityPolicy.BEST_EFFORT
        assert received[name].depth == depth
    for publisher in (node.channels[0].publisher.cleaned, node.channels[0].publisher.outliers):
        assert publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
        assert publisher.qos_profile.depth == 10


def test_losses_are_counted_as_the_middleware_counts_them(ros: Ros) -> None:
    """Those since it reported some before, not those of all time again."""
    node = ros.filter()
    node.start()
    channel = node.channels[0]
    subscription = channel._clouds
    assert subscription is not None
    (handler,) = (item for item in subscription.event_handlers if item.callback == channel._lost)
    for total, change in ((3, 3), (5, 2)):
        handler.callback(SimpleNamespace(total_count=total, total_count_change=change))
    assert channel.health._missed['lost in transit'] == 5
