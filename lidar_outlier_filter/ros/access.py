# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a page asks of a node, and sets, from a thread that is not the executor's."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING

from rclpy.parameter import Parameter as RosParameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.ros.node import OutlierFilterNode

PATIENCE = 10.0  # seconds until a node that serves nothing is given up


class NodeAccess:
    """Reads a node at any time, and changes it in the executor's thread only."""

    def __init__(self, node: OutlierFilterNode) -> None:
        """Name the node."""
        self._node = node

    @property
    def name(self) -> str:
        """The full name of the node."""
        return str(self._node.get_fully_qualified_name())

    @property
    def topics(self) -> list[str]:
        """The full names of its inputs; a managed node has none before it is configured."""
        return [channel.resolved for channel in self._node.channels]

    @property
    def parameters(self) -> FilterParameters:
        """The parameters as they were set last."""
        return self._node.filter_parameters

    def statuses(self) -> list[dict[str, object]]:
        """Say what the diagnostics said last, a status for each input."""
        return [
            {
                'name': status.hardware_id,
                'level': int.from_bytes(status.level, 'little'),
                'message': status.message,
                'values': {item.key: item.value for item in status.values},
            }
            for status in self._node.statuses
        ]

    def set(self, values: Mapping[str, str]) -> str:
        """Set all parameters or none, as `ros2 param set` does; say why not, '' where they are.

        What the node has not begun in time is withdrawn: it does not come later.
        """
        answer: Future[str] = Future()

        def apply() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            given = [RosParameter(name, value=value) for name, value in values.items()]
            try:
                result = self._node.set_parameters_atomically(given)
            except BaseException as err:
                answer.set_exception(err)
                raise
            answer.set_result('' if result.successful else result.reason)

        executor = self._node.executor
        if executor is None:
            return 'the node must run, got one that starts or ends'
        executor.create_task(apply)
        try:
            return answer.result(PATIENCE)
        except TimeoutError:
            if answer.cancel():
                return f'the node must answer within {PATIENCE:g} s, got nothing'
            return answer.result()  # it has begun, and ends soon
