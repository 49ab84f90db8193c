# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the default explains its scores, whichever way it judges; each feature in a few words.

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
from lidar_outlier_filter.core.detectors.evidence.explain.reasons import OF_SUM, REASON_NAMES
from lidar_outlier_filter.core.detectors.evidence.models import SURVEY_MODEL, load
from lidar_outlier_filter.core.detectors.evidence.parameters import Evidence
from lidar_outlier_filter.core.detectors.evidence.survey import far as survey_far
from lidar_outlier_filter.core.detectors.evidence.survey import judge as survey
from lidar_outlier_filter.core.detectors.evidence.survey import near as survey_near
from lidar_outlier_filter.core.detectors.evidence.survey.far import MOST, Far
from lidar_outlier_filter.core.detectors.evidence.ways import Way, choose
from lidar_outlier_filter.core.detectors.evidence.weighted_sum.detector import PARTS, detect
from lidar_outlier_filter.core.detectors.explanation import Contributions, Explanation, ReasonName
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import K, find_places, typical_scale

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Singles
    from lidar_outlier_filter.core.detectors.seen import Seen
    from lidar_outlier_filter.parameters.filter import FilterParameters

_PATTERN = {
    'step': 'distance to the nearer return beside it in its line',
    'leap': 'distance to the farther return beside it in its line',
    'along': 'difference from the prediction along its line',
    'along_m': 'difference from the prediction along its line, metres',
    'between': 'difference from the prediction between its two neighbours',
    'beside': 'distance to the nearest return of other lines',
    'across': 'difference from the prediction across the lines',
    'near3': 'mean distance to the three nearest',
    'near5': 'mean distance to the five nearest',
    'near5_m': 'mean distance to the five nearest, metres',
    'before_own': 'share of its line around it that is nearer to the sensor',
    'behind_own': 'share of its line around it that is farther',
    'before_other': 'share of other lines around it that is nearer',
    'behind_other': 'share of other lines around it that is farther',
    'level_own': 'share of its line around it at its range',
    'level_other': 'share of other lines around it at its range',
    'there_own': 'share of beams of its line that have a return',
    'there_other': 'share of beams of other lines that have a return',
    'rough_own': 'how uneven the ranges of its line are around it',
    'rough_other': 'how uneven the ranges of other lines are around it',
    'range': 'distance from the sensor',
    'glare': 'what a particle there must outshine',
    'depth': 'its range ÷ that of the background',
    'dense': 'share of the window within 2 beams of it',
    'sparse': 'share of the window within 6 beams of it',
    'bright': 'intensity ÷ what is usual at its range',
    'uneven': 'how unevenly the lines beside it are spaced',
    'first': 'result of the first pass',
    'first_own': 'first results in its line',
    'first_other': 'first results in other lines',
    'first_close': 'first results around it, the nearest most',
    'first_level': 'first results at its range',
    'first_behind': 'first results behind it',
    'first_before': 'first results before it',
    'wide_own': 'share found in a longer stretch of its line',
    'wide_other': 'share found in a longer stretch of other lines',
    'share': 'share found among all points',
    'share_range': 'share found at its range',
    'middle': 'difference from the prediction of opposite returns',
    'agree': 'share of these predictions that are right',
    'group': 'returns of its group',
    'group_slope': 'slope of its group',
    'group_width': 'width ÷ length of its group',
    'group_advance': 'way of its group along the lines',
    'group_length': 'length of its group',
}
_SURVEY = {
    'near1': 'distance to the nearest point',
    'near3': 'mean distance to the three nearest',
    'near8': 'distance to the eighth nearest',
    'denser': 'how dense its densest neighbours lie',
    'sparser': 'how sparse its sparsest neighbours lie',
    'jump': 'greatest jump in the distances to its neighbours',
    'jump_at': 'neighbours before that jump',
    'listed': 'neighbours that count it among their own',
    'steps2': 'points that two steps to neighbours reach',
    'off': 'distance from the plane of its 8 neighbours',
    'flat': 'how even that plane is',
    'off_flat': 'distance from that plane ÷ how even it is',
    'thin': 'whether its neighbours lie on a line',
    'aside': 'how far it is aside of its neighbours',
    'level': 'how level the plane is',
    'below': 'how far it is below its neighbours',
    'above': 'how far it is above its neighbours',
    'sunk': 'how far it is below them ÷ how far they differ in height',
    'raised': 'how far it is above them ÷ how far they differ in height',
    'rare': 'distance to the eighth ÷ the typical one of the cloud',
    'wide8': 'distance to the eighth nearest',
    'wide20': 'distance to the 20th nearest',
    'wide60': 'distance to the 60th nearest',
    'densest': 'how dense the densest of 60 neighbours lies',
    'contrast': 'how much densities differ around it',
    'first_edge': 'first distance that joins it to others',
    'longest': 'longest distance that joins its 60 neighbours',
    'before': 'points joined before the longest distance',
    'against': 'the longest distance ÷ the longest before it',
    'group': 'points joined before the first long distance',
    'off20': 'distance from the plane of 20 neighbours',
    'flat20': 'how even the plane of 20 is',
    'off_flat20': 'distance from the plane of 20 ÷ how even it is',
    'off60': 'distance from the plane of 60 neighbours',
    'flat60': 'how even the plane of 60 is',
    'off_flat60': 'distance from the plane of 60 ÷ how even it is',
    'below20': 'how far it is below 20 neighbours',
    'above20': 'how far it is above 20 neighbours',
    'below60': 'how far it is below 60 neighbours',
    'above60': 'how far it is above 60 neighbours',
    'sunk20': 'below 20 neighbours ÷ how far these differ in height',
    'raised20': 'above 20 neighbours ÷ how far these differ in height',
    'sunk60': 'below 60 neighbours ÷ how far these differ in height',
    'raised60': 'above 60 neighbours ÷ how far these differ in height',
    'rare60': 'local spacing ÷ the typical one of the cloud',
    'higher': 'share of 60 neighbours that are higher',
    'under': 'how far it is below what opposite neighbours predict',
    'over': 'how far it is above what opposite neighbours predict',
    'first': 'result of the first trees',
    'near_odds': 'first results of its 8 neighbours',
    'company8': 'share of 8 neighbours that the first trees reject',
    'company60': 'share of 60 neighbours that the first trees reject',
}
_SUM = {
    'spacing': 'mean distance to 3 neighbours',
    'step': 'distance to the nearer neighbour in its line',
    'lonely': 'mean distance to 5 neighbours',
    'amid': 'how lonely its neighbours are',
    'along': 'difference from the prediction along its line',
    'surface': 'distance from the surface of its neighbours',
    'alone': 'few neighbours of other lines',
    'company': 'share of its neighbours rejected before',
    'slanted': 'in a thin, straight, slanted group in the air',
}


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
    model = load(SURVEY_MODEL)
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


EXPLANATION = Explanation(
    reasons={
        number: ReasonName(name, (_SUM if number >= OF_SUM else _PATTERN)[name])
        for number, name in REASON_NAMES.items()
    },
    ways={Way.PATTERN.value: _PATTERN, Way.SURVEY.value: _SURVEY, Way.SUM.value: _SUM},
    of_score=(Way.SUM.value,),
    choose=lambda seen, parameters: choose(seen, parameters)[0].value,
    explain=contributions,
)
