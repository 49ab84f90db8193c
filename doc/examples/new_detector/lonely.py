# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector of one's own: its parameters, what it computes, and its declaration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.core.detectors.dials import decades, plain
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.parameters.declaration import Section, declare

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters


@dataclass(frozen=True)
class Lonely(Section):
    """Parameters: default, sentence, unit, least, most."""

    limit: float = declare(0.5, 'Longest distance that is kept.', 'm', 1e-3, 1e3)


def detect(seen: Seen, parameters: FilterParameters) -> Scores:
    """Measure the distance to the nearest other point."""
    score = np.full(len(seen.points), np.nan)  # NaN: cannot decide
    near = seen.neighbourhood
    if len(near) > 1:
        other = near.nearest(1).index[:, 0]
        distance = np.linalg.norm(near.xyz - near.xyz[other], axis=1)
        score[near.order] = distance / parameters.of(Lonely).limit
    return Scores(score)


DETECTOR = Detector(
    name='lonely',
    bit=128,
    section=Lonely,
    detect=detect,
    threshold=lambda _: plain('lonely.limit', decades(-3, 3)),
    neighbours=lambda _: 1,
    colour='#123456',
    rejects='has no other point beside it',
    source='this example',
)
