# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What each feature adds to the verdicts of the default, whichever way it judges.

Trees add up to log-odds, a weighted sum to the score itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.evidence.explain.pattern_reasons import (
    average_of,
    contribute,
    explain,
)
from lidar_outlier_filter.core.detectors.evidence.parameters import Evidence
from lidar_outlier_filter.core.detectors.evidence.survey import far as survey_far
from lidar_outlier_filter.core.detectors.evidence.survey import judge as survey
from lidar_outlier_filter.core.detectors.evidence.survey import near as survey_near
from lidar_outlier_filter.core.detectors.evidence.survey.far import MOST, Far
from lidar_outlier_filter.core.detectors.evidence.survey.model import load
from lidar_outlier_filter.core.detectors.evidence.ways import Way, choose
from lidar_outlier_filter.core.detectors.evidence.weighted_sum.detector import PARTS, detect
from lidar_outlier_filter.core.detectors.explanation import Contributions
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import find_places
from lidar_outlier_filter.core.neighbours.typical_scale import K, typical_scale

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Singles
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters


def contributions(seen: Seen, parameters: FilterParameters, wanted: Bools) -> Contributions:
    """Find what features add to the verdicts of the wanted ones of N points.

    Parameters
    ----------
    seen : what the default judged, more than 20 points
    parameters : by which it did
    wanted : (N,) bool

    """
    way, _ = choose(seen, parameters)
    if way is Way.SURVEY:
        return Contributions(way.value, survey_far.NAMES, *_of_survey(seen, wanted))
    if way is Way.PATTERN:
        sensor = parameters.of(Evidence).sensor
        found = explain(seen.points, seen.threads, sensor=sensor, wanted=wanted)
        return Contributions(way.value, found.names, found.added[:, wanted], found.average[wanted])
    parts = np.zeros((len(wanted), len(PARTS)))
    detect(seen.neighbourhood, seen.points, parameters, parts=parts)
    nothing = np.zeros(np.count_nonzero(wanted), np.float32)
    return Contributions(way.value, PARTS, parts[wanted].T.astype(np.float32), nothing)


def _of_survey(seen: Seen, wanted: Bools) -> tuple[Singles, Singles]:
    places = find_places(seen.points.xyz)
    asked = np.bincount(places.of, wanted) > 0
    added, average = _of_places(np.take(seen.points.xyz, places.first, axis=0), asked, seen.threads)
    rows = np.cumsum(asked)[places.of[wanted]] - 1
    return added[:, rows], average[rows]


def _of_places(xyz: Floats, wanted: Bools, threads: int) -> tuple[Singles, Singles]:
    if len(xyz) <= K:  # they are not judged
        count = np.count_nonzero(wanted)
        return np.zeros((survey_far.COUNT, count), np.float32), np.zeros(count, np.float32)
    model = load()
    hood = Neighbourhood(xyz, K, threads)
    near = survey.neighbours(hood, typical_scale(xyz, np.arange(len(xyz)), threads))
    first, _ = survey.first_odds(near, model.first, threads)
    which = np.flatnonzero(wanted[hood.order])  # in tree order
    again = first[which] > np.float32(model.doubtful)
    added = np.zeros((survey_far.COUNT, len(which)), np.float32)
    once, twice = which[~again], which[again]
    values = np.empty((survey_near.COUNT, len(once)), np.float32)
    survey.measure_near(near, once, values)
    part = np.zeros_like(values)
    contribute(model.first, values, np.ones(len(once), np.bool_), part)
    added[: survey_near.COUNT, ~again] = part
    values = np.empty((survey_far.COUNT, len(twice)), np.float32)
    far = Far(near, first, hood.nearest_of(twice, min(MOST, len(hood) - 1)))
    survey.measure_far(far, twice, values)
    part = np.zeros_like(values)
    contribute(model.again, values, np.ones(len(twice), np.bool_), part)
    added[:, again] = part
    average = np.where(again, average_of(model.again), average_of(model.first))
    back = np.argsort(hood.order[which], kind='stable')
    return added[:, back], average[back].astype(np.float32)
