# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The elevation as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels
from lidar_outlier_filter.core.detectors.dials import decades, each, plain
from lidar_outlier_filter.core.detectors.elevation.parameters import Elevation
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.elevation.detector import detect

    return Scores(detect(seen.points.xyz, parameters.of(Elevation), seen.threads))


DETECTOR = Detector(
    name='elevation',
    bit=32,
    section=Elevation,
    detect=_detect,
    threshold=lambda _: plain('elevation.multiplier', decades(-1, 3)),
    dials=lambda _: [each('elevation.k', (10, 20, 30, 60))],
    kernels=Kernels(seconds=8),
    colour='#56b4e9',
    rejects='is set apart in elevation, or differs by more than 3 σ from its neighbours on the map '
    '(airborne clouds, z up)',
    source='Kang 2018',
)
