# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A sensor that moves while it measures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from helpers.profile_scanner import MOUNTING, Drive, seconds
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.motion import Odometry
from lidar_outlier_filter.pipeline.pipeline import Pipeline, SplitCloud

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray
    from sensor_msgs.msg import PointCloud2


SOR: dict[str, object] = {
    'chain': ('sor',),
    'sor.statistic': 'radius',
    'sor.radius': 0.3,
    'sor.min_neighbors': 4,
}

MOVING = SOR | MOUNTING | {'motion.source': 'odometry'}


class Moving:
    """A filter that is given clouds and odometry by their stamps."""

    def __init__(self, extra: Mapping[str, object] | None = None) -> None:
        parameters = FilterParameters().changed({**MOVING, **(extra or {})})
        self.motion = Odometry(parameters)
        self.filter = Pipeline(parameters, motion=self.motion)

    def run(
        self, clouds: Iterable[PointCloud2], odometry: Iterable[object], delay: float = 0.0
    ) -> list[SplitCloud]:
        """Feed what there is; odometry comes ``delay`` seconds after its time."""
        events = [(seconds(msg), 0, msg) for msg in clouds]
        events += [(seconds(msg) + delay, 1, msg) for msg in odometry]
        answers: list[SplitCloud] = []
        for _, is_odometry, msg in sorted(events, key=lambda event: event[:2]):
            if is_odometry:
                self.motion.take(msg)
                answers += self.filter.advance()
            else:
                answers += self.filter.process(msg, msg)
        return answers + self.filter.flush()


def rejected(drive: Drive, answers: list[SplitCloud]) -> NDArray[np.bool_]:
    """Return which points of the drive went to the outliers, by the time in their clouds."""
    mask = np.zeros(len(drive.t), np.bool_)
    for answer in answers:
        if answer.outliers.width:
            rows = structured(answer.outliers).reshape(-1)
            start = round(seconds(answer.outliers) * 1e9)
            mask |= np.isin(drive.t, rows['t'].astype(np.int64) + start)
    return mask
