# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Training the trees on the scan pattern: what is written is what was learnt."""

import json

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier
from test_scan_pattern import sweep

from lidar_outlier_filter.core.detectors.evidence.pattern_features import FEATURES
from lidar_outlier_filter.core.detectors.evidence.pattern_scores import AGAIN
from lidar_outlier_filter.core.detectors.evidence.trees import Trees, add_up
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.tuning.train import Sweep, export, train


def sweeps() -> list[Sweep]:
    """Return a few sweeps of a room, some of whose points are off its walls."""
    found = []
    for seed in range(3):
        points = sweep(seed, 0.1, columns=120)
        level = np.hypot(points.xyz[:, 0], points.xyz[:, 1])
        azimuth = np.arctan2(points.xyz[:, 1], points.xyz[:, 0])
        wall = np.minimum(8.0 / np.abs(np.cos(azimuth)), 5.0 / np.abs(np.sin(azimuth)))
        found.append(Sweep(f'room {seed}', 'dust', points, level < 0.93 * wall))
    return found


@pytest.mark.parametrize(('rows', 'least'), [(600, 20), (150, 40)])
def test_exported_trees_are_the_learner(rows: int, least: int) -> None:
    """Full trees and such with early leaves say what the learner says, at limits too."""
    rng = np.random.default_rng(rows)
    values = rng.integers(-4, 5, (5, rows)).astype(np.float32)
    values[3] = rng.standard_normal(rows)
    outlier = values[0] * values[3] + values[1] > 1
    learner = HistGradientBoostingClassifier(
        max_iter=8, max_depth=3, max_leaf_nodes=8, min_samples_leaf=least, early_stopping=False
    ).fit(values.T, outlier)
    names = ['a', 'b', 'c', 'd', 'e']
    data = export(learner, names)
    trees = Trees(
        np.array([[names.index(name) for name in tree] for tree in data['features']], np.int32),
        np.array(data['limits'], np.float32),
        np.array(data['values'], np.float32),
        np.float32(data['start']),
    )
    total = np.empty(rows, np.float32)
    add_up(trees, values, total)
    assert total == pytest.approx(learner.decision_function(values.T), abs=1e-5)


def test_file_is_complete_and_repeats() -> None:
    """The same seed gives the same bytes, another one others; the file says what it is."""
    about = {'about': 'a test', 'trained_on': {'weather': ['dust']}}
    text = train(sweeps(), 1, about, rounds=(3, 4))
    assert train(sweeps(), 1, about, rounds=(3, 4)) == text
    assert train(sweeps(), 2, about, rounds=(3, 4)) != text
    data = json.loads(text)
    assert data.items() >= about.items()
    assert (data['seed'], data['sweeps']) == (1, ['room 0', 'room 1', 'room 2'])
    assert [len(data[key]['values']) for key in ('first', 'again')] == [3, 4]
    assert {name for tree in data['first']['features'] for name in tree} <= {*FEATURES}
    assert {name for tree in data['again']['features'] for name in tree} <= {*FEATURES, *AGAIN}


def test_what_cannot_be_trained_on() -> None:
    """Sweeps without outliers, and one without a pattern, are refused."""
    some = sweeps()
    with pytest.raises(FilterError, match='outliers'):
        train([one._replace(outlier=np.zeros_like(one.outlier)) for one in some], 1, {})
    few = some[0].points.take(slice(0, 8))
    with pytest.raises(FilterError, match='room 0'):
        train([*some[1:], Sweep('room 0', 'dust', few, some[0].outlier[:8])], 1, {})
