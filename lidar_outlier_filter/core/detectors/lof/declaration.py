# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The local outlier factor as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels, Measured
from lidar_outlier_filter.core.detectors.dials import NEIGHBOURS, Threshold, decades, each, plain
from lidar_outlier_filter.core.detectors.lof.parameters import Lof
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.annotations import Floats
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.parameters.filter import FilterParameters


def _measure(neighbourhood: Neighbourhood, parameters: FilterParameters) -> Floats:
    from lidar_outlier_filter.core.detectors.lof.detector import measure

    return measure(neighbourhood, parameters.of(Lof))


def _score(factor: Floats, _: Callable[[], Floats], parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.lof.detector import score

    return Scores(score(factor, parameters.of(Lof)))


def _neighbours(parameters: FilterParameters) -> int:
    from lidar_outlier_filter.core.detectors.lof.detector import neighbours

    return neighbours(parameters.of(Lof))


def _threshold(parameters: FilterParameters) -> Threshold:
    if parameters.of(Lof).statistic == 'lof2':
        return plain('lof.threshold', decades(-3, 3))
    # A factor of 1 is that of a good point: what counts is how much it is more.
    return plain('lof.threshold', (round(1 + more, 6) for more in decades(-2, 3)))


_MEASURED = Measured(_measure, _score, steps=3, by_place=True)
DETECTOR = Detector(
    name='lof',
    bit=4,
    section=Lof,
    detect=_MEASURED.detect,
    threshold=_threshold,
    dials=lambda _: [each('lof.min_pts', NEIGHBOURS)],
    neighbours=_neighbours,
    tiled=_MEASURED,
    kernels=Kernels(seconds=9),
    colour='#d55e00',
    rejects='lies in a place much less dense than its neighbours do (local outlier factor, or '
    'LOF2)',
    source='Breunig 2000, Sotoodeh 2006, Pirotti 2018',
)
