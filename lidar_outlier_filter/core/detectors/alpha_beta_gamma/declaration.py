# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The smoother as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.alpha_beta_gamma.parameters import AlphaBetaGamma
from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels, Tiled
from lidar_outlier_filter.core.detectors.dials import Dial, each, significance
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.core.points.scan_lines import Lines
    from lidar_outlier_filter.parameters.filter import FilterParameters

WINDOWS = (3, 4, 5, 7, 10, 15)


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    from lidar_outlier_filter.core.detectors.alpha_beta_gamma.detector import detect

    def of_lines(points: Points, lines: Lines) -> Scores:
        outcome = detect(points, lines, parameters.of(AlphaBetaGamma))
        return Scores(outcome.score, passes=outcome.passes)

    return seen.along_lines(of_lines)


def _dials(_parameters: FilterParameters) -> list[Dial]:
    name = 'alpha_beta_gamma.'
    return [
        tuple({f'{name}before': n, f'{name}after': n} for n in WINDOWS),
        # The least that makes a prediction.
        tuple({f'{name}order': n, f'{name}min_window': n + 2} for n in (1, 2)),
        each(f'{name}sides', ('either', 'both')),
    ]


DETECTOR = Detector(
    name='alpha_beta_gamma',
    bit=1,
    section=AlphaBetaGamma,
    detect=_detect,
    threshold=lambda _: significance('alpha_beta_gamma.significance'),
    dials=_dials,
    needs_lines=True,
    columns={'sigma': 'alpha_beta_gamma.sigma_field'},
    tiled=Tiled.BY_LINE,
    kernels=Kernels(seconds=1),
    colour='#0072b2',
    rejects='is improbable after the points before and behind it in its line segment',
    source='Leslar, Wang and Hu 2010, (a)',
)
