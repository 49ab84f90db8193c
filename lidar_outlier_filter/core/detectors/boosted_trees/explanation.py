# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What each feature contributes to the log-odds of a point.

Each question of a tree halves the leaves that remain. The change of their mean is the contribution
of the question's feature. All contributions and the mean of the trees add up to the log-odds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees import features
from lidar_outlier_filter.core.detectors.boosted_trees import neighbour_trees as survey
from lidar_outlier_filter.core.detectors.boosted_trees.far_features import MOST, Far
from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose
from lidar_outlier_filter.core.detectors.boosted_trees.parameters import BoostedTrees
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    find_either,
    first_pass,
    prepare_all,
    second_pass,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_values import measure
from lidar_outlier_filter.core.detectors.boosted_trees.reasons import (
    REASON_NAMES,
    add_up_reasons,
    find_means,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    NAMES,
    PATTERN_MODEL,
    PROFILE_MODEL,
    SURVEY_MODEL,
    load,
)
from lidar_outlier_filter.core.detectors.explanation import Contributions, Explanation, ReasonName
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.neighbours.floor import look_around
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import K, find_places
from lidar_outlier_filter.core.scan_pattern.placed_pattern import spread
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats, Singles
    from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

_PATTERN = {**features.WINDOW, **features.PROFILE, **features.SECOND_PASS}
_NEIGHBOURS = {**features.NEAR, **features.FAR}


class Reasons(NamedTuple):
    """What the trees say of N points, and what of it is due to which feature.

    Attributes
    ----------
    odds : (N,) float32
        Log-odds: above the model's threshold a point is rejected.
    average : (N,) float32
        What the trees that judged the point say on average.
    added : (F, N) float32
        What each feature of ``names`` adds to that; its sum over F and ``average`` are ``odds``. 0
        for points whose reasons nobody wanted.
    names : of the F features
    threshold : log-odds above which the model rejects a point

    """

    odds: Singles
    average: Singles
    added: Singles
    names: tuple[str, ...]
    threshold: float

    @property
    def strongest(self) -> list[str]:
        """Name the feature that adds the most, of each point; '' where none adds anything.

        Only of those that trees asked about: the others add nothing.
        """
        asked = self.added != 0
        largest = np.where(asked, self.added, -np.inf).argmax(axis=0)
        known = asked.any(axis=0)
        return [self.names[f] if one else '' for f, one in zip(largest, known, strict=True)]


def explain(
    points: Points,
    threads: int = 0,
    *,
    sensor: str = 'spinning',
    wanted: NDArray[np.bool_] | None = None,
) -> Reasons:
    """Explain the log-odds of valid points, in the order given.

    Parameters
    ----------
    points : valid ones; of a spinning sensor in its own frame
    threads : at most so many at once; 0 for as many as there are cores
    sensor : 'spinning', 'profile', or 'auto': whichever it is
    wanted : (N,) bool
        The points whose reasons are wanted; None: all.

    Raises
    ------
    FilterError
        If they have no scan pattern: trees do not judge them.

    """
    found = find_either(points, sensor, threads)
    if found is None:
        raise FilterError('the points to explain', 'those of a scan pattern', 'others')
    pattern, there = found.pattern, found.pattern.order >= 0
    name = PROFILE_MODEL if found.profile else PATTERN_MODEL
    model = load(name)
    prepared = prepare_all(found, threads)
    first = first_pass(prepared, model.first, threads)
    odds = second_pass(prepared, first, model.again, model.doubtful, threads)
    values = measure(prepared, first)
    again = first.score > np.float32(model.doubtful)
    back = np.empty(len(points), np.int64)
    spread(pattern, np.arange(len(there)), back)
    explained = there.copy()
    if wanted is not None:
        explained[:] = False
        explained[back[wanted]] = True
    added = np.zeros_like(values)
    contribute(model.first, values, explained & ~again, added)
    contribute(model.again, values, explained & again, added)
    average = np.where(again, average_of(model.again), average_of(model.first))
    single = average[back].astype(np.float32)
    return Reasons(odds[back], single, added[:, back], NAMES[name][1], model.threshold)


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
        return Contributions(method.value, NAMES[SURVEY_MODEL][1], *_of_survey(seen, wanted))
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
    """Return contributions (F, M) and averages (M,) of the wanted ones of distinct places."""
    model, (near_names, names) = load(SURVEY_MODEL), NAMES[SURVEY_MODEL]
    count = int(np.count_nonzero(wanted))
    added, average = np.zeros((len(names), count), np.float32), np.zeros(count, np.float32)
    if len(xyz) <= K:  # they are not judged
        return added, average
    hood = Neighbourhood(xyz, K, threads)
    near = survey.neighbours(hood, look_around(xyz, np.arange(len(xyz)), threads))
    first = survey.first_odds(near, model.first, threads)
    which = np.flatnonzero(wanted[hood.order])  # in tree order
    again = first[which] > np.float32(model.doubtful)
    added[: len(near_names), ~again] = _added(model.first, survey.near_values(near, which[~again]))
    far = Far(near, first, hood.nearest_of(which[again], min(MOST, len(hood) - 1)))
    added[:, again] = _added(model.again, survey.far_values(far, which[again]))
    average[:] = np.where(again, average_of(model.again), average_of(model.first))
    back = np.argsort(hood.order[which], kind='stable')
    return added[:, back], average[back]


def _added(trees: Trees, values: Singles) -> Singles:
    """Return the contributions (F, M) of features with these values."""
    added = np.zeros_like(values)
    contribute(trees, values, np.ones(values.shape[1], np.bool_), added)
    return added


def average_of(trees: Trees) -> float:
    """Return what trees say on average, log-odds."""
    return float(trees.start + trees.value.mean(axis=1, dtype=np.float64).sum())


@kernel
def contribute(trees: Trees, features: Singles, wanted: NDArray[np.bool_], added: Singles) -> None:
    """Add what each feature (F, N) adds to the log-odds of the points that are wanted."""
    means = find_means(trees)
    for k in range(len(wanted)):
        if wanted[k]:
            add_up_reasons(trees, means, features[:, k], added[:, k])


EXPLANATION = Explanation(
    reasons={number: ReasonName(name, _PATTERN[name]) for number, name in REASON_NAMES.items()},
    ways={Method.PATTERN.value: _PATTERN, Method.NEIGHBOURS.value: _NEIGHBOURS},
    of_score=(),
    choose=lambda seen, parameters: choose(seen, parameters)[0].value,
    explain=contributions,
)
