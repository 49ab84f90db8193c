# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees on mixed pixels of spinning sensors, and write their file.

Outliers are mixed pixels that were put into clean recordings. Good are all other points, except
those between both returns beside them in recordings: real mixed pixels, which nobody has labelled.
Streets are labelled completely; in them all points between leaves are good.

Sensors are left out in folds, each once, for the threshold and the figures of the file.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Progress, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.mixed_pixels import may_be_mixed
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    VERSION,
    read_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.training.held_out import (
    CLEAN,
    STREET,
    choose_threshold,
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
from lidar_outlier_lab.training.train import Sweep, lie_between, pattern_of

MIXED = 'mixed'  # the kind of sweeps
USED = [name for name in WINDOW if name not in {'bright', 'rank'}]  # with intensities or without
ROUNDS, FOLDS = 100, 3  # trees, and parts of the sensors
BAD, GOOD = 800, {MIXED: 1500, CLEAN: 3000, STREET: 1500}  # points of a sweep that are drawn
GOOD_COUNTS = {MIXED: 2.0, CLEAN: 5.0, STREET: 1.0}  # how much they count
BESIDE = 0.05  # m, at least, from an unlabelled mixed pixel to either return, and to their course
MAX_CLEAN_SHARE = 0.001  # of known good points, mean over the sensors but the worst


class _Judged(NamedTuple):
    """A sweep: of its N points in the pattern's order, masks; of the C judged ones, features."""

    sweep: Sweep
    judged: Bools
    outlier: Bools
    unknown: Bools
    values: Singles


def train(
    sweeps: Sequence[Sweep],
    about: Mapping[str, Any],
    seed: int = 1,
    progress: Progress = lambda _done, _total, _what: None,
) -> Trained:
    """Train one ensemble on the sweeps of kind ``mixed``, ``clean`` and ``street``.

    The same arguments give the same result. ``progress`` is as in :func:`.train.train`.

    Raises
    ------
    FilterError
        If a sweep has no scan pattern, or there is one sensor only.

    """
    trains = [sweep for sweep in sweeps if sweep.trains and sweep.kind in GOOD]
    # Simulated streets are good points only: with mixed pixels in them trees lose more foliage.
    trains = [sweep for sweep in trains if sweep.judged or sweep.kind == STREET]
    seen = [_observe(sweep) for sweep in trains]
    drawn = [_draw(one, seed, number) for number, one in enumerate(seen)]
    sensors = list(dict.fromkeys(sweep.sensor for sweep in trains if sweep.judged))
    if len(sensors) == 1:
        raise FilterError('the sensors to train on', 'at least 2: each is left out once', 1)
    results: list[Singles] = [np.empty(0, np.float32)] * len(seen)
    count = min(FOLDS, len(sensors))
    for k in range(count):
        fold = sensors[k::count]
        progress(k, count + 1, f'without {", ".join(fold)}')
        others = [d for d, one in zip(drawn, seen, strict=True) if one.sweep.sensor not in fold]
        trees = read_trees(learn(others, USED, ROUNDS), tuple(USED))
        for number, one in enumerate(seen):
            if one.sweep.sensor in fold:
                odds = np.full(len(one.judged), MIN_LOG_ODDS, np.float32)
                odds[one.judged] = judge_pass(trees, one.values, None)
                results[number] = odds
    progress(count, count + 1, 'with every sensor')
    threshold, held_out = _held_out(seen, results)
    data = {
        'version': VERSION,
        **about,
        'seed': seed,
        'uses': USED,
        'sweeps': [sweep.name for sweep in trains],
        'held_out': held_out,
        'threshold': threshold,
        'trees': learn(drawn, USED, ROUNDS),
    }
    return Trained(json.dumps(data, separators=(',', ':')), threshold, held_out)


def _observe(sweep: Sweep) -> _Judged:
    pattern = pattern_of(sweep)
    there = pattern.order >= 0
    values, judged = window_features(prepare(pattern), None), may_be_mixed(pattern)[there]
    outlier = sweep.outlier[pattern.order[there]]
    unknown = lie_between(pattern, values, BESIDE, BESIDE) & ~outlier & (sweep.kind != STREET)
    rows = [[*WINDOW].index(name) for name in USED]
    return _Judged(sweep, judged, outlier, unknown, values[rows][:, judged])


def _draw(seen: _Judged, seed: int, number: int) -> Drawn:
    """Draw judged points; of streets, whose outliers have other causes too, good ones only."""
    rng, kind = np.random.default_rng([seed, number]), seen.sweep.kind
    outlier, unknown = seen.outlier[seen.judged], seen.unknown[seen.judged]
    bad = np.flatnonzero(outlier & (kind == MIXED))
    good = np.flatnonzero(~outlier & ~unknown)
    rows, weight = draw_rows(rng, ((bad, BAD, 1.0), (good, GOOD[kind], GOOD_COUNTS[kind])))
    return Drawn(seen.values[:, rows], outlier[rows], weight)


def _held_out(seen: Sequence[_Judged], results: Sequence[Singles]) -> tuple[float, dict[str, Any]]:
    """Choose the least threshold that leaves known good points of clean sweeps alone.

    Returns the figures of each sensor left out, too: the share of mixed pixels found; of clean
    sweeps the share of known good points rejected, and of all points.
    """
    judged = [pair for pair in zip(seen, results, strict=True) if pair[0].sweep.judged]
    clean = [
        judge_at_all(one.sweep.sensor, CLEAN, one.unknown, odds)
        for one, odds in judged
        if one.sweep.kind == CLEAN
    ]
    threshold = choose_threshold(clean, MAX_CLEAN_SHARE)

    def mean(kind: str, some: Callable[[_Judged], Bools]) -> dict[str, float]:
        shares: dict[str, list[float]] = {}
        for one, odds in judged:
            if one.sweep.kind == kind:
                share = float(np.mean(odds[some(one)] > threshold))
                shares.setdefault(one.sweep.sensor, []).append(share)
        return {sensor: round(float(np.mean(each)), 6) for sensor, each in shares.items()}

    return threshold, {
        'found': mean(MIXED, lambda one: one.outlier),
        'known_good_rejected': mean(CLEAN, lambda one: ~one.unknown),
        'clean_rejected': mean(CLEAN, lambda one: ~one.outlier),
    }
