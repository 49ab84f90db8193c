# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The distances to neighbours as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels, Measured
from lidar_outlier_filter.core.detectors.dials import (
    NEIGHBOURS,
    Dial,
    Threshold,
    decades,
    each,
    plain,
)
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.detectors.sor.parameters import Sor
from lidar_outlier_filter.parameters.declaration import walk

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.annotations import Floats
    from lidar_outlier_filter.core.detectors.dials import ScoreOf
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.parameters.filter import FilterParameters


def _measure(neighbourhood: Neighbourhood, parameters: FilterParameters) -> Floats:
    from lidar_outlier_filter.core.detectors.sor.detector import measure

    return measure(neighbourhood, parameters.of(Sor))


def _score(measured: Floats, range_m: Callable[[], Floats], parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.sor.detector import score

    scaled = parameters.of(Sor).range_scaled
    return Scores(score(measured, parameters.of(Sor), range_m() if scaled else None))


def _neighbours(parameters: FilterParameters) -> int:
    from lidar_outlier_filter.core.detectors.sor.detector import neighbours

    return neighbours(parameters.of(Sor))


def _threshold(parameters: FilterParameters) -> Threshold:
    if parameters.of(Sor).statistic == 'radius':
        return _radius_threshold(scaled=parameters.of(Sor).range_scaled)
    if parameters.of(Sor).statistic == 'sor2':
        return plain('sor.limit', decades(-4, 3))
    return _multiplier()


def _multiplier() -> Threshold:
    """Make the threshold of ``sor``: d against μ + m σ, so that two runs give it for all m."""
    name = 'sor.multiplier'

    def statistic(score_of: ScoreOf, _near: float) -> Floats:
        import numpy as np

        at_0 = score_of({name: 0.0}).astype(np.float64)  # d / μ
        at_1 = score_of({name: 1.0}).astype(np.float64)  # d / (μ + σ)
        with np.errstate(divide='ignore', invalid='ignore'):
            spread = at_0 / at_1 - 1  # σ / μ
            result: Floats = (at_0 - 1) / spread
        return result

    return Threshold(name, (0.0, *decades(-1, 3)), float, statistic)


def _radius_threshold(*, scaled: bool) -> Threshold:
    name = 'sor.radius'
    values = decades(-3, 3)
    if not scaled:
        return plain(name, values)

    def statistic(score_of: ScoreOf, _near: float) -> Floats:
        import numpy as np

        # Rejected beyond the larger of radius and range_factor × range: beyond both.
        smallest = next(item.low for item in walk(Sor, 'sor.') if item.name == name)
        beyond = score_of({name: smallest, 'sor.range_scaled': True}) > 1
        distance = score_of({name: 1.0, 'sor.range_scaled': False})
        return np.where(beyond, distance, 0.0)

    return Threshold(name, tuple(values), float, statistic)


def _dials(parameters: FilterParameters) -> list[Dial]:
    kind = parameters.of(Sor).statistic
    name = 'sor.min_neighbors' if kind == 'radius' else 'sor.k'
    dials = [each(name, (1, 2, *NEIGHBOURS[:4]) if kind == 'radius' else NEIGHBOURS)]
    # Under sor2 the limit is multiplied by it, and is searched itself.
    if parameters.of(Sor).range_scaled and kind != 'sor2':
        dials.append(each('sor.range_factor', (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2)))
    return dials


_MEASURED = Measured(_measure, _score, steps=1)
DETECTOR = Detector(
    name='sor',
    bit=8,
    section=Sor,
    detect=_MEASURED.detect,
    threshold=_threshold,
    dials=_dials,
    neighbours=_neighbours,
    tiled=_MEASURED,
    kernels=Kernels(seconds=6),
    colour='#009e73',
    rejects='is too far from its nearest neighbours: statistical (`sor`, `sor2`), or by `radius`; '
    'both may grow with the range (DSOR, DROR)',
    source="Pirotti 2018; equal to PCL's selection",
)
