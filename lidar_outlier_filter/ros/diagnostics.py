# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How a node says how it is: /diagnostics to read, ~/statistics to plot."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.parameters.filter import installed
from lidar_outlier_filter.ros.channel import Channel
from lidar_outlier_filter.ros.health import ERROR, OK, WARN, Report
from lidar_outlier_filter.ros.live_parameters import TunableNode

PERIOD = 1.0  # seconds
LEVELS = {OK: DiagnosticStatus.OK, WARN: DiagnosticStatus.WARN, ERROR: DiagnosticStatus.ERROR}


class Diagnostics:
    """Looks at the channels of a node once in a second of real time, and says what it sees."""

    def __init__(self, node: TunableNode, channels: Sequence[Channel]) -> None:
        self._node = node
        self._channels = channels
        self._status = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._plotted = node.create_publisher(Float64MultiArray, '~/statistics', 10)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._last = self._steady.now().nanoseconds
        self._timer = node.create_timer(PERIOD, self._sample, clock=self._steady)

    def end(self) -> None:
        """Stop sampling."""
        self._node.destroy_timer(self._timer)
        for publisher in (self._status, self._plotted):
            self._node.destroy_publisher(publisher)

    def _sample(self) -> None:
        now = self._steady.now().nanoseconds
        seconds = max(now - self._last, 1) / SECOND
        self._last = now
        reports = [channel.sample(seconds) for channel in self._channels]
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.status = [self._say(*both) for both in zip(self._channels, reports, strict=True)]
        self._status.publish(array)
        self._node.statuses = array.status
        self._plotted.publish(
            self._table([*reports[0].plotted], [[*one.plotted.values()] for one in reports])
        )

    def _say(self, channel: Channel, report: Report) -> DiagnosticStatus:
        # A detector that is refused may not be missed: no reason to warn in each status.
        refused = {f'refused detector {k}': str(err) for k, err in installed().refused.items()}
        values = report.values | refused
        # Named as those of diagnostic_updater are.
        return DiagnosticStatus(
            level=LEVELS[report.level],
            name=f'{self._node.get_fully_qualified_name().strip("/")}: {channel.resolved}',
            message=report.message,
            hardware_id=channel.resolved,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def _table(self, names: Sequence[str], rows: Sequence[Sequence[float]]) -> Float64MultiArray:
        """Make a table: a row for each topic, a column for each value."""
        topics = [channel.topic for channel in self._channels]
        dimensions = [
            MultiArrayDimension(label=','.join(labels), size=len(labels), stride=stride)
            for labels, stride in ((topics, len(topics) * len(names)), (names, len(names)))
        ]
        data = [value for row in rows for value in row]
        return Float64MultiArray(layout=MultiArrayLayout(dim=dimensions), data=data)
