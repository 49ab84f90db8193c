# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default detector as one of the chain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.dials import Threshold, plain
from lidar_outlier_filter.core.detectors.evidence.detector import detect, neighbours
from lidar_outlier_filter.core.detectors.evidence.pattern import judge
from lidar_outlier_filter.core.neighbours.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.neighbours.scan_pattern import find_pattern
from lidar_outlier_filter.core.scores import Scores
from lidar_outlier_filter.parameters.detectors import Evidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters

    Floats = NDArray[np.float64]
    Numbers = NDArray[np.uint8]


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    reason = np.zeros(len(seen.points), np.uint8) if parameters.scores else None
    return Scores(_judge(seen, parameters, reason), reason=reason)


def _judge(seen: Seen, parameters: FilterParameters, reason: Numbers | None) -> Floats:
    points, sensor = seen.points, parameters.evidence.sensor
    threshold = parameters.evidence.threshold
    if sensor != 'profile':
        # Azimuths are known in the sensor's own frame only.
        pattern = find_pattern(points.in_own_frame, seen.threads, spins=sensor == 'spinning')
        if pattern is not None:
            return judge(pattern, threshold, seen.threads, reason=reason)
    if sensor != 'spinning':
        pattern = find_profile_pattern(points, seen.threads)
        if pattern is not None:
            return judge(pattern, threshold, seen.threads, profile=True, reason=reason)
    return detect(seen.neighbourhood, points, parameters, reason)


def _threshold(_parameters: FilterParameters) -> Threshold:
    # A part of a sum of logarithms: even steps.
    return plain('evidence.threshold', (round(0.02 * n, 2) for n in range(5, 151)))


# Without dials: its weights are those of a regression.
DETECTOR = Detector(
    name='evidence',
    bit=64,
    section=Evidence,
    detect=_detect,
    threshold=_threshold,
    neighbours=lambda _: neighbours(),
    needs_lines=True,
    colour='#000000',
    rejects='is improbable by its features. Spinning sensors with evenly spaced rings, and profile '
    'scanners whose mirror turns evenly: trees on the scan pattern. Others: a weighted sum of '
    'distances, prediction along the line, distance from the local surface and neighbours on other '
    'lines; slanted groups in the air, too',
    source='this project',
)
