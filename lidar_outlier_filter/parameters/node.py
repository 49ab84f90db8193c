# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of a node on a vehicle: motion, load, health."""

from dataclasses import dataclass

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import declare


@dataclass(frozen=True)
class MotionParameters:
    """Where the sensor is when, so that points of different times lie in one frame."""

    source: str = declare(
        'none',
        'none: clouds are georeferenced, or a sweep is short; odometry: nav_msgs/Odometry on '
        'motion.topic, with the sensor at x to yaw in its child frame; tf: from the frame of the '
        'cloud to motion.fixed_frame.',
        choices=('none', 'odometry', 'tf'),
        fixed=True,
    )
    topic: str = declare('odometry', 'Topic of the odometry.', fixed=True)
    fixed_frame: str = declare('odom', 'Fixed frame (tf).', fixed=True)
    x: float = declare(0.0, 'Sensor in front of the child frame.', 'm', -1000.0, 1000.0, fixed=True)
    y: float = declare(0.0, 'Sensor to the left of it.', 'm', -1000.0, 1000.0, fixed=True)
    z: float = declare(0.0, 'Sensor above it.', 'm', -1000.0, 1000.0, fixed=True)
    roll: float = declare(
        0.0,
        'Its rotation, first about x, as static_transform_publisher has it.',
        'rad',
        -7,
        7,
        fixed=True,
    )
    pitch: float = declare(0.0, 'Then about y.', 'rad', -7.0, 7.0, fixed=True)
    yaw: float = declare(0.0, 'Then about z.', 'rad', -7.0, 7.0, fixed=True)
    max_gap: float = declare(
        0.2, 'Maximum time between two poses for interpolation.', 's', 1e-6, 60.0, fixed=True
    )

    def check(self, inputs: int) -> None:
        """Refuse one mounting for several inputs."""
        if inputs > 1 and self.source == 'odometry':
            must_be = "'none' or 'tf' with several inputs, which are not at the same place"
            raise ParameterError('motion.source', must_be, "'odometry'")


@dataclass(frozen=True)
class LoadParameters:
    """Limits of the queue of clouds, and its policy under overload."""

    policy: str = declare(
        'drop_oldest',
        'When clouds arrive faster than they are filtered: drop_oldest: the oldest are dropped; '
        'pass_through: they pass unfiltered, as do those that a detector fails on; degrade: only '
        'detectors along scan lines filter them, and the rest, or all if the chain has none, '
        'passes unfiltered.',
        choices=('drop_oldest', 'pass_through', 'degrade'),
    )
    clouds: int = declare(
        1000, 'Maximum number of pending clouds; the oldest is dropped.', '', 1, 100_000
    )
    megabytes: int = declare(512, 'Maximum memory of pending clouds.', 'MB', 1, 1_000_000)


# Above these, and above the limit of the warning, the level is ERROR.
ERROR_LIMITS = {'delay': 1.5, 'unfiltered': 0.5, 'rejected': 0.9, 'untested': 1.0, 'silence': 10.0}


@dataclass(frozen=True)
class HealthLimits:
    """Limits above which the diagnostics warn, or report an error at :data:`ERROR_LIMITS`."""

    delay_warn: float = declare(
        0.9, '95th percentile of the delay of clouds, as a share of max_delay.', '', 0.0, 1000.0
    )
    unfiltered_warn: float = declare(
        0.0,
        'Share of the clouds that were refused, lost in transit, dropped, too many to filter, or '
        'judged without poses.',
        '',
        0.0,
        1.0,
    )
    rejected_warn: float = declare(
        0.0,
        'Share of the points that were rejected; 0: half of them, or more than is usual for a '
        'detector.',
        '',
        0.0,
        1.0,
    )
    untested_warn: float = declare(
        0.9, 'Share of the points that no detector could test.', '', 0.0, 1.0
    )
    silence_warn: float = declare(2.0, 'Time without a cloud.', 's', 0.0, 1e6)
