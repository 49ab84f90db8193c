# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The odometry of a recording: which topic it is, and whether it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import ParameterError, RecordingError
from lidar_outlier_filter.stream.topics import ODOMETRY, resolve

if TYPE_CHECKING:
    from lidar_outlier_filter.parameters.node import MotionParameters
    from lidar_outlier_filter.recordings.bags import Recording


def check_motion(source: Recording, motion: MotionParameters) -> None:
    """Refuse motion that a recording does not hold.

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
    topic = resolve(motion.topic)
    names = [channel.name for channel in source.topics if channel.msgtype == ODOMETRY]
    if motion.source == 'odometry' and topic not in names:
        must_be = 'one of the odometry topics ' + (', '.join(names) or '(none)')
        raise RecordingError('motion.topic', must_be, repr(topic))
