# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the default explains its scores by each method, with each feature in a few words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.explain.pattern_reasons import (
    average_of,
    contribute,
    explain,
)
from lidar_outlier_filter.core.detectors.boosted_trees.explain.reasons import REASON_NAMES
from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose
from lidar_outlier_filter.core.detectors.boosted_trees.models import SURVEY_MODEL, load
from lidar_outlier_filter.core.detectors.boosted_trees.parameters import BoostedTrees
from lidar_outlier_filter.core.detectors.boosted_trees.survey import far as survey_far
from lidar_outlier_filter.core.detectors.boosted_trees.survey import judge as survey
from lidar_outlier_filter.core.detectors.boosted_trees.survey import near as survey_near
from lidar_outlier_filter.core.detectors.boosted_trees.survey.far import MOST, Far
from lidar_outlier_filter.core.detectors.explanation import Contributions, Explanation, ReasonName
from lidar_outlier_filter.core.neighbours.floor import look_around
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import K, find_places

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Singles
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.parameters.filter import FilterParameters

_PATTERN = {
    'step': 'gap to the nearer neighbour on its scan line',
    'leap': 'gap to the farther neighbour on its scan line',
    'along': 'how far it leaves the course of its scan line',
    'along_m': 'how far it leaves the course of its scan line, metres',
    'between': 'how far it is off the line between its two neighbours',
    'beside': 'gap to the nearest point on other scan lines',
    'across': 'how far it leaves the course across the scan lines',
    'near3': 'mean distance to the 3 nearest points, for its range',
    'near5': 'mean distance to the 5 nearest points, for its range',
    'near5_m': 'mean distance to the 5 nearest points, metres',
    'before_own': 'share of its scan line beside it that is nearer',
    'behind_own': 'share of its scan line beside it that is farther',
    'before_other': 'share of the scan lines beside it that is nearer',
    'behind_other': 'share of the scan lines beside it that is farther',
    'level_own': 'share of its scan line beside it that is as far',
    'level_other': 'share of the scan lines beside it that is as far',
    'there_own': 'share of the beams beside it, on its line, that hit',
    'there_other': 'share of the beams beside it, on other lines, that hit',
    'rough_own': 'how rough its scan line is around it',
    'rough_other': 'how rough the scan lines beside it are',
    'range': 'distance from the sensor',
    'glare': 'background that a particle there must outshine',
    'depth': 'its range ÷ the range of what lies behind it',
    'dense': 'share of the beams around it that hit close to it',
    'sparse': 'share of the beams around it that hit near it',
    'bright': 'intensity ÷ what is usual at its range',
    'uneven': 'how unevenly the scan lines beside it are spaced',
    'first': 'what a first look says of it',
    'first_own': 'what a first look says of its scan line around it',
    'first_other': 'what a first look says of the scan lines beside it',
    'first_close': 'what a first look says of the points around it',
    'first_level': 'what a first look says of points around it, as far',
    'first_behind': 'what a first look says of points behind it',
    'first_before': 'what a first look says of points in front of it',
    'wide_own': 'share of suspects in a long stretch of its scan line',
    'wide_other': 'share of suspects in a long stretch of other lines',
    'share': 'share of suspects in the whole cloud',
    'share_range': 'share of suspects at its range',
    'middle': 'how far it is off the middle between opposite points',
    'agree': 'share of opposite points whose middle is its place',
    'group': 'how many points hang together with it',
    'group_slope': 'how steep the group is that it belongs to',
    'group_width': 'width ÷ length of the group that it belongs to',
    'group_advance': 'how far its group moves on from scan line to scan line',
    'group_length': 'how long the group is that it belongs to',
}
_SURVEY = {
    'near1': 'distance to the nearest point',
    'near3': 'mean distance to the 3 nearest points',
    'near8': 'distance to the 8th nearest point',
    'denser': 'how close together its closest neighbours lie',
    'sparser': 'how far apart its loosest neighbours lie',
    'jump': 'widest step in the distances to its neighbours',
    'jump_at': 'how many neighbours lie before that step',
    'listed': 'how many neighbours have it among their nearest',
    'steps2': 'how many points neighbours of neighbours are',
    'off': 'height over the plane through its 8 neighbours',
    'flat': 'how flat its 8 neighbours lie',
    'off_flat': 'height over that plane ÷ how flat they lie',
    'thin': 'whether its neighbours lie on a line',
    'aside': 'how far it is aside of its neighbours',
    'level': 'how level the plane through its neighbours is',
    'below': 'how far it is below its neighbours',
    'above': 'how far it is above its neighbours',
    'sunk': 'how far it is below them ÷ how uneven they are',
    'raised': 'how far it is above them ÷ how uneven they are',
    'rare': 'distance to the 8th nearest ÷ what is usual in the cloud',
    'closed': 'how many points are in its group, if it is apart',
    'deep': 'how far it is below the ground around',
    'deep_steep': 'how far it is below the ground around ÷ how steep that is',
    'wide8': 'distance to the 8th nearest point',
    'wide20': 'distance to the 20th nearest point',
    'wide60': 'distance to the 60th nearest point',
    'densest': 'how close together the closest of 60 neighbours lie',
    'contrast': 'how much the density changes around it',
    'first_edge': 'gap that parts it from the other points',
    'longest': 'widest gap among its 60 neighbours',
    'before': 'how many points are on its side of the widest gap',
    'against': 'the widest gap ÷ the widest before it',
    'group': 'how many points are on its side of the first wide gap',
    'off20': 'height over the plane through 20 neighbours',
    'flat20': 'how flat 20 neighbours lie',
    'off_flat20': 'height over the plane of 20 ÷ how flat they lie',
    'off60': 'height over the plane through 60 neighbours',
    'flat60': 'how flat 60 neighbours lie',
    'off_flat60': 'height over the plane of 60 ÷ how flat they lie',
    'below20': 'how far it is below 20 neighbours',
    'above20': 'how far it is above 20 neighbours',
    'below60': 'how far it is below 60 neighbours',
    'above60': 'how far it is above 60 neighbours',
    'sunk20': 'how far it is below 20 ÷ how uneven they are',
    'raised20': 'how far it is above 20 ÷ how uneven they are',
    'sunk60': 'how far it is below 60 ÷ how uneven they are',
    'raised60': 'how far it is above 60 ÷ how uneven they are',
    'rare60': 'spacing around it ÷ what is usual in the cloud',
    'higher': 'share of 60 neighbours that are higher',
    'under': 'how far it is below the middle of opposite neighbours',
    'over': 'how far it is above the middle of opposite neighbours',
    'first': 'what a first look says of it',
    'near_odds': 'what a first look says of its 8 neighbours',
    'company8': 'share of suspects among 8 neighbours',
    'company60': 'share of suspects among 60 neighbours',
}


def contributions(
    seen: DetectorInput, parameters: FilterParameters, wanted: Bools
) -> Contributions:
    """Find what features add to the verdicts of the wanted ones of N points.

    Parameters
    ----------
    seen : what the default judged
    parameters : by which it did
    wanted : (N,) bool

    """
    method, _ = choose(seen, parameters)
    if method is Method.NEIGHBOURS:
        return Contributions(method.value, survey_far.NAMES, *_of_survey(seen, wanted))
    if method is Method.UNTESTED:
        count = np.count_nonzero(wanted)
        nothing = np.zeros((0, count), np.float32), np.zeros(count, np.float32)
        return Contributions(method.value, (), *nothing)
    sensor = parameters.of(BoostedTrees).sensor
    found = explain(seen.points, seen.threads, sensor=sensor, wanted=wanted)
    return Contributions(method.value, found.names, found.added[:, wanted], found.average[wanted])


def _of_survey(seen: DetectorInput, wanted: Bools) -> tuple[Singles, Singles]:
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
    near = survey.neighbours(hood, look_around(xyz, np.arange(len(xyz)), threads))
    first = survey.first_odds(near, model.first, threads)
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
    reasons={number: ReasonName(name, _PATTERN[name]) for number, name in REASON_NAMES.items()},
    ways={Method.PATTERN.value: _PATTERN, Method.NEIGHBOURS.value: _SURVEY},
    of_score=(),
    choose=lambda seen, parameters: choose(seen, parameters)[0].value,
    explain=contributions,
)
