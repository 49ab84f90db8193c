# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The ways in which the default judges a cloud, and the choice between them."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.parameters import (
    BoostedTrees,
    SpinningWeights,
    Weights,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import find_either, judge
from lidar_outlier_filter.core.detectors.boosted_trees.survey import far
from lidar_outlier_filter.core.detectors.boosted_trees.survey import judge as survey
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.detector import detect as sum_up
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.detector import look_first
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.surface import K
from lidar_outlier_filter.core.detectors.declaration import Reaching
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.neighbours.floor import look_around
from lidar_outlier_filter.core.points.scan_lines import has_lines, spins

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bytes, Floats
    from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import FoundPattern
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.parameters.filter import FilterParameters


class Way(Enum):
    """How the default judges a cloud, for people."""

    PATTERN = 'trees on the scan pattern'
    SURVEY = 'trees on the neighbours of each point'
    SUM = 'a weighted sum of features'


def choose(seen: DetectorInput, parameters: FilterParameters) -> tuple[Way, FoundPattern | None]:
    """Choose how points are judged, and find their scan pattern where that does it."""
    points, sensor = seen.points, parameters.of(BoostedTrees).sensor
    is_lined = has_lines(points) or points.ring is not None
    if sensor == 'survey' or (seen.whole and not is_lined and sensor != 'free'):
        return Way.SURVEY, None
    found = seen.cached(('pattern', sensor), lambda: find_either(points, sensor, seen.threads))
    if found is not None:
        return Way.PATTERN, found
    if seen.whole and (points.ring is not None or (sensor == 'auto' and not spins(points))):
        # Airborne scanners, and others whose mirrors swing.
        return Way.SURVEY, None
    return Way.SUM, None


def find_sum(
    seen: DetectorInput,
    parameters: FilterParameters,
    reason: Bytes | None = None,
    parts: Floats | None = None,
) -> Floats:
    """Score every point by the weighted sum; the first look at them is taken once."""
    first = None
    if len(seen.points) > K:
        hood = seen.neighbourhood
        weights = parameters.of(Weights), parameters.of(SpinningWeights)
        name = 'first', parameters.of(BoostedTrees).sensor, parameters.gap_factor, *weights
        first = seen.cached(name, lambda: look_first(hood, seen.points, parameters))
    return sum_up(seen.neighbourhood, seen.points, parameters, reason, parts, first)


def detect(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point in the way that suits the cloud."""
    points, threshold = seen.points, parameters.of(BoostedTrees).threshold
    way, found = choose(seen, parameters)
    if way is Way.SURVEY:
        around = look_around(points.xyz, np.arange(len(points)), parameters.threads)
        odds, _ = survey.measure(points.xyz, around, parameters.threads)
        return Scores(survey.score(odds, threshold), scaled=True, way=way.value)
    reason = np.zeros(len(points), np.uint8) if parameters.scores else None
    if found is None:
        score = find_sum(seen, parameters, reason)
        return Scores(score, reason=reason, way=way.value)
    score = judge(found.pattern, threshold, seen.threads, profile=found.profile, reason=reason)
    return Scores(score, reason=reason, scaled=True, way=way.value)


# Without scan lines, as in tiles.
REACHING = Reaching(
    lambda xyz, where, parameters: look_around(xyz, where, parameters.threads),
    lambda xyz, wanted, around, parameters: survey.measure(xyz, around, parameters.threads, wanted),
    lambda odds, parameters: Scores(
        survey.score(odds, parameters.of(BoostedTrees).threshold),
        scaled=True,
        way=Way.SURVEY.value,
    ),
    lambda: (far.MOST, far.STEPS),
)
