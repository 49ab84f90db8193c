# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What each feature contributes to the log-odds of a point.

Each question of a tree halves the leaves that remain. The change of their mean is the contribution
of the question's feature. All contributions and the mean of the trees add up to the log-odds.
"""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Singles
from lidar_outlier_filter.core.detectors.boosted_trees import features
from lidar_outlier_filter.core.detectors.boosted_trees import neighbour_trees as survey
from lidar_outlier_filter.core.detectors.boosted_trees.far_features import MAX_NEIGHBOURS, Far
from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    FoundPattern,
    first_pass,
    measure,
    prepare_all,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    NAMES,
    PATTERN_MODEL,
    PROFILE_MODEL,
    SURVEY_MODEL,
    TreeModel,
    contribute,
    load,
)
from lidar_outlier_filter.core.detectors.declaration import Contributions, Explanation, ReasonName
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.neighbours.duplicates import K
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.scan_pattern.placed_pattern import spread
from lidar_outlier_filter.parameters.filter import FilterParameters

_PATTERN = {**features.WINDOW, **features.PROFILE, **features.SECOND_PASS}
_NEIGHBOURS = {**features.NEAR, **features.FAR}


def contributions(
    seen: DetectorInput, parameters: FilterParameters, selected: Bools
) -> Contributions:
    """Return the contributions of features to the scores of selected points.

    Parameters
    ----------
    seen : the detector's input, N points
    parameters : of the detector
    selected : (N,) bool
        Points to explain.

    """
    method, found = choose(seen, parameters)
    if found is not None:
        names = NAMES[PROFILE_MODEL if found.profile else PATTERN_MODEL][1]
        return Contributions(method.value, names, _of_pattern(found, selected, seen.threads))
    if method is Method.NEIGHBOURS:
        return Contributions(method.value, NAMES[SURVEY_MODEL][1], _of_survey(seen, selected))
    nothing = np.empty((0, np.count_nonzero(selected)), np.float32)
    return Contributions(method.value, (), nothing)


def _of_pattern(found: FoundPattern, selected: Bools, threads: int) -> Singles:
    """Return contributions (F, W) of selected points with a scan pattern."""
    model = load(PROFILE_MODEL if found.profile else PATTERN_MODEL)
    prepared = prepare_all(found, threads)
    first = first_pass(prepared, model.first, threads)
    cell = np.empty(len(selected), np.int64)
    spread(found.pattern, np.arange(len(first.score)), cell)
    asked = np.zeros(len(first.score), np.bool_)
    asked[cell[selected]] = True  # copies share a cell
    again = first.score[asked] > np.float32(model.doubtful)
    values = measure(prepared, first, asked, threads)
    added = _of_passes(model, again, values[:, ~again], values[:, again])
    return added[:, (np.cumsum(asked) - 1)[cell[selected]]]


def _of_survey(seen: DetectorInput, selected: Bools) -> Singles:
    """Return contributions (F, W) of selected points without a scan pattern."""
    model, xyz = load(SURVEY_MODEL), seen.points.xyz
    hood, index, (copy, original) = survey.find_distinct(xyz, seen.threads)
    if len(hood) <= K:  # too few points to judge
        return np.zeros((len(_NEIGHBOURS), np.count_nonzero(selected)), np.float32)
    near = survey.neighbours(hood, measure_floor(xyz, np.arange(len(xyz)), seen.threads))
    first = survey.first_odds(near, model.first, seen.threads)
    asked, column = selected.copy(), np.empty(len(xyz), np.int64)
    asked[original[selected[copy]]] = True
    which = np.flatnonzero(asked[index])  # in tree order
    column[index[which]] = np.arange(len(which))
    column[copy] = column[original]
    again = first[which] > np.float32(model.doubtful)
    far = Far(near, first, hood.nearest_of(which[again], min(MAX_NEIGHBOURS, len(hood) - 1)))
    values = survey.near_values(near, which[~again]), survey.far_values(far, which[again])
    return _of_passes(model, again, *values)[:, column[selected]]


def _of_passes(model: TreeModel, again: Bools, first: Singles, second: Singles) -> Singles:
    """Return contributions (F, W) by the pass that judged each point.

    ``first`` and ``second`` are the features of the points that each pass judged.
    """
    added = np.zeros((len(second), len(again)), np.float32)
    added[: len(first), ~again] = contribute(model.first, first)
    added[:, again] = contribute(model.again, second)
    return added


EXPLANATION = Explanation(
    reasons={
        number: ReasonName(name, _PATTERN[name]) for number, name in features.REASON_NAMES.items()
    },
    methods={Method.PATTERN.value: _PATTERN, Method.NEIGHBOURS.value: _NEIGHBOURS},
    choose=lambda seen, parameters: choose(seen, parameters)[0].value,
    explain=contributions,
)
