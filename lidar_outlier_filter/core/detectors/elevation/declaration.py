# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The elevation as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels
from lidar_outlier_filter.core.detectors.dials import Dial, Threshold, decades, each, plain
from lidar_outlier_filter.core.detectors.elevation.parameters import Elevation
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.elevation.detector import detect

    return Scores(detect(seen.points.xyz, parameters.of(Elevation), seen.threads))


def _threshold(parameters: FilterParameters) -> Threshold:
    if parameters.of(Elevation).against == 'ground':
        return plain('elevation.height', decades(-1, 4))
    return plain('elevation.multiplier', decades(-1, 3))


def _dials(parameters: FilterParameters) -> list[Dial]:
    if parameters.of(Elevation).against == 'ground':
        return [each('elevation.depth_counts', (10, 20, 50, 100))]
    return [each('elevation.k', (10, 20, 30, 60))]


DETECTOR = Detector(
    name='elevation',
    bit=32,
    section=Elevation,
    detect=_detect,
    threshold=_threshold,
    dials=_dials,
    kernels=Kernels(seconds=8),
    colour='#56b4e9',
    rejects='is set apart in elevation, or differs by more than 3 σ from its neighbours on the '
    'map, or is too far above or below the ground (airborne clouds, z up)',
    source='Kang 2018',
)
