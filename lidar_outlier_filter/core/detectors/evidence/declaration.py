# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default detector as one of the chain."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.declaration import Detector, Reaching
from lidar_outlier_filter.core.detectors.dials import Threshold, plain
from lidar_outlier_filter.core.detectors.evidence.pattern.judge import find_either, judge
from lidar_outlier_filter.core.detectors.evidence.survey import far as survey_far
from lidar_outlier_filter.core.detectors.evidence.survey import judge as survey
from lidar_outlier_filter.core.detectors.evidence.survey.scale import typical_scale
from lidar_outlier_filter.core.detectors.evidence.weighted_sum.detector import detect, neighbours
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.points.scan_lines import has_lines, spins
from lidar_outlier_filter.parameters.detectors import Evidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.evidence.pattern.judge import FoundPattern
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Bools = NDArray[np.bool_]
    Numbers = NDArray[np.uint8]


class Way(Enum):
    """How the default judges a cloud, for people."""

    PATTERN = 'trees on the scan pattern'
    SURVEY = 'trees on the neighbours of each point'
    SUM = 'a weighted sum of features'


def choose(seen: Seen, parameters: FilterParameters) -> tuple[Way, FoundPattern | None]:
    """Choose how points are judged, and find their scan pattern where that does it."""
    points, sensor = seen.points, parameters.evidence.sensor
    is_lined = has_lines(points) or points.ring is not None
    if sensor == 'survey' or (seen.whole and not is_lined):
        return Way.SURVEY, None
    found = find_either(points, sensor, seen.threads)
    if found is not None:
        return Way.PATTERN, found
    if seen.whole and (points.ring is not None or (sensor == 'auto' and not spins(points))):
        # Airborne scanners, and others whose mirrors swing.
        return Way.SURVEY, None
    return Way.SUM, None


def _detect(seen: Seen, parameters: FilterParameters) -> Scores:
    points, threshold = seen.points, parameters.evidence.threshold
    way, found = choose(seen, parameters)
    if way is Way.SURVEY:
        return _as_survey(seen, parameters)
    reason = np.zeros(len(points), np.uint8) if parameters.scores else None
    if found is None:
        score = detect(seen.neighbourhood, points, parameters, reason)
        return Scores(score, reason=reason, way=way.value)
    score = judge(found.pattern, threshold, seen.threads, profile=found.profile, reason=reason)
    return Scores(score, reason=reason, scaled=True, way=way.value)


def _as_survey(seen: Seen, parameters: FilterParameters) -> Scores:
    xyz = seen.points.xyz
    typical = _scale(xyz, np.arange(len(xyz)), parameters)
    odds, _ = survey.measure(xyz, typical, parameters.threads)
    return _survey_score(odds, parameters)


def _scale(xyz: Floats, where: Ints, parameters: FilterParameters) -> float:
    return typical_scale(xyz, where, parameters.threads)


def _odds(
    xyz: Floats, wanted: Bools, typical: float, parameters: FilterParameters
) -> tuple[Floats, Floats]:
    return survey.measure(xyz, typical, parameters.threads, wanted)


def _survey_score(odds: Floats, parameters: FilterParameters) -> Scores:
    score = survey.score(odds, parameters.evidence.threshold)
    return Scores(score, scaled=True, way=Way.SURVEY.value)


def _threshold(_parameters: FilterParameters) -> Threshold:
    # A part of a sum of logarithms: even steps.
    return plain('evidence.threshold', (round(0.02 * n, 2) for n in range(5, 151)))


# Without dials: its weights are those of a regression.
DETECTOR = Detector(
    name='evidence',
    bit=64,
    section=Evidence,
    detect=_detect,
    threshold=_threshold,
    neighbours=lambda _: neighbours(),
    uses_lines=True,
    # Lines are not looked at in tiles.
    tiled=Reaching(_scale, _odds, _survey_score, survey_far.MOST, survey_far.STEPS),
    colour='#000000',
    rejects='is improbable by its features. Spinning sensors, and profile '
    'scanners whose mirror turns evenly: trees on the scan pattern. Others: a weighted sum of '
    'distances, prediction along the line, distance from the local surface and neighbours on other '
    'lines; slanted groups in the air, too',
    source='this project',
)
