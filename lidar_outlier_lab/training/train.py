# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees on the scan pattern from labelled sweeps, and write their file.

Two ensembles are trained: one on each point's window, and one on the points that the first does not
call clearly good, with the first's results around them. Sensors are left out in folds, each once:
what the second ensemble sees of a sweep is what a first one says that never saw the sweep's sensor.
The thresholds and the figures of the file are of ensembles, too, that never saw it.

Recordings hold mixed points, which nobody has labelled: what lies between two surfaces of its ring
does not train as a good point.

So the trees that judge a sensor never saw it. But first results of other sensors, which their
second ensemble learns from, are of ensembles that did; and the thresholds are chosen on the sweeps
that the figures are of. Both can make the figures better than those of a sensor of one's own.

Every second sweep trains without its intensities, so that trees can do without. All are judged both
ways, and one threshold is chosen for both.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Progress, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.trees import VERSION, read_trees
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared, prepare
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.placed_pattern import UNKNOWN_BRIGHTNESS, Pattern
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.training.held_out import (
    CLEAN,
    STREET,
    HeldOut,
    choose_threshold,
    figures,
    judge_at_all,
)
from lidar_outlier_lab.training.learner import (
    Drawn,
    Trained,
    draw_rows,
    judge_pass,
    learn,
    window_features,
)

# Known to the second pass, and not used: trees would learn how many outliers the streets have.
UNUSED = ('share',)
ROUNDS = (100, 120)  # trees of both ensembles
LEARN_FROM = -3.0  # log-odds of the first from which on points train the second
DOUBTFUL = -1.0  # first log-odds above which the second ensemble judges a point
BAD, GOOD = 400, 900  # points of a sweep that are drawn
GOOD_OF_CLEAN = (4000, 5000)  # of a clean sweep, in both passes
MIN_OUTLIERS = 500  # outliers of a sweep from which on all sweeps count the same
# How much a sweep's outliers, and its good points, count; 1 for every other kind. Ghosts and mixed
# points of recordings look like thin things far away.
BAD_COUNTS = {'ghosts': 0.15, 'mixed': 0.3, 'street': 1.5}
GOOD_COUNTS = {CLEAN: 5.0, 'street': 1.5}
GOOD_COUNT = (2.0, 8.0)  # how much good points count, in both passes
FOLDS = 8  # parts of the sensors, each of which is left out once
BETWEEN = 0.3  # m, at least, from a mixed point to either surface, beside what rings are apart
OFF = 0.1  # m, at least, from what its neighbours predict
NEXT = 3.0  # steps, at most, to the returns before and after


class Sweep(NamedTuple):
    """Points of one sweep in the sensor's own frame, and which of them are outliers.

    ``kind`` is a weather, ``clean`` or ``street``. It trains, or is judged, or both.
    """

    name: str
    sensor: str
    kind: str
    points: Points
    outlier: Bools
    trains: bool = True
    judged: bool = True


class Recipe(NamedTuple):
    """How the ensembles are trained.

    Attributes
    ----------
    seed : of the points drawn, from 0
    rounds : trees of both ensembles
    folds : parts of the sensors, each of which is left out once
    unseen : kinds of sweeps that neither train nor choose the threshold; they are judged
    drop : log-odds by which a block's valley may lower the threshold
    bad_counts, good_counts : how much outliers, and good points, of a sweep count, by its kind;
        1 where it has no row

    """

    seed: int = 1
    rounds: tuple[int, int] = ROUNDS
    folds: int = FOLDS
    unseen: Collection[str] = ()
    drop: float = 2.0
    bad_counts: Mapping[str, float] = BAD_COUNTS
    good_counts: Mapping[str, float] = GOOD_COUNTS


class _Seen(NamedTuple):
    """A sweep with its scan pattern; outliers in the order of that; whether it trains so."""

    sweep: Sweep
    prepared: Prepared
    outlier: Bools
    trains: bool


def train(
    sweeps: Sequence[Sweep],
    about: Mapping[str, Any],
    recipe: Recipe = Recipe(),  # noqa: B008  it is immutable
    progress: Progress = lambda _done, _total, _what: None,
) -> Trained:
    """Train both ensembles.

    Parameters
    ----------
    sweeps : of spinning sensors, with and without outliers
    about : description of the training, for the file
    recipe : how
    progress : is called before every step: how many of how many are done, and of what; it may leave

    Returns
    -------
    Trained
        The same for the same arguments.

    Raises
    ------
    FilterError
        If a sweep has no scan pattern, no point is an outlier, or there is one sensor only.

    """
    if not any(sweep.outlier.any() for sweep in sweeps if sweep.trains):
        raise FilterError('the training sweeps', 'ones with outliers', 'none')
    seen = [one for number, sweep in enumerate(sweeps) for one in _observe(sweep, number, recipe)]
    first, odds = _pass(seen, None, recipe, progress)
    again, results = _pass(seen, odds, recipe, progress)
    judged, dark, threshold = _held_out(seen, results, recipe)
    held_out = figures(judged, threshold)
    held_out['without_intensity'] = figures(dark, threshold)
    before, _, first_threshold = _held_out(seen, odds, recipe)
    data = {
        'version': VERSION,
        **about,
        'seed': recipe.seed,
        'uses': _used(_names(again=True)),
        'sweeps': [one.name for one in sweeps if one.trains and one.kind not in recipe.unseen],
        'held_out': held_out,
        'held_out_one_pass': figures(before, first_threshold),
        'doubtful': DOUBTFUL,
        'threshold': threshold,
        'drop': recipe.drop,
        'first': first,
        'again': again,
    }
    return Trained(json.dumps(data, separators=(',', ':')), threshold, held_out, judged)


def _pass(
    seen: Sequence[_Seen], odds: Sequence[Singles] | None, recipe: Recipe, progress: Progress
) -> tuple[dict[str, Any], list[Singles]]:
    """Train one ensemble on all sensors; return the held-out log-odds of each sweep, too.

    ``odds`` are the first pass's log-odds of each sweep; None: this is the first.
    """
    again = odds is not None
    before = [None] * len(seen) if odds is None else odds
    drawn = {
        number: _draw(one, recipe, number, before[number])
        for number, one in enumerate(seen)
        if one.trains
    }
    sensors = list(dict.fromkeys(one.sweep.sensor for one in seen))
    if len(sensors) == 1:
        raise FilterError('the sensors to train on', 'at least 2: each is left out once', 1)
    count = min(recipe.folds, len(sensors))
    folds = [sensors[k::count] for k in range(count)]
    results = [np.empty(0, np.float32)] * len(seen)
    done, steps = again * (len(folds) + 1), 2 * (len(folds) + 1)
    for k, fold in enumerate(folds):
        progress(done + k, steps, f'without {", ".join(fold)}')
        some = [table for number, table in drawn.items() if seen[number].sweep.sensor not in fold]
        trees = read_trees(_learn(some, recipe, again=again), _names(again=again))
        for number, one in enumerate(seen):
            requested = one.sweep.judged or (one.trains and not again)
            if one.sweep.sensor in fold and requested:
                values = window_features(one.prepared, before[number])
                results[number] = judge_pass(trees, values, before[number], DOUBTFUL)
    progress(done + len(folds), steps, 'with every sensor')
    return _learn(list(drawn.values()), recipe, again=again), results


def _held_out(
    seen: Sequence[_Seen], odds: Sequence[Singles], recipe: Recipe
) -> tuple[list[HeldOut], list[HeldOut], float]:
    """Judge all sweeps at every threshold, with intensities and without, and choose one for both.

    Each sensor was left out.
    """
    held = [
        judge_at_all(one.sweep.sensor, one.sweep.kind, one.outlier, result, drop=recipe.drop)
        for one, result in zip(seen, odds, strict=True)
        if one.sweep.judged
    ]
    some = [one for one in held if one.kind not in recipe.unseen]
    return held[::2], held[1::2], choose_threshold(some)


def pattern_of(sweep: Sweep) -> Pattern:
    """Return the scan pattern of a sweep; refuse one without."""
    pattern = find_pattern(sweep.points, spins=True)
    if pattern is None:
        raise FilterError('a training sweep', 'one with a scan pattern', sweep.name)
    return pattern


def _observe(sweep: Sweep, number: int, recipe: Recipe) -> tuple[_Seen, _Seen]:
    """Look at a sweep with its intensities, and without; by turns, either trains."""
    pattern = pattern_of(sweep)
    outlier = sweep.outlier[pattern.order[pattern.order >= 0]]
    prepared, unknown = prepare(pattern), np.full_like(pattern.bright, UNKNOWN_BRIGHTNESS)
    dark = prepared._replace(pattern=pattern._replace(bright=unknown))
    even, trains = number % 2 == 0, sweep.trains and sweep.kind not in recipe.unseen
    return (
        _Seen(sweep, prepared, outlier, trains and even),
        _Seen(sweep, dark, outlier, trains and not even),
    )


def _draw(seen: _Seen, recipe: Recipe, number: int, odds: Singles | None) -> Drawn:
    """Draw points: in the second pass, only those that the first does not call clearly good."""
    again = odds is not None
    drawable = np.ones(len(seen.outlier), np.bool_) if odds is None else odds > LEARN_FROM
    rng = np.random.default_rng([recipe.seed, number, again])
    bad = np.flatnonzero(seen.outlier & drawable)
    values = window_features(seen.prepared, odds)
    known = seen.sweep.kind == STREET or ~lie_between(seen.prepared.pattern, values)
    good = np.flatnonzero(~seen.outlier & drawable & known)
    all_bad = int(seen.outlier.sum())
    all_good = len(seen.outlier) - all_bad
    kind = seen.sweep.kind
    most = GOOD_OF_CLEAN[again] if kind == CLEAN else GOOD
    counts = recipe.bad_counts.get(kind, 1.0) * min(1.0, all_bad / MIN_OUTLIERS)
    of_bad = counts * len(bad) / max(all_bad, 1)
    counts = GOOD_COUNT[again] * recipe.good_counts.get(kind, 1.0)
    of_good = counts * len(good) / max(all_good, 1)
    rows, weight = draw_rows(rng, ((bad, BAD, of_bad), (good, most, of_good)))
    return Drawn(values[:, rows], seen.outlier[rows], weight)


def lie_between(
    pattern: Pattern, values: Singles, apart: float | None = None, off: float = OFF
) -> Bools:
    """Return which points of a pattern (N,), in its order, may be mixed: they lie between surfaces.

    The returns before and after in the ring are well nearer and well farther, by more than
    ``apart``, and no straight line through neighbours predicts the range up to ``off``, both in
    metres. ``values`` (F, N) are the features.
    """
    cell = np.flatnonzero(pattern.order >= 0)
    line = np.repeat(np.arange(len(pattern.first)), pattern.last - pattern.first)
    reach, phase = pattern.range, pattern.phase
    before, after = reach[cell] - reach[cell - 1], reach[cell + 1] - reach[cell]
    most = NEXT * pattern.step[line] * pattern.turn[line]
    beside = (phase[cell] - phase[cell - 1] <= most) & (phase[cell + 1] - phase[cell] <= most)
    least = BETWEEN + pattern.gap[line] * reach[cell] if apart is None else apart
    beside &= (before * after > 0) & (np.minimum(np.abs(before), np.abs(after)) > least)
    between: Bools = beside & (values[[*WINDOW].index('along_m')] > off)
    return between


def _learn(drawn: Sequence[Drawn], recipe: Recipe, *, again: bool) -> dict[str, Any]:
    """Train an ensemble."""
    names = _names(again=again)
    used = _used(names)
    rows = [names.index(name) for name in used]
    some = [one._replace(values=one.values[rows]) for one in drawn]
    return learn(some, used, recipe.rounds[again])


def _names(*, again: bool) -> tuple[str, ...]:
    return (*WINDOW, *(SECOND_PASS if again else ()))


def _used(names: Sequence[str]) -> list[str]:
    return [name for name in names if name not in UNUSED]
