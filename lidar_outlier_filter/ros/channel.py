# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One topic in a node: its subscriptions, worker and publishers."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import CloudError, JudgingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.compressed import DECODERS
from lidar_outlier_filter.pipeline.pipeline import Pipeline
from lidar_outlier_filter.pipeline.statistics import Statistics
from lidar_outlier_filter.ros.backlog import Received, Treatment
from lidar_outlier_filter.ros.endpoints import SplitCloudPublisher, input_type, make_motion
from lidar_outlier_filter.ros.health import DROPPED, LOST, Backlog, Health, Report
from lidar_outlier_filter.ros.worker import DelayClock, Worker

Show = Callable[[str, StreamCloud, PointCloud2], object]  # topic, judged cloud, its message

# Messages kept while the executor is busy: the middleware replaces the oldest without a notice.
INPUT_DEPTH, ODOMETRY_DEPTH = 50, 1000
REFUSAL_PERIOD = 5.0  # seconds between two log lines about refused clouds
MEGABYTE = 1e6


class Channel:
    """One input topic, the odometry that it needs, and its two outputs.

    The constructor makes its publishers. ``start`` subscribes: clouds are received in the
    executor's thread, and filtered and published, in order, in a thread of their own.
    """

    def __init__(self, node: Node, topic: str, parameters: FilterParameters) -> None:
        """Make the filter and the publishers of ``topic``/cleaned and ``topic``/outliers."""
        self.topic = topic
        self.resolved: str = node.resolve_topic_name(topic)
        self.health = Health(get_rmw_implementation_identifier())
        self._node = node
        self._log = node.get_logger()
        self._parameters = parameters
        self._motion = make_motion(node, parameters)
        self._filter = Pipeline(parameters, self._log_info, self._log_warning, self._motion)
        self._filter.refuse = self._log_refusal
        self._filter.fail = self._log_failure
        self._filter.slow = self.health.slow
        self._clock = DelayClock(node)
        self._type = input_type(self.resolved, parameters.input_type)
        self.publisher = SplitCloudPublisher(node, topic, self._type.published)
        self.worker = Worker(self._filter, self.publisher, self._clock, self.health, parameters)
        self.worker.read = self._type.read
        if self._type.received is PointCloud2 and self.resolved.rpartition('/')[2] in DECODERS:
            self._log_warning('read as PointCloud2: point_cloud_interfaces is not installed')
        self._clouds: Subscription | None = None
        self._odometry: Subscription | None = None

    @property
    def statistics(self) -> Statistics:
        """Counts since the start."""
        return self._filter.statistics

    @property
    def waiting(self) -> int:
        """Count the clouds that were received and have no output yet."""
        return self._filter.pending + self.worker.inbox.clouds

    def start(self) -> None:
        """Subscribe, and filter in a thread of its own; also again."""
        self.worker.inbox.reopen()
        self.worker.start(f'filter {self.topic}')
        if self._motion is not None and self._motion.topic:
            self._odometry = self._subscribe(
                Odometry, self._motion.topic, self._take_pose, ODOMETRY_DEPTH
            )
        create = partial(
            self._subscribe, self._type.received, self.topic, self.take, INPUT_DEPTH, raw=True
        )
        try:
            events = SubscriptionEventCallbacks(message_lost=self._lost)
            self._clouds = create(event_callbacks=events)
        except UnsupportedEventTypeError:  # by some middlewares
            self._clouds = create()

    def change(self, parameters: FilterParameters) -> None:
        """Filter by other parameters from the next block on."""
        self._parameters = parameters
        self.worker.change(parameters)

    def show(self, show_cloud: Show) -> None:
        """Pass each cloud that is judged from now on to a function, in the filter's thread."""
        self._filter.show.append(partial(show_cloud, self.resolved))

    def sample(self, seconds: float) -> Report:
        """Report on the clouds of the seconds since the last sample."""
        self.worker.raise_failure()
        if self._clock.has_stopped and self._filter.pending:
            # The recording has ended: there is no time any more that could pass.
            self.worker.flush_pending()
        inbox = self.worker.inbox
        publishers = self._node.count_publishers(self.resolved)
        self._warn_of_losses(seconds)
        at = self.worker.oldest
        oldest = 0.0 if at is None else (self._clock.now() - at) / SECOND
        megabytes, waiting = inbox.size / MEGABYTE, self._filter.pending
        backlog = Backlog(inbox.clouds, megabytes, waiting, publishers, oldest)
        limits, max_delay = self._parameters.health, self._parameters.max_delay
        return self.health.sample(seconds, limits, max_delay, backlog, self._remarks())

    def close(self) -> None:
        """Receive no more; what was received is filtered, however much it is."""
        self.worker.inbox.close(self._end())

    def finish(self) -> None:
        """Filter and publish all received clouds before the node ends."""
        self.close()
        self.worker.finish()
        self._warn_of_losses(math.inf)

    def stop(self) -> None:
        """Drop all received clouds: outputs can no longer be published."""
        self.worker.inbox.close(discard=True)
        self.worker.join()

    def destroy(self) -> None:
        """Stop the worker, and destroy the publishers."""
        self.stop()
        self.publisher.destroy()

    def _remarks(self) -> list[str]:
        remarks = []
        if not self.worker.enabled:
            remarks.append('disabled: clouds pass unfiltered')
        if self.worker.overload.treatment is not Treatment.FILTER:
            remarks.append(f'overload: clouds are {self.worker.overload.treatment.value}')
        name = self.publisher.cleaned.topic_name
        if (count := self._node.count_publishers(name)) > 1:
            remarks.append(f'{count} publishers on {name}: another node has the same outputs')
        own = self._type.name  # others are never connected
        found = {one.topic_type for one in self._node.get_publishers_info_by_topic(self.resolved)}
        remarks += [
            f'{other} is published, {own} is received (input_type)'
            for other in sorted(found - {own})
        ]
        if self._clock.has_stopped:
            remarks.append('use_sim_time is set but /clock is not published')
        return remarks

    def _warn_of_losses(self, seconds: float) -> None:
        """Warn of lost or unfiltered clouds if due; ``seconds`` is the time since the last call."""
        policy = self._parameters.load.policy
        if warning := self.health.loss_warning(policy, seconds):
            self._log_warning(warning)

    def _log_refusal(self, err: CloudError) -> None:
        self._log.warning(
            f'{self.resolved}: refused a cloud ({self.statistics.refused} so far): {err}',
            throttle_duration_sec=REFUSAL_PERIOD,
        )

    def _log_failure(self, err: JudgingError) -> None:
        self._log.error(f'{self.resolved}: a detector raised an error:\n{err.trace}')

    def _log_info(self, text: str) -> None:
        self._log.info(f'{self.resolved}: {text}')

    def _log_warning(self, text: str) -> None:
        self._log.warning(f'{self.resolved}: {text}')

    def _end(self) -> list[Received]:
        """Unsubscribe; return the clouds that were received and not served."""
        # Poses last: those of the last clouds may be received after them.
        clouds, odometry, self._clouds, self._odometry = self._clouds, self._odometry, None, None
        received, poses = self._drain(clouds), self._drain(odometry)
        for msg in poses:
            self._take_pose(msg)
        return [self._noted(data) for data in received]

    def take(self, data: bytes) -> None:
        """Put a serialised cloud into the inbox."""
        self.worker.raise_failure()
        self.health.missed(DROPPED, self.worker.inbox.put(self._noted(data)))

    def _subscribe(
        self, kind: type, name: str, receive: Callable[[Any], object], depth: int, **options: Any
    ) -> Subscription:
        """Subscribe with ``best_effort``, which accepts publishers of every reliability."""
        return self._node.create_subscription(
            kind,
            name,
            receive,
            QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            **options,
        )

    def _drain(self, subscription: Subscription | None) -> list[Any]:
        """End a subscription; return the messages that no executor will serve any more."""
        if subscription is None:
            return []
        take = partial(subscription.handle.take_message, subscription.msg_type, subscription.raw)
        with subscription.handle:
            received = [taken[0] for taken in iter(take, None)]
        self._node.destroy_subscription(subscription)
        return received

    def _noted(self, data: bytes) -> Received:
        """Count a cloud, and note when it was received."""
        self.health.received()
        return Received(data, self.worker.clock.now())

    def _take_pose(self, msg: Odometry) -> None:
        if self._motion is not None:
            self._motion.take(msg)
            self.worker.inbox.wake()

    def _lost(self, event: Any) -> None:
        self.health.missed(LOST, event.total_count_change)
