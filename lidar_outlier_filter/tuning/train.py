# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Train the trees on the scan pattern from labelled sweeps, and write their file.

Two ensembles are trained by scikit-learn's histogram boosting: one on each point's window, and one
on the points that the first does not call clearly good, with the first's results around them.

The package's own model differs in one step: there, the second saw results of a first that was
trained without the sweep's sensor. Here it sees those of the one first ensemble.
"""

from __future__ import annotations

import json
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.evidence.pattern_features import COUNT, FEATURES, measure
from lidar_outlier_filter.core.detectors.evidence.pattern_model import VERSION
from lidar_outlier_filter.core.detectors.evidence.pattern_scores import (
    AGAIN,
    COUNT_AGAIN,
    count_scores,
    measure_again,
)
from lidar_outlier_filter.core.detectors.evidence.pattern_window import prepare
from lidar_outlier_filter.core.detectors.evidence.trees import QUESTIONS, VALUES
from lidar_outlier_filter.core.neighbours.scan_pattern import find_pattern
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.detectors.evidence.pattern_window import Prepared
    from lidar_outlier_filter.core.points import Points

    Singles = NDArray[np.float32]
    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Mask = NDArray[np.bool_]
    Learner = Any  # a HistGradientBoostingClassifier: scikit-learn is an extra

DEPTH = 3  # questions from the root of a tree to a value
ROUNDS = (100, 120)  # trees of both ensembles
RATE = 0.2
DOUBTFUL = -3.0  # log-odds of the first from which on a point is looked at again
THRESHOLD = 1.2  # log-odds from which on a point is rejected
BAD, GOOD = 400, 900  # points of a sweep that are drawn
GOOD_OF_CLEAN = (4000, 5000)  # of a clean sweep, in both passes
ENOUGH = 500  # outliers of a sweep from which on all sweeps count the same
# How much a sweep's outliers, and its good points, count; 1 for every other kind.
BAD_COUNTS = {'ghosts': 0.15, 'mixed': 0.3, 'street': 1.5}
GOOD_COUNTS = {'clean': 5.0, 'street': 1.5}
NEVER = 3.0e38  # a limit that no feature exceeds


class Sweep(NamedTuple):
    """Points of one sweep in the sensor's own frame, and which of them are outliers.

    ``kind`` is a weather, ``clean`` or ``street``.
    """

    name: str
    kind: str
    points: Points
    outlier: Mask


class _Seen(NamedTuple):
    """A sweep with the features of its points, in the order of the pattern."""

    kind: str
    prepared: Prepared
    values: Singles
    outlier: Mask


class _Drawn(NamedTuple):
    """Points that are drawn from a sweep, and what each counts."""

    rows: Ints
    weight: Floats


def train(
    sweeps: Sequence[Sweep],
    seed: int,
    about: Mapping[str, Any],
    rounds: tuple[int, int] = ROUNDS,
) -> str:
    """Train both ensembles.

    Parameters
    ----------
    sweeps : of spinning sensors, with and without outliers
    seed : of the points drawn, from 0
    about : what the file says of its training
    rounds : trees of both ensembles

    Returns
    -------
    str
        The model's file: the same for the same arguments.

    Raises
    ------
    FilterError
        If a sweep has no scan pattern, or no point is an outlier.

    """
    if not any(sweep.outlier.any() for sweep in sweeps):
        raise FilterError('the training sweeps', 'ones with outliers', 'none')
    seen = [_look(sweep) for sweep in sweeps]
    rng = np.random.default_rng([seed, 0])
    parts = [_draw(one, rng) for one in seen]
    first = _fit(
        [s.values[:, p.rows] for s, p in zip(seen, parts, strict=True)], seen, parts, rounds[0]
    )
    odds = [first.decision_function(one.values.T).astype(np.float32) for one in seen]
    rng = np.random.default_rng([seed, 1])
    parts = [_draw(one, rng, score) for one, score in zip(seen, odds, strict=True)]
    tables = [
        _again(one, score)[:, part.rows] for one, score, part in zip(seen, odds, parts, strict=True)
    ]
    again = _fit(tables, seen, parts, rounds[1])
    data = {
        'version': VERSION,
        **about,
        'seed': seed,
        'sweeps': [sweep.name for sweep in sweeps],
        'doubtful': DOUBTFUL,
        'threshold': THRESHOLD,
        'first': export(first, FEATURES),
        'again': export(again, (*FEATURES, *AGAIN)),
    }
    return json.dumps(data, separators=(',', ':'))


def _look(sweep: Sweep) -> _Seen:
    pattern = find_pattern(sweep.points, spins=True)
    if pattern is None:
        raise FilterError('a training sweep', 'one with a scan pattern', sweep.name)
    prepared = prepare(pattern)
    out = np.zeros((COUNT, len(pattern.order)), np.float32)
    measure(prepared, 0, len(pattern.first), out)
    there = pattern.order >= 0
    outlier = sweep.outlier[pattern.order[there]]
    return _Seen(sweep.kind, prepared, out[:, there], outlier)


def _again(seen: _Seen, odds: Singles) -> Singles:
    """Return the features of the second pass, (COUNT_AGAIN, N)."""
    pattern = seen.prepared.pattern
    there = pattern.order >= 0
    score = np.zeros(len(there), np.float32)
    score[there] = odds
    out = np.zeros((COUNT_AGAIN, len(there)), np.float32)
    first = count_scores(pattern, score)
    measure_again(seen.prepared, first, 0, len(pattern.first), out)
    return out[:, there]


def _draw(seen: _Seen, rng: np.random.Generator, odds: Singles | None = None) -> _Drawn:
    """Draw points: of the second pass, only those that the first does not call clearly good."""
    asked = np.ones(len(seen.outlier), np.bool_) if odds is None else odds > DOUBTFUL
    bad, good = np.flatnonzero(seen.outlier & asked), np.flatnonzero(~seen.outlier & asked)
    all_bad = int(seen.outlier.sum())
    all_good = len(seen.outlier) - all_bad
    most = GOOD if seen.kind != 'clean' else GOOD_OF_CLEAN[odds is not None]
    some_bad = rng.choice(bad, min(BAD, len(bad)), replace=False)
    some_good = rng.choice(good, min(most, len(good)), replace=False)
    counts = BAD_COUNTS.get(seen.kind, 1.0) * min(1.0, all_bad / ENOUGH)
    of_bad = counts * len(bad) / max(all_bad, 1) / max(len(some_bad), 1)
    counts = 2.0 * GOOD_COUNTS.get(seen.kind, 1.0) * (1.0 if odds is None else 4.0)
    of_good = counts * len(good) / max(all_good, 1) / max(len(some_good), 1)
    return _Drawn(
        np.concatenate([some_bad, some_good]),
        np.repeat([of_bad, of_good], [len(some_bad), len(some_good)]),
    )


def _fit(tables: list[Singles], seen: list[_Seen], parts: list[_Drawn], rounds: int) -> Learner:
    weight = np.concatenate([part.weight for part in parts])
    outlier = np.concatenate([s.outlier[p.rows] for s, p in zip(seen, parts, strict=True)])
    learner: Learner = import_module('sklearn.ensemble').HistGradientBoostingClassifier(
        max_iter=rounds,
        max_leaf_nodes=2**DEPTH,
        max_depth=DEPTH,
        learning_rate=RATE,
        max_bins=128,
        early_stopping=False,
        min_samples_leaf=40,
        l2_regularization=1.0,
        random_state=0,
    )
    table = np.concatenate(tables, axis=1).T
    learner.fit(table, outlier, sample_weight=weight / weight.mean())
    return learner


def export(learner: Learner, names: Sequence[str]) -> dict[str, Any]:
    """Write an ensemble as full trees of three questions, in single precision."""
    start = float(np.float32(learner._baseline_prediction.ravel()[0]))  # noqa: SLF001
    trees = [_tree(stage[0].nodes, names) for stage in learner._predictors]  # noqa: SLF001
    return {
        'start': start,
        'features': [feature for feature, _, _ in trees],
        'limits': [limit for _, limit, _ in trees],
        'values': [value for _, _, value in trees],
    }


def _tree(nodes: Any, names: Sequence[str]) -> tuple[list[str], list[float], list[float]]:
    """Fill a tree up: below an early leaf all values are the leaf's."""
    feature = [names[0]] * QUESTIONS
    limit = [float(np.float32(NEVER))] * QUESTIONS
    value = [0.0] * VALUES
    pending = [(0, 0)]  # nodes, and their places in the full tree
    while pending:
        number, place = pending.pop()
        node = nodes[number]
        if node['is_leaf']:
            low = high = place
            while low < QUESTIONS:
                low, high = 2 * low + 1, 2 * high + 2
            for k in range(low, high + 1):
                value[k - QUESTIONS] = float(np.float32(node['value']))
        else:
            feature[place] = names[node['feature_idx']]
            limit[place] = _not_above(float(node['num_threshold']))
            pending += [(node['left'], 2 * place + 1), (node['right'], 2 * place + 2)]
    return feature, limit, value


def _not_above(limit: float) -> float:
    """Return the greatest number of single precision up to a limit: it parts the same numbers."""
    single = np.float32(limit)
    if float(single) > limit:
        single = np.nextafter(single, np.float32(-np.inf))
    return float(single)
