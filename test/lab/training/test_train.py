# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Training the trees: what is written is what was learnt."""

import json
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from helpers.scans import edges, pattern_of, sweep
from sklearn.ensemble import HistGradientBoostingClassifier

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors import boosted_trees
from lidar_outlier_filter.core.detectors.boosted_trees.features import SECOND_PASS, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    FEATURE_NAMES,
    PATTERN_MODEL,
    SURVEY_MODEL,
    Trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_lab.simulation.scenes import profile_streets
from lidar_outlier_lab.simulation.scenes.survey_errors import add_errors
from lidar_outlier_lab.simulation.scenes.survey_scenes import KINDS, SurveyScene, training_scene
from lidar_outlier_lab.simulation.weather.kinds import WEATHERS
from lidar_outlier_lab.training import (
    free_sweeps,
    more_sweeps,
    scenes,
    train_ghosts,
    train_mixed,
    train_profile,
    train_sweeps,
)
from lidar_outlier_lab.training.folds import train_in_folds
from lidar_outlier_lab.training.held_out import LIMITS, choose_threshold, figures, judge_at_all
from lidar_outlier_lab.training.learner import export, window_features
from lidar_outlier_lab.training.ring_tables import TABLES, known_scanners, read_elevations
from lidar_outlier_lab.training.single_sweeps import read_more_sweeps, read_single_sweeps
from lidar_outlier_lab.training.train import Recipe, Sweep, lie_between, train
from lidar_outlier_lab.training.train_survey import RECIPE, SCENES, see

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
    at_limits = rng.choice(trees.limit[trees.limit < 9], values.shape)
    for seen in (values, at_limits):
        total = np.empty(rows, np.float32)
        _kernels.add_trees(trees, seen, total)
        assert total == pytest.approx(learner.decision_function(seen.T), abs=1e-5)


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
    for name in ('first', 'again', 'sweeps', 'threshold', 'drop'):
        assert alone[name] == more[name]
    assert {*more['held_out']['weather']} == {'dust', 'rain'}
    known = json.loads(train([*some, extra], {}, Recipe(1, FEW)).text)
    assert known['first'] != more['first']


def test_threshold_and_figures() -> None:
    """The worst quarter counts, of thresholds that leave clean sweeps alone; each sensor alike."""
    outlier = np.arange(1000) < 300
    odds = np.where(outlier, 2.0, -2.0).astype(np.float32)
    odds[:30] = 0.45  # found at low thresholds only
    dust = [judge_at_all('a', 'dust', outlier, odds), judge_at_all('a', 'dust', outlier, odds)]
    clean, nothing = np.full(1000, -3.0, np.float32), np.zeros(1000, np.bool_)
    assert choose_threshold([*dust, judge_at_all('a', 'clean', nothing, clean)]) == -1.0
    clean[:2] = 1.05
    one = judge_at_all('b', 'clean', nothing, clean)
    assert choose_threshold([*dust, one]) == pytest.approx(1.06)
    # F1 is 1 or 0.6 here, and 0.4 or 0.6 there: the mean is better at the lower threshold.
    fifth = np.arange(1000) < 129
    here = judge_at_all('a', 'rain', outlier, np.where(fifth, 2.0, np.where(outlier, 0.5, -2.0)))
    good = np.where(np.arange(1000) < 516, 0.5, -2.0)
    there = judge_at_all('a', 'fog', outlier, np.where(fifth, 2.0, np.where(outlier, -5.0, good)))
    assert choose_threshold([here, there]) == pytest.approx(0.5)
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
    points, mixed = edges()
    pattern = pattern_of(points)
    values = window_features(prepare(pattern), None)
    found = lie_between(pattern, values)
    assert found.tolist() == mixed[pattern.order[pattern.order >= 0]].tolist()


def test_file_of_mixed_pixels_is_complete_and_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most are found on the sensor left out, and a clean room is left alone."""
    monkeypatch.setattr(train_mixed, 'ROUNDS', 8)
    mixed = [one._replace(kind='mixed') for one in sweeps()]
    room = [one.points.take(~one.outlier) for one in mixed]
    clean = [
        one._replace(kind='clean', points=points, outlier=np.zeros(len(points), np.bool_))
        for one, points in zip(mixed, room, strict=True)
    ]
    first, second = (train_mixed.train([*mixed, *clean], {'about': 'a test'}) for _ in range(2))
    assert first.text == second.text
    data = json.loads(first.text)
    assert [data[name] for name in ('seed', 'uses')] == [1, train_mixed.USED]
    assert data['held_out'] == first.held_out
    assert min(first.held_out['found'].values()) > 0.7
    assert max(first.held_out['clean_rejected'].values()) < 0.01
    with pytest.raises(FilterError, match='sensors'):
        train_mixed.train([one._replace(sensor='one') for one in mixed], {})


def test_trees_on_ghosts_are_added(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ensembles and their threshold stay; without ghosts everything does."""
    monkeypatch.setattr(train_ghosts, 'ROUNDS', 8)
    shipped = json.loads((files(boosted_trees) / PATTERN_MODEL).read_text())
    text = json.dumps({**shipped, 'threshold': 50.0})  # everything is kept
    ghosts, clean = [], []
    for one in sweeps():
        far = 1.0 + np.where(one.outlier, 40.0, 0.0) / one.points.range  # metres behind the walls
        points = replace(one.points, xyz=one.points.xyz * far[:, None])
        some = one.outlier & (np.arange(len(points)) % 4 > 0)  # others are seen through a window
        ghosts.append(one._replace(kind='ghosts', points=points, outlier=some))
        room = points.take(~one.outlier)
        clean.append(one._replace(kind='clean', points=room, outlier=np.zeros(len(room), np.bool_)))
    once, twice = (train_ghosts.add_ghosts([*ghosts, *clean], text) for _ in range(2))
    assert once == twice
    before, after = json.loads(text), json.loads(once)
    assert {name for name in after if before.get(name) != after[name]} == {'ghosts', 'held_out'}
    found = after['held_out']['ghosts']
    assert found['found'] >= found['found_before'] >= found['lost'] <= train_ghosts.MOST_LOST
    assert train_ghosts.add_ghosts(clean, text) == text
    assert train_ghosts.add_ghosts([*ghosts[:1], *clean], text) == text


# Clouds without scan lines ------------------------------------------------------------------------

WALLS = (3, 9, 13, 19)  # seeds of small scenes


@pytest.fixture(scope='module')
def walls() -> list[SurveyScene]:
    """Simulate some small scenes."""
    return [training_scene(seed) for seed in WALLS]


def test_scenes_differ_and_repeat(walls: list[SurveyScene]) -> None:
    """A seed gives the same points each time, another seed others."""
    again = training_scene(WALLS[1])
    np.testing.assert_array_equal(again.xyz, walls[1].xyz)
    np.testing.assert_array_equal(again.cause, walls[1].cause)
    assert len({len(scene.xyz) for scene in walls}) == len(walls)
    assert all(scene.name.startswith('walls') for scene in walls)
    assert any(scene.cause.any() for scene in walls)
    assert SCENES % len(KINDS) == 0


def test_errors_come_behind_the_points() -> None:
    """A few of them, and each with a cause."""
    rng = np.random.default_rng(1)
    good = rng.uniform((0.0, 0.0, 0.0), (20.0, 20.0, 0.01), (3000, 3))
    xyz, cause = add_errors(good, 0.02, rng)
    np.testing.assert_array_equal(xyz[:3000], good)
    assert not cause[:3000].any()
    assert cause[3000:].all()
    assert 0 < len(xyz) - 3000 < 150


def test_file_of_surveys_is_complete_and_repeats(walls: list[SurveyScene]) -> None:
    """The same scenes give the same bytes, which say what they saw."""
    scenes, few = [see(one) for one in walls], RECIPE._replace(rounds=(4, 4))
    first, second = (train_in_folds(scenes, few, {'about': 'a test'}) for _ in range(2))
    assert first.text == second.text
    data = json.loads(first.text)
    assert data['uses'] == list(FEATURE_NAMES[SURVEY_MODEL][1])
    assert data['scenes'] == [scene.name for scene in walls]
    assert len(data['first']['features']) == len(data['again']['features']) == 4
    assert set(data['held_out']['kinds']) == {'walls'}


# The command --------------------------------------------------------------------------------------

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make few scenes and few trees."""
    monkeypatch.setattr(scenes, 'STREETS', ())
    monkeypatch.setattr(scenes, 'OF_EACH', 1)
    monkeypatch.setattr(scenes, 'WEATHERS', {'dust': WEATHERS['dust']})
    monkeypatch.setattr(scenes, 'MAX_SHARE', {'dust': scenes.MAX_SHARE['dust']})
    seed, _, *others = Recipe.__new__.__defaults__ or ()
    monkeypatch.setattr(Recipe.__new__, '__defaults__', (seed, (3, 4), *others))
    values = {'SCANNERS': 1, 'STREETS': 1, 'WEATHER': ('dust',), 'SHOTS': (2e4, 2e4)}
    values['RECIPE'] = free_sweeps.RECIPE._replace(rounds=(3, 4))
    for name, value in values.items():
        monkeypatch.setattr(free_sweeps, name, value)


def sensor(recordings: Path, name: str) -> scenes.CleanRecording:
    """Find one of the known recordings."""
    known = {one.sensor: one for one in scenes.known_recordings(recordings / 'bags')}
    return known[name]


def test_weather_is_put_into_a_cloud(recordings: Path) -> None:
    """Same seed, same points; outliers are what the weather makes, and the others are the cloud."""
    cloud = scenes.read_sweeps(sensor(recordings, 'VLP-16'), 1)[0]
    points, outlier = scenes.put_weather(cloud, 'heavy_snow', [1, 2])
    again, same = scenes.put_weather(cloud, 'heavy_snow', [1, 2])
    assert np.array_equal(points.xyz, again.xyz)
    assert np.array_equal(outlier, same)
    other, _ = scenes.put_weather(cloud, 'heavy_snow', [1, 3])
    assert not np.array_equal(points.xyz[:100], other.xyz[:100])
    assert 0.01 < outlier.mean() < 0.9
    given = {tuple(row) for row in cloud.xyz.astype(np.float32).round(3).tolist()}
    good = [tuple(row) for row in points.xyz[~outlier].astype(np.float32).round(3).tolist()]
    assert np.mean([row in given for row in good]) > 0.95
    assert points.valid.all()


def test_rings_of_published_tables(real_data: Path, tmp_path: Path) -> None:
    """Elevations are those of the files, in ascending order; sensors simulated have them."""
    folder = real_data / 'ring_tables'
    pandar = np.degrees(read_elevations(folder / 'Pandar64.csv'))
    assert pandar[[0, -1]] == pytest.approx([-24.897, 14.9], abs=0.02)
    assert (np.diff(pandar) > 0).all()
    velodyne = np.degrees(read_elevations(folder / 'VLP32.yaml'))
    assert velodyne[[0, 1, -1]] == pytest.approx([-25.0, -15.639, 15.0], abs=1e-3)
    scanners = known_scanners(folder)
    assert {*scanners} == {*TABLES}
    assert scanners['Pandar64'].rings == 64
    assert scanners['Pandar64'].lines_per_second == pytest.approx(10.0, rel=1e-3)
    assert known_scanners(tmp_path) == {}
    (tmp_path / 'wrong.csv').write_text('Laser,Azimuth\n1,2\n')
    with pytest.raises(RecordingError, match=r'the table of rings .* must be one of elevations'):
        read_elevations(tmp_path / 'wrong.csv')


def test_single_sweeps(real_data: Path) -> None:
    """Files without rings or times get both: the points of a ring lie on a cone, in turn."""
    found = dict(read_single_sweeps(real_data))
    assert {*found} == {'Pandar64', 'Pandar40P', 'Helios', 'RubyPlus', 'Bpearl'}
    assert {name: len(clouds) for name, clouds in found.items()} == {
        'Pandar64': 1, 'Pandar40P': 1, 'Helios': 1, 'RubyPlus': 2, 'Bpearl': 2
    }  # fmt: skip
    for clouds in found.values():
        assert all(map(scenes.has_pattern, clouds))
    (pandar,) = found['Pandar64']
    up = np.degrees(np.arcsin(pandar.xyz[:, 2] / pandar.range))
    table = np.degrees(read_elevations(real_data / 'ring_tables' / 'Pandar64.csv'))
    assert np.abs(up - table[pandar.line]).max() < 0.01


def test_more_sweeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that are there are read as they were decoded; one with other bytes is refused."""
    assert read_more_sweeps(tmp_path) == []
    (there := tmp_path / 'clouds/more/a.pcd').parent.mkdir(parents=True)
    head = 'VERSION .7\nFIELDS x y z intensity ring t\nSIZE 4 4 4 4 2 4\nTYPE F F F F U U\n'
    head += 'WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n'
    there.write_text(f'{head}1 2 3 4 5 6\n7 8 9 10 11 12\n')
    digest = sha256(there.read_bytes()).hexdigest()
    rows = [{'file': 'a.pcd', 'sensor': 'A', 'sha256': digest}, {'file': 'b.pcd'}]
    monkeypatch.setattr(more_sweeps, 'SWEEPS', rows)
    ((sensor, (found,)),) = read_more_sweeps(tmp_path)
    assert (sensor, *found.xyz[1], *found.line, *found.t) == ('A', 7, 8, 9, 5, 11, 6, 12)
    there.write_text(there.read_text().replace('12', '13'))
    with pytest.raises(RecordingError, match=rf'the SHA-256 of .*a\.pcd must be {digest}, got '):
        read_more_sweeps(tmp_path)


@pytest.mark.usefixtures('few', 'few_edges')
@pytest.mark.parametrize('free', [[], ['--free']])
def test_command(recordings: Path, tmp_path: Path, capsys: Capture, free: list[str]) -> None:
    """Recordings given train; the file says which. Without rings drawn scanners do, too."""
    onto = [str(recordings / 'bags' / name) for name in ('vlp16_mrpt_mcap', 'os0_32.bag')]
    output = tmp_path / 'mine.json'
    assert main(['train', *free, '--onto', *onto, '--output', str(output)]) == 0
    data = json.loads(output.read_text())
    assert data['trained_on']['recordings'] == ['vlp16_mrpt_mcap', 'os0_32']
    more = [free_sweeps.STRAYS] if free else [f'{law} dust' for law in scenes.TRAINED]
    assert {*data['held_out']['weather']} == {'dust', *more}
    assert bool(free) == ({'scanner 0 clean 900', 'os0_32 dust 0 thinned 0'} <= {*data['sweeps']})
    assert {'written', 'vlp16_mrpt_mcap'} <= {*capsys.readouterr().out.split()}


@pytest.mark.usefixtures('few')
def test_command_for_sweeps(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recordings train without their rings, in frames of vehicles: clean ones and each weather."""
    monkeypatch.setattr(train_sweeps, 'RECIPE', RECIPE._replace(rounds=(3, 4)))
    onto = [str(recordings / 'bags' / name) for name in ('vlp16_mrpt_mcap', 'os0_32.bag')]
    output = tmp_path / 'mine.json'
    assert main(['train', '--sweep', '--onto', *onto, '--output', str(output)]) == 0
    data = json.loads(output.read_text())
    laws = {f'{law}_dust' for law in scenes.TRAINED}
    assert {*data['held_out']['kinds']} == {'clean', 'dust', *laws}
    assert {'chances_dust os0_32 chances dust 0', 'clean os0_32 clean 0'} <= {*data['sweeps']}
    assert data['drop'] > 0


def test_what_the_command_refuses(tmp_path: Path, capsys: Capture) -> None:
    """A file that exists, a seed below 0, and a folder without recordings are refused."""
    (there := tmp_path / 'there.json').write_text('{}')
    assert main(['train', '--output', str(there)]) == 1
    assert 'the output must be a new file' in capsys.readouterr().err
    new = ['train', '--output', str(tmp_path / 'new.json')]
    assert main([*new, '--seed', '-1']) == 1
    assert '--seed must be at least 0' in capsys.readouterr().err
    assert main([*new, '--data', str(tmp_path)]) == 1
    assert '--data must be a folder' in capsys.readouterr().err
    for option, value in (('--onto', 'a'), ('--set', 'block=0.2')):
        assert main([*new, '--profile', option, value]) == 1
        assert f'--profile must be without {option}' in capsys.readouterr().err
    assert not (tmp_path / 'new.json').exists()


@pytest.mark.usefixtures('few_edges')
def test_command_for_profile_scanners(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Streets train; the file says which, and the figures are of streets left out."""
    monkeypatch.setattr(train_profile, 'STREETS', 3)
    few = train_profile.RECIPE._replace(rounds=(3, 4))
    monkeypatch.setattr(train_profile, 'RECIPE', few)
    monkeypatch.setattr(profile_streets, 'SHOTS', 10_000)
    monkeypatch.setattr(profile_streets, 'SHORTEST', 0.2)
    monkeypatch.setattr(profile_streets, 'BY_HEADS', 0.0)
    output = tmp_path / 'mine.json'
    assert main(['train', '--profile', '--output', str(output)]) == 0
    data = json.loads(output.read_text())
    assert data['trained_on'] == {'streets': 3, 'street_seeds': [0, 2]}
    assert data['streets'] == [f'profile street {n}' for n in range(3)]
    assert data['held_out']['mixed']['lost'] <= train_profile.MIXED_LOST
    assert 'street left out' in capsys.readouterr().out
