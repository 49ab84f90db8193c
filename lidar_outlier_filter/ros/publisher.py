# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The two publishers of the answers to one topic."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.duration import Duration

from lidar_outlier_filter.pipeline.topics import output_topics
from lidar_outlier_filter.ros.subscriptions import advertise

if TYPE_CHECKING:
    from rclpy.node import Node

    from lidar_outlier_filter.pipeline.pipeline import SplitCloud

ACKNOWLEDGE = Duration(seconds=2)  # how long the last clouds may take to arrive


class AnswerPublisher:
    """Publishes the cleaned and the outlier clouds of one topic."""

    def __init__(self, node: Node, topic: str) -> None:
        """Advertise ``topic``/cleaned and ``topic``/outliers."""
        self._node = node
        self._context = node.context
        self.cleaned, self.outliers = (advertise(node, name) for name in output_topics(topic))

    @property
    def requested(self) -> tuple[bool, bool]:
        """Whether somebody subscribes to cleaned and to outlier clouds.

        To be asked at each cloud: an event of the first subscriber would come after its first
        cloud.
        """
        cleaned, outliers = self.cleaned, self.outliers
        return bool(cleaned.get_subscription_count()), bool(outliers.get_subscription_count())

    def publish(self, answer: SplitCloud) -> bool:
        """Publish what was made of a cloud; False where ROS is shut down."""
        if not self._context.ok():
            return False
        if answer.cleaned is not None:
            self.cleaned.publish(answer.cleaned)
        if answer.outliers is not None:
            self.outliers.publish(answer.outliers)
        return True

    def wait(self) -> None:
        """Wait until every subscriber has what was published last, on both topics."""
        for publisher in (self.cleaned, self.outliers):
            publisher.wait_for_all_acked(ACKNOWLEDGE)

    def destroy(self) -> None:
        """Advertise no more."""
        for publisher in (self.cleaned, self.outliers):
            self._node.destroy_publisher(publisher)
