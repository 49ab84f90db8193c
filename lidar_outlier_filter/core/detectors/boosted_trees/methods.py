# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The methods of the default detector, the choice between them, and explanations of scores."""

from collections.abc import Callable
from enum import Enum

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Ints, Singles
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
    FEATURE_NAMES,
    FREE_MODEL,
    MIN_LOG_ODDS,
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
from lidar_outlier_filter.core.detectors.plausible import is_in_one_plane, rejects_surfaces
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels.threads import run
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import K
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.scan_lines import has_lines
from lidar_outlier_filter.core.scan_pattern.placed_pattern import spread
from lidar_outlier_filter.core.scan_pattern.recognise import (
    Kept,
    SensorKind,
    recognise,
    share_rings,
)
from lidar_outlier_filter.core.scan_pattern.resemblance import is_plausible
from lidar_outlier_filter.parameters.filter import FilterParameters

_PATTERN = {**features.WINDOW, **features.PROFILE, **features.SECOND_PASS}
_NEIGHBOURS = {**features.NEAR, **features.SWEEP, **features.FAR}
_EVERY = {**_PATTERN, **features.CAUSES}
REASONS = {
    **{key: ReasonName(name, _EVERY[name]) for key, name in features.REASON_NAMES.items()},
    **{
        key: ReasonName(name, _NEIGHBOURS[name])
        for key, name in features.SURVEY_REASON_NAMES.items()
    },
}


class Method(Enum):
    """How the default detector scores a cloud, in words for users."""

    PATTERN = 'trees on the scan pattern'
    NEIGHBOURS = 'trees on the neighbours of each point'
    IMPLAUSIBLE = (
        'trees on the neighbours of each point, because on the scan pattern surfaces were rejected'
    )
    SHARED = (
        'trees on the neighbours of each point, because sensors share ring numbers: filter each by '
        'itself, before their clouds are merged'
    )
    UNTESTED = 'no trees, untested: a single scan line without a scan pattern'
    UNMET = 'no trees, untested: the points have no pattern of boosted_trees.sensor'


METHODS = {
    Method.PATTERN.value: _PATTERN,
    Method.NEIGHBOURS.value: _NEIGHBOURS,
    Method.IMPLAUSIBLE.value: _NEIGHBOURS,
    Method.SHARED.value: _NEIGHBOURS,
}


MODELS = {
    SensorKind.SPINNING: PATTERN_MODEL,
    SensorKind.PROFILE: PROFILE_MODEL,
    SensorKind.FREE: FREE_MODEL,
}


def find_either(
    points: Points, sensor: str, threads: int = 0, kept: Kept | None = None
) -> FoundPattern | None:
    """Find the scan pattern of valid points, see :func:`.recognise`, and its model."""
    found = recognise(points, sensor, threads, kept)
    return None if found is None else FoundPattern(found.pattern, MODELS[found.kind])


def _find(seen: DetectorInput, sensor: str) -> FoundPattern | None:
    """Find the scan pattern of a detector's input; of a whole cloud, only a plausible one."""
    kept = seen.kept.setdefault('pattern', Kept())
    found = find_either(seen.points, sensor, seen.threads, kept)
    if found is None or not seen.whole or sensor != 'auto':  # of a stream, blocks are judged alike
        return found
    return found if is_plausible(found.pattern) else None


def choose(seen: DetectorInput, parameters: FilterParameters) -> tuple[Method, FoundPattern | None]:
    """Choose the method for a cloud; return the scan pattern too, where there is one.

    Where trees on the scan pattern reject surfaces, it is not what it seemed, and neighbours judge.
    Without a scan pattern, a point needs neighbours on other scan lines: unless ``sensor`` is
    ``survey``, the points of a block with a single line stay untested. So do points without the
    pattern of a sensor that was asked for: another method does not replace it.
    """
    points, sensor = seen.points, parameters.of(BoostedTrees).sensor
    is_lined = has_lines(points) or points.ring is not None
    if sensor == 'survey' or (seen.whole and not is_lined and sensor == 'auto'):
        return Method.NEIGHBOURS, None
    found = seen.cached(('pattern', sensor), lambda: _find(seen, sensor))
    if found is not None:
        if _rejects_surfaces(seen, found, parameters):
            return Method.IMPLAUSIBLE, None
        return Method.PATTERN, found
    if sensor != 'auto':
        return Method.UNMET, None
    if seen.whole or (len(points) > 0 and np.ptp(points.line) > 0):
        is_shared = seen.cached(('shared rings',), lambda: share_rings(points))
        return Method.SHARED if is_shared else Method.NEIGHBOURS, None
    return Method.UNTESTED, None


def _each_stretch(
    seen: DetectorInput,
    found: FoundPattern,
    parameters: FilterParameters,
    asked: Bools,
    work: Callable[[Ints, Bools, FoundPattern, int], None],
) -> None:
    """Do work for points judged together, asked ones (N,) of them, and their pattern, in threads.

    Lines of a profile scanner are compared with others of their time: a whole cloud is judged in
    the blocks of a stream, each with its halo. Where a block has no pattern, that of all counts.
    """
    t = seen.points.t
    block, halo = (round(length * SECOND) for length in (parameters.block, parameters.halo))
    if not seen.whole or found.model != PROFILE_MODEL or np.ptp(t) <= block:
        work(np.arange(len(t)), asked, found, seen.threads)
        return
    order, without = np.argsort(t, kind='stable'), np.zeros(len(t), np.bool_)
    numbers = np.unique(t[asked] // block)
    threads = seen.threads if len(numbers) == 1 else 1  # of each: blocks share them

    def some(first: int, last: int) -> None:
        for number in numbers[first:last].tolist():
            begin, end = number * block, (number + 1) * block
            low, high = np.searchsorted(t, (begin - halo, end + halo), sorter=order)
            members = np.sort(order[low:high])
            own = asked[members] & (t[members] >= begin) & (t[members] < end)
            local = find_either(seen.points.take(members), 'profile', threads)
            if local is None:
                without[members[own]] = True
            else:
                work(members, own, local, threads)

    run(some, len(numbers), 1, seen.threads)
    if without.any():
        work(np.arange(len(t)), without, found, seen.threads)


def _judge(seen: DetectorInput, found: FoundPattern, parameters: FilterParameters) -> Scores:
    """Score points by the trees on their scan pattern, once."""
    threshold = parameters.of(BoostedTrees).threshold

    def score() -> Scores:
        reason = np.zeros(len(seen.points), np.uint8) if parameters.scores else None
        scores = np.empty(len(seen.points))
        every = np.ones(len(scores), np.bool_)

        def work(members: Ints, own: Bools, local: FoundPattern, threads: int) -> None:
            why = None if reason is None else np.zeros(len(members), np.uint8)
            scored = judge(local.pattern, threshold, threads, model=local.model, reason=why)
            scores[members[own]] = scored[own]
            if reason is not None and why is not None:
                reason[members[own]] = why[own]

        _each_stretch(seen, found, parameters, every, work)
        return Scores(scores, reason=reason, scaled=True, method=Method.PATTERN.value)

    return seen.cached(('by pattern', threshold, parameters.scores), score)


def _rejects_surfaces(
    seen: DetectorInput, found: FoundPattern, parameters: FilterParameters
) -> bool:
    """Return whether trees on the scan pattern reject surfaces, whatever the threshold."""
    score = _judge(seen, found, parameters).score * parameters.of(BoostedTrees).threshold
    if not rejects_surfaces(seen.points.xyz, score > 1, seen.threads):
        return False
    # In the own frame of a profile scanner everything is flat.
    return found.model != PROFILE_MODEL or not is_in_one_plane(seen.points.xyz)


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
    if method in {Method.UNTESTED, Method.UNMET}:
        return Scores(np.full(len(points), np.nan), scaled=True, method=method.value)
    if found is None:
        around = measure_floor(points.xyz, np.arange(len(points)), parameters.threads)
        odds, model = survey.measure(
            *(points.xyz, around, parameters.threads, seen.allocate),
            whole=_is_map(seen),
            sweeps=_may_be_sweep(parameters),
        )
        score = survey.score(odds, threshold, model)
        reason = _survey_reasons(seen, parameters, score > 1) if parameters.scores else None
        return Scores(score, reason=reason, scaled=True, method=method.value)
    return _judge(seen, found, parameters)


# What each feature contributes to the log-odds of a point -----------------------------------------
#
# Each question of a tree halves the leaves that remain. The change of their mean is what its
# feature contributes. All contributions and the mean of the trees add up to the log-odds. Of lone
# points, which trees do not judge, it is the log-odds of a score of 0 instead of the mean.


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
        names = FEATURE_NAMES[found.model][1]
        added = np.zeros((len(names), np.count_nonzero(selected)), np.float32)
        column = np.cumsum(selected) - 1

        def work(members: Ints, own: Bools, local: FoundPattern, threads: int) -> None:
            added[:, column[members[own]]] = _of_pattern(local, own, threads)

        _each_stretch(seen, found, parameters, selected, work)
        return Contributions(method.value, names, added)
    if method in {Method.NEIGHBOURS, Method.IMPLAUSIBLE, Method.SHARED}:
        return Contributions(
            method.value, FEATURE_NAMES[SURVEY_MODEL][1], _of_survey(seen, parameters, selected)
        )
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


def _of_survey(seen: DetectorInput, parameters: FilterParameters, selected: Bools) -> Singles:
    """Return contributions (F, W) of selected points without a scan pattern."""
    xyz = seen.points.xyz
    hood, index, (copy, original) = Neighbourhood(xyz, K, seen.threads).distinct()
    if len(hood) <= K:  # too few points to judge
        return np.zeros((len(_NEIGHBOURS), np.count_nonzero(selected)), np.float32)
    around = measure_floor(xyz, np.arange(len(xyz)), seen.threads)
    (hood, index, lone, isolation), near = survey.see(
        hood, index, around, whole=_is_map(seen), sweeps=_may_be_sweep(parameters)
    )
    model = survey.model_of(near)
    first = survey.first_odds(near, model.first, seen.threads)
    asked, column = selected.copy(), np.empty(len(xyz), np.int64)
    asked[original[selected[copy]]] = True
    which = np.flatnonzero(asked[index])  # in tree order
    column[index[which]] = np.arange(len(which))
    column[lone[asked[lone]]] = len(which) + np.arange(np.count_nonzero(asked[lone]))
    column[copy] = column[original]
    again = first[which] > np.float32(model.doubtful)
    far = Far(near, first, hood.nearest_of(which[again], min(MAX_NEIGHBOURS, len(hood) - 1)))
    values = survey.near_values(near, which[~again]), survey.far_values(far, which[again])
    of_trees = _of_passes(model, again, *values)
    of_lone = _of_lone(isolation[asked[lone]])
    return np.concatenate([of_trees, of_lone], axis=1)[:, column[selected]]


def _is_map(seen: DetectorInput) -> bool:
    """Return whether points are a map: in a message far points are sparse, and seem lone."""
    return seen.whole and not bool(0 < np.ptp(seen.points.t) < SECOND)


def _may_be_sweep(parameters: FilterParameters) -> bool:
    return parameters.of(BoostedTrees).sensor != 'survey'


def _of_lone(isolation: Floats) -> Singles:
    """Return contributions (F, L) of lone points: how far apart they are, from a score of 0 on."""
    added = np.zeros((len(_NEIGHBOURS), len(isolation)), np.float32)
    added[[*_NEIGHBOURS].index('rare')] = survey.lone_odds(isolation) - MIN_LOG_ODDS
    return added


def _survey_reasons(seen: DetectorInput, parameters: FilterParameters, rejected: Bools) -> Bytes:
    """Return the number (N,) of the feature that adds most to each rejected point; 0: no feature.

    How suspect a point is by the first trees, and how far away, is no reason where another feature
    adds to it.
    """
    reason = np.zeros(len(rejected), np.uint8)
    if rejected.any():
        added = _of_survey(seen, parameters, rejected)
        names = FEATURE_NAMES[SURVEY_MODEL][1]
        for name in ('first', 'range'):
            some = added[names.index(name)]
            some[some > 0] = np.finfo(np.float32).tiny
        number = {name: key for key, name in features.SURVEY_REASON_NAMES.items()}
        numbers = np.array([number.get(name, 0) for name in names], np.uint8)
        reason[rejected] = np.where(added.max(axis=0) > 0, numbers[added.argmax(axis=0)], 0)
    return reason


def _of_passes(model: TreeModel, again: Bools, first: Singles, second: Singles) -> Singles:
    """Return contributions (F, W) by the pass that judged each point.

    ``first`` and ``second`` are the features of the points that each pass judged.
    """
    added = np.zeros((len(second), len(again)), np.float32)
    added[: len(first), ~again] = contribute(model.first, first)
    added[:, again] = contribute(model.again, second)
    return added
