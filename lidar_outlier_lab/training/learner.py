# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""One ensemble of trees: learnt by scikit-learn's histogram boosting, written for our kernel.

And what both kinds of sensor share in training one: features of a pass, and what it judges.
"""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import count_scores, measure
from lidar_outlier_filter.core.detectors.boosted_trees.trees import QUESTIONS, VALUES, Trees
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared
from lidar_outlier_lab.training.held_out import HeldOut

Learner = Any  # a HistGradientBoostingClassifier: scikit-learn is an extra

DEPTH = 3  # questions from the root of a tree to a value
RATE = 0.2
EDGES = 128  # of a feature's histogram
MIN_LEAF_POINTS = 40  # points behind a value
NEVER = 3.0e38  # a limit that no feature exceeds


class Drawn(NamedTuple):
    """Points that train: features (F, N), whether outliers, and how much each counts."""

    values: Singles
    outlier: NDArray[np.bool_]
    weight: NDArray[np.float64]


def draw_rows(
    rng: np.random.Generator, groups: Iterable[tuple[Ints, int, float]]
) -> tuple[Ints, Floats]:
    """Draw rows of groups, each given as indices, how many at most, and how much they count.

    Returns the rows (R,), and weights (R,): all rows of a group together count that much.
    """
    rows, weights = [np.empty(0, np.int64)], [np.empty(0)]
    for index, most, count in groups:
        some = rng.choice(index, min(most, len(index)), replace=False)
        rows.append(some)
        weights.append(np.full(len(some), count / max(len(some), 1)))
    return np.concatenate(rows), np.concatenate(weights)


class Trained(NamedTuple):
    """The text of a model's file, the threshold and held-out figures that it says.

    ``judged`` are the sweeps behind the figures, in the order given.
    """

    text: str
    threshold: float
    held_out: Mapping[str, Any]
    judged: Sequence[HeldOut] = ()


def window_features(prepared: Prepared, odds: Singles | None) -> Singles:
    """Return the features (F, N) of a pass over the N points of a pattern, in its order.

    ``odds`` (N,) is what the first pass gave them; None: this is the first.
    """
    pattern = prepared.pattern
    there = pattern.order >= 0
    if odds is None:
        return measure(prepared)[:, there]
    score = np.zeros(len(there), np.float32)
    score[there] = odds
    return measure(prepared, count_scores(pattern, score))[:, there]


def judge_pass(
    trees: Trees, values: Singles, odds: Singles | None, doubtful: float = 0.0
) -> Singles:
    """Return the log-odds (N,) that a pass gives to points with these features (F, N).

    The first pass (``odds`` is None) judges all; the second only those to which the first gave more
    than ``doubtful``, and leaves the others as they were.
    """
    judged = np.ones(values.shape[1], np.bool_) if odds is None else odds > doubtful
    result = np.empty(len(judged), np.float32) if odds is None else odds.copy()
    total = np.empty(int(judged.sum()), np.float32)
    _kernels.add_trees(trees, np.ascontiguousarray(values[:, judged]), total)
    result[judged] = total
    return result


def learn(
    drawn: Sequence[Drawn], names: Sequence[str], rounds: int, rate: float = RATE
) -> dict[str, Any]:
    """Learn an ensemble of so many trees from all drawn points, and write it."""
    weight = np.concatenate([one.weight for one in drawn])
    learner: Learner = import_module('sklearn.ensemble').HistGradientBoostingClassifier(
        max_iter=rounds,
        max_leaf_nodes=2**DEPTH,
        max_depth=DEPTH,
        learning_rate=rate,
        max_bins=EDGES,
        early_stopping=False,
        min_samples_leaf=MIN_LEAF_POINTS,
        l2_regularization=1.0,
        random_state=0,
    )
    # On a busy machine its threads wait for each other much longer than one works alone.
    with import_module('threadpoolctl').threadpool_limits(1):
        learner.fit(
            np.concatenate([one.values for one in drawn], axis=1).T,
            np.concatenate([one.outlier for one in drawn]),
            sample_weight=weight / weight.mean(),
        )
    return export(learner, names)


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
    pending = [(0, 0)]  # nodes, and their indices in the full tree
    while pending:
        number, index = pending.pop()
        node = nodes[number]
        if node['is_leaf']:
            low = high = index
            while low < QUESTIONS:
                low, high = 2 * low + 1, 2 * high + 2
            for k in range(low, high + 1):
                value[k - QUESTIONS] = float(np.float32(node['value']))
        else:
            feature[index] = names[node['feature_idx']]
            limit[index] = _not_above(float(node['num_threshold']))
            pending += [(node['left'], 2 * index + 1), (node['right'], 2 * index + 2)]
    return feature, limit, value


def _not_above(limit: float) -> float:
    """Return the greatest number of single precision up to a limit: it parts the same numbers."""
    single = np.float32(limit)
    if float(single) > limit:
        single = np.nextafter(single, np.float32(-np.inf))
    return float(single)
