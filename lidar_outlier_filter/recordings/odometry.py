# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The odometry of a recording: which topic it is, and whether it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import ParameterError, RecordingError

if TYPE_CHECKING:
    from lidar_outlier_filter.parameters.node import Motion
    from lidar_outlier_filter.recordings.bags import Recording

ODOMETRY = 'nav_msgs/msg/Odometry'


def full_name(topic: str, node: str = '/outlier_filter_node') -> str:
    """Return the name of a topic as ROS expands it for a node without a namespace."""
    if topic.startswith('~'):
        return node + topic.removeprefix('~')
    return topic if topic.startswith('/') else f'/{topic}'


def check_motion(source: Recording, motion: Motion, topic: str) -> None:
    """Refuse motion that a recording cannot tell; ``topic`` is the full name of the odometry.

    Raises
    ------
    ParameterError
        If the poses would come from tf.
    RecordingError
        If the recording has no such odometry.

    """
    if motion.source == 'tf':
        must_be = "'none' or 'odometry' for a recording"
        raise ParameterError('motion.source', must_be, repr(motion.source))
    names = [channel.name for channel in source.topics if channel.msgtype == ODOMETRY]
    if motion.source == 'odometry' and topic not in names:
        must_be = 'one of the odometry topics ' + (', '.join(names) or '(none)')
        raise RecordingError('motion.topic', must_be, repr(topic))
