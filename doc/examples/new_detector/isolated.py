# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector that another distribution adds: its parameters, its score, and its declaration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.parameters.declaration import Section, declare

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.parameters.filter import FilterParameters


@dataclass(frozen=True)
class Isolated(Section):
    """Parameters: default, sentence, unit, least, most."""

    limit: float = declare(0.5, 'Longest distance that is kept.', 'm', 1e-3, 1e3)


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Measure the distance to the nearest other point."""
    found = np.full(len(seen.points), np.nan)  # NaN: cannot decide
    near = seen.neighbourhood
    if len(near) > 1:
        other = near.nearest(1).index[:, 0]
        distance = np.linalg.norm(near.xyz - near.xyz[other], axis=1)
        found[near.order] = distance / parameters.of(Isolated).limit
    return Scores(found)


DETECTOR = Detector(
    name='isolated',
    bit=8192,
    section=Isolated,
    score=score,
    neighbours=lambda _: 1,
    rejects='has no other point beside it',
)
