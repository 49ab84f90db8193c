# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hierarchical outlier detection as a detector of the chain."""

# ruff: noqa: PLC0415  a declaration is read wherever parameters are: kernels come when they are used

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.declaration import Detector, Kernels
from lidar_outlier_filter.core.detectors.dials import Dial, Threshold, decades, each, scaled
from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
from lidar_outlier_filter.core.detectors.scores import Scores

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters

SECOND = 2  # phase
SECOND_PHASE = 1 << 15  # beside its bit: the second phase rejected the point, not the first one


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    import numpy as np

    from lidar_outlier_filter.core.detectors.hierarchical.detector import detect

    outcome = detect(seen.points.xyz, parameters.of(Hierarchical), seen.threads)
    return Scores(outcome.score, (outcome.phase == SECOND) * np.uint16(SECOND_PHASE))


def _threshold(_parameters: FilterParameters) -> Threshold:
    # Divided by the size of a cluster: the largest rejects most.
    values = dict.fromkeys(int(value) for value in reversed(decades(0, 4)))
    return scaled('hierarchical.min_cluster', values, lambda value: 1 / value)


def _dials(_parameters: FilterParameters) -> list[Dial]:
    return [
        each('hierarchical.global_confidence', (0.9, 0.99, 0.999)),
        each('hierarchical.local_confidence', (0.8, 0.95, 0.99)),
    ]


DETECTOR = Detector(
    name='hierarchical',
    bit=16,
    section=Hierarchical,
    detect=_detect,
    threshold=_threshold,
    dials=_dials,
    kernels=Kernels(seconds=4),
    extra={SECOND_PHASE: 'second_phase'},
    colour='#e69f00',
    rejects='belongs to a cluster of fewer than `min_cluster` points: of the minimum spanning '
    'tree, then (bit 32768 beside it) of the Gabriel graphs, without their long edges; '
    '`min_cluster` ÷ score is the size of the cluster',
    source='Sotoodeh 2007',
)
