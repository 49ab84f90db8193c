# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The quadric surfaces as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels, Tiled
from lidar_outlier_filter.core.detectors.dials import Dial, each, significance
from lidar_outlier_filter.core.detectors.quadric.parameters import Quadric
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.quadric.detector import detect

    sigma = seen.points.sigma
    variance = None if sigma is None else sigma**2
    return Scores(detect(seen.neighbourhood, parameters.of(Quadric), variance))


def _neighbours(parameters: FilterParameters) -> int:
    from lidar_outlier_filter.core.detectors.quadric.detector import neighbours

    return neighbours(parameters.of(Quadric))


def _dials(parameters: FilterParameters) -> list[Dial]:
    surfaces = each('quadric.surfaces', (1, 3))
    if parameters.of(Quadric).window == 'patch':
        return [each('quadric.k', (15, 20, 30, 50)), surfaces]
    return [each('quadric.section', (32, 64, 128, 256)), surfaces]


DETECTOR = Detector(
    name='quadric',
    bit=2,
    section=Quadric,
    detect=_detect,
    threshold=lambda _: significance('quadric.significance'),
    dials=_dials,
    neighbours=_neighbours,
    tiled=Tiled.WITH_HALO,
    kernels=Kernels(seconds=45),
    colour='#cc79a7',
    rejects='lies on none of the planes, paraboloids or quadrics through its neighbourhood: '
    '`window: section` tests all points of a section at once, `patch` each in its own patch',
    source='Leslar 2010, (18) to (31)',
)
