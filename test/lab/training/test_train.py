# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Training the trees on the scan pattern: what is written is what was learnt."""

import json

import numpy as np
import pytest
from helpers.scans import sweep
from sklearn.ensemble import HistGradientBoostingClassifier

from lidar_outlier_filter.core.detectors.boosted_trees.features import SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees, add_up
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.training.held_out import LIMITS, choose_threshold, figures, judge_at_all
from lidar_outlier_lab.training.learner import export, window_features
from lidar_outlier_lab.training.train import Recipe, Sweep, lie_between, train

FEW = (3, 4)  # trees
pytestmark = pytest.mark.usefixtures('few_edges')


def sweeps() -> list[Sweep]:
    """Return a few sweeps of a room by two sensors; some of the points are off its walls."""
    found = []
    for seed in range(4):
        points = sweep(seed, 0.1, columns=300 + 60 * (seed % 2))
        level = np.hypot(points.xyz[:, 0], points.xyz[:, 1])
        azimuth = np.arctan2(points.xyz[:, 1], points.xyz[:, 0])
        wall = np.minimum(8.0 / np.abs(np.cos(azimuth)), 5.0 / np.abs(np.sin(azimuth)))
        name = f'room {seed}'
        found.append(Sweep(name, f'sensor {seed % 2}', 'dust', points, level < 0.93 * wall))
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
    """The same seed gives the same bytes; the file says what it is."""
    about = {'about': 'a test', 'trained_on': {'weather': ['dust']}}
    text = train(sweeps(), about, Recipe(1, FEW)).text
    assert train(sweeps(), about, Recipe(1, FEW)).text == text
    data = json.loads(text)
    assert data.items() >= about.items()
    assert (data['seed'], data['sweeps']) == (1, ['room 0', 'room 1', 'room 2', 'room 3'])
    assert data['uses'] == [*WINDOW, *(name for name in SECOND_PASS if name != 'share')]
    assert [len(data[key]['values']) for key in ('first', 'again')] == [3, 4]
    assert {name for tree in data['first']['features'] for name in tree} <= {*WINDOW}
    assert {name for tree in data['again']['features'] for name in tree} <= {*WINDOW, *SECOND_PASS}


def test_sensor_that_is_left_out_does_not_train() -> None:
    """Wrong labels of one sensor change what is said of others, and of itself only by judging."""
    some = sweeps()
    inverse = [
        one._replace(outlier=~one.outlier) if one.sensor == 'sensor 1' else one for one in some
    ]
    right = train(some, {}, Recipe(1, (12, 12))).held_out['weather']['dust']['best_f1']
    wrong = train(inverse, {}, Recipe(1, (12, 12))).held_out['weather']['dust']['best_f1']
    # Each is judged by trees that know the other one only.
    assert right > 0.7
    assert wrong < right - 0.2


def test_weather_that_is_left_out_is_judged_only() -> None:
    """It changes neither trees nor threshold, and its figures are there."""
    some = sweeps()
    extra = some[0]._replace(name='more', kind='rain', outlier=~some[0].outlier)
    recipe = Recipe(1, FEW, unseen=('rain',))
    alone, more = (json.loads(train(s, {}, recipe).text) for s in (some, [*some, extra]))
    for name in ('first', 'again', 'sweeps', 'threshold', 'threshold_bright'):
        assert alone[name] == more[name]
    assert {*more['held_out']['weather']} == {'dust', 'rain'}
    known = json.loads(train([*some, extra], {}, Recipe(1, FEW)).text)
    assert known['first'] != more['first']


def test_threshold_and_figures() -> None:
    """The best mean F1 counts, of thresholds that leave clean sweeps alone; sensors count alike."""
    outlier = np.arange(1000) < 300
    odds = np.where(outlier, 2.0, -2.0).astype(np.float32)
    odds[:30] = 0.45  # found at low thresholds only
    dust = [judge_at_all('a', 'dust', outlier, odds), judge_at_all('a', 'dust', outlier, odds)]
    clean, nothing = np.full(1000, -3.0, np.float32), np.zeros(1000, np.bool_)
    assert choose_threshold([*dust, judge_at_all('a', 'clean', nothing, clean)]) == -1.0
    clean[:2] = 1.05
    one = judge_at_all('b', 'clean', nothing, clean)
    assert choose_threshold([*dust, one]) == pytest.approx(1.1)
    all_wrong = judge_at_all('b', 'clean', nothing, np.full(1000, 9.0, np.float32))
    assert choose_threshold([*dust, all_wrong]) == LIMITS[-1]
    # One sensor alone does not decide where there are others.
    fine = judge_at_all('c', 'clean', nothing, np.full(1000, -3.0, np.float32))
    assert choose_threshold([*dust, all_wrong, fine]) == -1.0
    assert choose_threshold([*dust, all_wrong, fine, one]) == pytest.approx(-1.0)
    other = judge_at_all('b', 'dust', outlier, np.full(1000, -5.0, np.float32))
    said = figures([*dust, other, one], 1.1)
    assert said['weather']['dust']['f1'] == pytest.approx(540 / 570 / 2, abs=1e-4)
    assert said['weather']['dust']['best_f1'] == pytest.approx(0.5, abs=1e-4)
    assert said['clean_rejected'] == {'b': 0.0}
    few = judge_at_all('a', 'rain', np.arange(1000) < 99, odds)
    assert 'rain' not in figures([few], 1.0)['weather']


def test_what_cannot_be_trained_on() -> None:
    """Sweeps without outliers, one sensor, and no pattern are refused."""
    some = sweeps()
    with pytest.raises(FilterError, match='outliers'):
        train([one._replace(outlier=np.zeros_like(one.outlier)) for one in some], {})
    with pytest.raises(FilterError, match='sensors'):
        train([one._replace(sensor='one') for one in some], {})
    few = some[0].points.take(slice(0, 8))
    with pytest.raises(FilterError, match='room 0'):
        train([*some[1:], some[0]._replace(points=few, outlier=some[0].outlier[:8])], {})


def test_mixed_points_do_not_train_as_good() -> None:
    """What lies between a near and a far surface is named; poles, walls and slopes are not."""
    columns, rings = 360, 8
    shot = np.arange(columns * rings)
    ring, column = shot % rings, shot // rings
    azimuth = -2 * np.pi * column / columns
    up = np.radians(np.linspace(-14.0, 14.0, rings))[ring]
    # A near wall, a far one, mixed points where they meet, and a pole before the far one.
    far = np.where(column < 180, 4.0 + 0.005 * column, 9.0)
    mixed, pole = column == 180, (column == 250) | (column == 251)
    far[mixed], far[pole] = 6.5, 5.0
    level = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(up)], axis=1)
    points = Points(far[:, None] * level, column * 277_777 + ring, ring, np.ones(len(shot), bool))
    pattern = find_pattern(points)
    assert pattern is not None
    values = window_features(prepare(pattern), None)
    found = lie_between(pattern, values)
    assert found.tolist() == mixed[pattern.order[pattern.order >= 0]].tolist()
