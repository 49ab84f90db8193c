# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The methods of the default detector, the choice between them, and explanations of scores."""

from dataclasses import replace
from enum import Enum
from typing import TypeGuard

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees import features
from lidar_outlier_filter.core.detectors.boosted_trees import neighbour_trees as survey
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_features import MAX_NEIGHBOURS, Far
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    FoundPattern,
    first_pass,
    judge,
    measure,
    prepare_all,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    FREE_MODEL,
    NAMES,
    PATTERN_MODEL,
    PROFILE_MODEL,
    SURVEY_MODEL,
    TreeModel,
    contribute,
    load,
)
from lidar_outlier_filter.core.detectors.builtin import BoostedTrees
from lidar_outlier_filter.core.detectors.declaration import Contributions, ReasonName
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import K
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import has_lines, order_by_line
from lidar_outlier_filter.core.scan_pattern.own_frame import find_own_frame
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern, spread
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.recovered_rings import (
    as_turn,
    draws_curves,
    find_rows,
    in_bands,
)
from lidar_outlier_filter.core.scan_pattern.resemblance import is_plausible
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.parameters.filter import FilterParameters

_PATTERN = {**features.WINDOW, **features.PROFILE, **features.SECOND_PASS}
_NEIGHBOURS = {**features.NEAR, **features.FAR}
_EVERY = {**_PATTERN, **features.MIXED}
REASONS = {number: ReasonName(name, _EVERY[name]) for number, name in features.REASON_NAMES.items()}


class Method(Enum):
    """How the default detector scores a cloud, in words for users."""

    PATTERN = 'trees on the scan pattern'
    NEIGHBOURS = 'trees on the neighbours of each point'
    UNTESTED = 'no trees, untested: a single scan line without a scan pattern'


METHODS = {Method.PATTERN.value: _PATTERN, Method.NEIGHBOURS.value: _NEIGHBOURS}


def find_either(
    points: Points, sensor: str, threads: int = 0, *, doubted: bool = False
) -> FoundPattern | None:
    """Find the scan pattern of points; None if there is no pattern for the trees.

    Parameters
    ----------
    points : valid ones
    sensor : 'spinning', 'profile', 'free' (a scanner without rings), or 'auto' (any of them)
    threads : maximum number of threads; 0: all cores
    doubted : whether a pattern counts only if it is plausible, see :mod:`.resemblance`

    """

    def holds(pattern: Pattern | None) -> TypeGuard[Pattern]:
        return pattern is not None and (not doubted or is_plausible(pattern))

    if sensor == 'free':
        return _find_in_bands(points, threads)
    # A spinning sensor's lines are measured at once, a profile scanner's are not: at most one of
    # the two fits. The own frame of points that may have been moved is sought after both, as it
    # takes long.
    recovered = points.ring is not None
    # Azimuths are known in the sensor's own frame only.
    turned, spins = as_turn(points).in_own_frame, recovered or sensor == 'spinning'
    order = order_by_line(turned)
    if sensor == 'auto' and draws_curves(turned, order):
        return _find_in_bands(points, threads)
    if sensor != 'profile':
        # A pattern that is found changes the order.
        pattern = find_pattern(turned, threads, order.copy() if doubted else order, spins=spins)
        if holds(pattern):
            return FoundPattern(pattern, PATTERN_MODEL)
    if sensor != 'spinning':
        own = order.copy() if doubted else order
        pattern = find_profile_pattern(points, threads, None if recovered else own)
        if holds(pattern):
            return FoundPattern(pattern, PROFILE_MODEL)
    if sensor == 'profile':
        return None
    pattern = _find_moved(points, order.copy() if doubted else order, threads)
    if not holds(pattern):
        pattern = _find_in_rows(turned, order, spins, threads)
    return FoundPattern(pattern, PATTERN_MODEL) if holds(pattern) else None


def _find_moved(points: Points, order: Ints, threads: int) -> Pattern | None:
    """Find the scan pattern of a spinning sensor whose points are in another frame."""
    if points.own is not None or points.ring is not None:
        return None
    moved = find_own_frame(points, order)
    return None if moved is None else find_pattern(moved.in_own_frame, threads, order)


def _find_in_bands(points: Points, threads: int) -> FoundPattern | None:
    pattern = find_pattern(in_bands(points).in_own_frame, threads, spins=True)
    return None if pattern is None else FoundPattern(pattern, FREE_MODEL)


def _find_in_rows(points: Points, order: Ints, spins: bool, threads: int) -> Pattern | None:
    """Find the scan pattern of rows of a range image, with times of columns or without times."""
    pattern = find_pattern(points, threads, order, spins=spins, in_rows=True)
    if pattern is not None or points.ring is not None:
        return pattern
    rows = find_rows(points, order)
    turned = None if rows is None else as_turn(replace(points, ring=rows))
    return None if turned is None else find_pattern(turned, threads, spins=True)


def choose(seen: DetectorInput, parameters: FilterParameters) -> tuple[Method, FoundPattern | None]:
    """Choose the method for a cloud; return the scan pattern too, where there is one.

    Without a scan pattern, a point needs neighbours on other scan lines: unless ``sensor`` is
    ``survey``, the points of a block with a single line stay untested.
    """
    points, sensor = seen.points, parameters.of(BoostedTrees).sensor
    is_lined = has_lines(points) or points.ring is not None
    if sensor == 'survey' or (seen.whole and not is_lined and sensor != 'free'):
        return Method.NEIGHBOURS, None
    doubted = seen.whole and sensor == 'auto'  # of a stream, blocks must be judged alike
    found = seen.cached(
        ('pattern', sensor), lambda: find_either(points, sensor, seen.threads, doubted=doubted)
    )
    if found is not None:
        return Method.PATTERN, found
    if seen.whole or (len(points) > 0 and np.ptp(points.line) > 0):
        return Method.NEIGHBOURS, None
    return Method.UNTESTED, None


def detect(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point by gradient-boosted trees.

    Points with a scan pattern are compared with the returns next to them on their own scan line and
    on two lines on each side; other points with their 8 and 60 nearest neighbours.

    Parameters
    ----------
    seen : N valid points of a block, or of a whole cloud
    parameters : ``boosted_trees``, ``scores``, ``threads``

    Returns
    -------
    Scores
        ``score`` (N,) float64, max(0, log-odds + 8) ÷ (the block's threshold + 8) ÷ ``threshold``.
        NaN where no method applies, or points have fewer than 8 others.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors.boosted_trees.methods import detect
    >>> from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    >>> from lidar_outlier_filter.core.points.points import Points
    >>> from lidar_outlier_filter.parameters.filter import FilterParameters
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> zeros = np.zeros(900, np.int64)
    >>> points = Points(xyz, zeros, zeros, np.ones(900, np.bool_))
    >>> parameters = FilterParameters()
    >>> found = detect(DetectorInput(points, parameters, whole=True), parameters)
    >>> np.flatnonzero(found.score > 1).tolist()
    [77]

    """
    points, threshold = seen.points, parameters.of(BoostedTrees).threshold
    method, found = choose(seen, parameters)
    if method is Method.UNTESTED:
        return Scores(np.full(len(points), np.nan), scaled=True, method=method.value)
    if found is None:
        around = measure_floor(points.xyz, np.arange(len(points)), parameters.threads)
        odds = survey.measure(points.xyz, around, parameters.threads, seen.allocate)
        return Scores(survey.score(odds, threshold), scaled=True, method=method.value)
    reason = np.zeros(len(points), np.uint8) if parameters.scores else None
    score = judge(found.pattern, threshold, seen.threads, model=found.model, reason=reason)
    return Scores(score, reason=reason, scaled=True, method=method.value)


# What each feature contributes to the log-odds of a point -----------------------------------------
#
# Each question of a tree halves the leaves that remain. The change of their mean is what its
# feature contributes. All contributions and the mean of the trees add up to the log-odds.


def name_method(seen: DetectorInput, parameters: FilterParameters) -> str:
    """Name the method by which points are judged."""
    return choose(seen, parameters)[0].value


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
        names = NAMES[found.model][1]
        return Contributions(method.value, names, _of_pattern(found, selected, seen.threads))
    if method is Method.NEIGHBOURS:
        return Contributions(method.value, NAMES[SURVEY_MODEL][1], _of_survey(seen, selected))
    nothing = np.empty((0, np.count_nonzero(selected)), np.float32)
    return Contributions(method.value, (), nothing)


def _of_pattern(found: FoundPattern, selected: Bools, threads: int) -> Singles:
    """Return contributions (F, W) of selected points with a scan pattern."""
    model = load(found.model)
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
    hood, index, (copy, original) = Neighbourhood(xyz, K, seen.threads).distinct()
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
