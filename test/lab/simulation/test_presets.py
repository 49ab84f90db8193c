# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Every preset: its figures, its truth, its seed; and the command that records it."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial import cKDTree

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.messages.truth import Cause, Kind
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab.cli.simulate import add_simulate
from lidar_outlier_lab.simulation.papers import aerial
from lidar_outlier_lab.simulation.papers import bus_tracks as bus
from lidar_outlier_lab.simulation.papers import surveyed_streets as leslar
from lidar_outlier_lab.simulation.presets import PRESETS, make
from lidar_outlier_lab.simulation.scenes import spinning_streets as streets

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Rows
    from lidar_outlier_lab.simulation.world.recording import Cloud

SMALL = 'sotoodeh-hod'
SLOW = pytest.mark.slow  # the first test of a large preset simulates it


@cache
def clouds(name: str) -> tuple[Cloud, ...]:
    """Simulate a preset once."""
    return tuple(make(name))


def points(name: str) -> Rows:
    """Give all points of a preset."""
    return np.concatenate([cloud.points for cloud in clouds(name)])


def xyz(some: Rows) -> NDArray[np.float64]:
    """Coordinates (N, 3)."""
    return np.stack([some[axis].astype(np.float64) for axis in 'xyz'], axis=1)


def count(some: Rows) -> dict[Cause, int]:
    """Count outliers by cause."""
    numbers = np.bincount(some['label'], minlength=len(Cause))
    return {cause: int(numbers[cause]) for cause in Cause if cause and numbers[cause]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'total', 'outliers'),
    [
        pytest.param('leslar-a', 1_098_689, 11_035, marks=SLOW),
        ('leslar-b', 295_147, 872),
        pytest.param('leslar-c', 237_740, 31, marks=SLOW),
        pytest.param('pirotti-sfm', 1_002_596, 2596, marks=SLOW),
        ('pirotti-fcd', 72_000, 540),
        ('sotoodeh-hod', 656, 84),
        pytest.param('kang-urban', 500_000, 250, marks=SLOW),
        pytest.param('kang-mountain', 1_000_000, 240, marks=SLOW),
    ],
)
def test_sizes(name: str, total: int, outliers: int) -> None:
    """The papers' numbers of points and outliers are met exactly."""
    some = points(name)
    assert len(some) == total
    assert sum(count(some).values()) == outliers


@SLOW
@pytest.mark.parametrize('rings', streets.SENSORS)
def test_shares_of_streets(rings: int) -> None:
    """A street has the stated share of outliers, and one cloud a turn with all its rings."""
    made, weather = clouds(f'street-{rings}'), streets.WEATHER[rings]
    some = points(f'street-{rings}')
    assert np.mean(some['label'] != 0) == pytest.approx(weather.share, abs=2 / len(some))
    assert len(made) == weather.turns
    for cloud in made:
        assert cloud.frame == 'lidar'
        assert np.unique(cloud.points['ring']).tolist() == list(range(rings))
        t = cloud.points['t'].astype(np.int64)
        assert (np.diff(t) > 0).all()
        assert t[-1] < cloud.sent - cloud.stamp
    # The sky, and open windows, leave shots without a point.
    shots = streets.SENSORS[rings].shots_per_line * weather.turns
    assert 0.7 < len(some) / shots < 0.99


@pytest.mark.parametrize(
    ('name', 'causes'),
    [
        pytest.param(
            'leslar-a',
            {Cause.EXHAUST, Cause.REFLECTION, Cause.NEAR_SURFACE, Cause.BARRIER},
            marks=SLOW,
        ),
        pytest.param('leslar-b', {Cause.REFLECTION, Cause.NEAR_SURFACE, Cause.BARRIER}, marks=SLOW),
        pytest.param('leslar-c', {Cause.NEAR_SURFACE}, marks=SLOW),
        pytest.param('pirotti-sfm', {Cause.SINGLE, Cause.CLUSTER}, marks=SLOW),
        ('pirotti-fcd', {Cause.SINGLE, Cause.DETOUR}),
        ('sotoodeh-hod', {Cause.SINGLE, Cause.CLUSTER}),
        pytest.param('kang-urban', {Cause.BIRD, Cause.REFLECTION}, marks=SLOW),
        pytest.param('kang-mountain', {Cause.BIRD, Cause.REFLECTION}, marks=SLOW),
        pytest.param('street-32', {Cause.SNOW, Cause.MIXED, Cause.GHOST}, marks=SLOW),
        pytest.param(
            'street-64', {Cause.RAIN, Cause.MIXED, Cause.GHOST, Cause.REFLECTION}, marks=SLOW
        ),
        pytest.param(
            'street-128',
            {Cause.RAIN, Cause.SPRAY, Cause.MIXED, Cause.GHOST, Cause.REFLECTION},
            marks=SLOW,
        ),
    ],
)
def test_causes(name: str, causes: set[Cause]) -> None:
    """Each preset has outliers of its causes, and good points lie on something."""
    some = points(name)
    assert causes <= set(count(some))
    if not name.startswith('street'):
        assert causes == set(count(some))
    good = some['label'] == Cause.GOOD
    assert (some['surface'][good] != Kind.AIR).all()
    assert (some['surface'] < len(Kind)).all()
    assert np.isfinite(xyz(some)).all()


@SLOW
def test_dense_and_scattered_outliers() -> None:
    """Most of A's outliers are in two groups over the road; C's are 4 to 16 cm above it."""
    some = points('leslar-a')
    numbers = count(some)
    assert numbers[Cause.EXHAUST] > 0.75 * sum(numbers.values())
    exhaust = xyz(some[some['label'] == Cause.EXHAUST])
    middle = (np.percentile(exhaust[:, 0], 5) + np.percentile(exhaust[:, 0], 95)) / 2.0
    sides = exhaust[:, 0] < middle
    assert 0.2 < sides.mean() < 0.8
    gap = np.median(exhaust[~sides, 0]) - np.median(exhaust[sides, 0])
    assert gap > 3.0 * exhaust[sides, 0].std()
    low = points('leslar-c')
    road = low[(low['surface'] == Kind.ROAD)]
    tree = cKDTree(xyz(road)[:, :2])
    bad = xyz(low[low['label'] != 0])
    _, near = tree.query(bad[:, :2], 9)
    above = bad[:, 2] - np.median(road['z'][near], axis=1)
    assert above.min() > 0.02
    assert above.max() < 0.19


def test_lines_of_a_survey() -> None:
    """Points of a survey are in the scene's frame, in order of time, their lines numbered."""
    made = clouds('leslar-b')
    some = points('leslar-b')
    survey = leslar.SURVEYS['leslar-b']
    assert {cloud.frame for cloud in made} == {'map'}
    times = np.concatenate([cloud.stamp + cloud.points['t'].astype(np.int64) for cloud in made])
    assert (np.diff(times) > 0).all()
    interval = 1_000_000_000 / (survey.lines_per_second * survey.shots_per_line)
    assert interval == 5000
    shot = (times - made[0].stamp) // 5000
    np.testing.assert_array_equal(some['line'], shot // survey.shots_per_line)
    angle = 2 * np.pi * (shot % survey.shots_per_line) / survey.shots_per_line
    np.testing.assert_allclose(some['scan_angle'], angle, rtol=1e-6)
    assert all(len(np.unique(cloud.points['line'])) == 10 for cloud in made[:-1])


@SLOW
def test_vehicle_stands_in_a() -> None:
    """For a while the lines of A lie upon each other."""
    some = points('leslar-a')
    road = some[(some['surface'] == Kind.ROAD) & (np.abs(some['y'] + 1.6) < 0.05)]
    lines = np.unique(road['line'])
    x = np.array([np.median(road['x'][road['line'] == line]) for line in lines])
    steps = (x[20:] - x[:-20]) / (lines[20:] - lines[:-20])
    assert 200 < (np.abs(steps) < 0.001).sum() < 300
    assert np.median(steps[:100]) == pytest.approx(7.0 / 200.0, rel=0.15)


@SLOW
def test_pirotti_outliers_are_off_the_others() -> None:
    """Single points are 1 to 200 m from the good ones; clusters have 2 to 30 points."""
    some = points('pirotti-sfm')
    where, label = xyz(some), some['label']
    surface = cKDTree(where[label == Cause.GOOD])
    singles, members = where[label == Cause.SINGLE], where[label == Cause.CLUSTER]
    assert len(singles) == len(members) == 1298
    for group in (singles, members):
        off = surface.query(group)[0]
        # Coordinates are float32, good to 8 µm here.
        assert off.min() >= 1.0 - 1e-4
        assert off.max() <= 202.0
    assert 0.3 < (singles[:, 2] > 30.0).mean() < 0.6
    assert (singles[:, 2] < -5.0).mean() > 0.4
    # A cluster's points are within a few of its standard deviations; clusters are far apart.
    tree = cKDTree(members)
    assert (tree.query(members, 2)[0][:, 1] < 2.0).mean() > 0.99
    groups = [len(near) for near in tree.query_ball_point(members, 4.0)]
    assert min(groups) >= 2
    assert np.percentile(groups, 99) < 45
    # 31 points to the square metre.
    area = np.prod([np.ptp(where[:, axis]) for axis in (0, 1)])
    assert len(some) / area == pytest.approx(31.0, rel=0.01)


@SLOW
@pytest.mark.parametrize('name', ['kang-urban', 'kang-mountain'])
def test_gross_errors(name: str) -> None:
    """High ones are 3 to 300 m above what is around them, low ones 3 to 60 m below."""
    some = points(name)
    where, label = xyz(some), some['label']
    tree = cKDTree(where[label == Cause.GOOD][:, :2])
    good = where[label == Cause.GOOD][:, 2]
    for cause, low, high in ((Cause.BIRD, 3.0, 300.0), (Cause.REFLECTION, -60.0, -3.0)):
        bad = where[label == cause]
        _, near = tree.query(bad[:, :2], 12)
        off = bad[:, 2] - np.median(good[near], axis=1)
        assert ((off > low - 25.0) & (off < high + 25.0)).all()
        assert (off > 2.0 if cause == Cause.BIRD else off < 0.0).mean() > 0.8
    assert np.unique(some['t']).tolist() == [0]
    assert (np.diff(some['gps_time']) > 0).all()
    assert len(np.unique(some['line'])) * 1000 == len(some)
    kinds = {Kind.TERRAIN, Kind.ROOF, Kind.FOLIAGE}
    assert set(some['surface'][label == 0].tolist()) == kinds


def test_bus_lines() -> None:
    """Each line is there twice, flat and with its speed; outliers are off the route."""
    made = {cloud.topic: cloud.points for cloud in clouds('pirotti-fcd')}
    assert list(made) == ['/line_11/flat', '/line_11/speed', '/line_39/flat', '/line_39/speed']
    for number, line in bus.LINES.items():
        flat, speed = made[f'/line_{number}/flat'], made[f'/line_{number}/speed']
        assert (flat['z'] == 0.0).all()
        for field in ('x', 'y', 'label', 'second'):
            np.testing.assert_array_equal(flat[field], speed[field])
        assert flat['second'].tolist() == list(range(line.points))
        assert np.count_nonzero(flat['label']) == line.outliers
        bad = flat['label'] != 0
        off = cKDTree(xyz(flat[~bad])).query(xyz(flat[bad]))[0]
        assert off.min() > 8.0
        assert off.max() < 410.0
        good = xyz(flat[~bad])
        pace = np.linalg.norm(np.diff(good, axis=0), axis=1)
        assert np.median(pace) < 1.5 * line.speed
        # As fast as it drives on the average between stops; and it stands.
        moving = speed['z'][~bad] > 10.0
        assert np.mean(speed['z'][~bad][moving]) / 3.6 == pytest.approx(line.speed, rel=0.25)
        assert 0.1 < np.mean(speed['z'][~bad] < 3.0) < 0.95
        # Some of those that are off stand at the very same place.
        assert len(np.unique(xyz(flat[bad]), axis=0)) < line.outliers - 3


@pytest.fixture
def smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the large presets have fewer points: what draws them is the same."""
    for name, survey in leslar.SURVEYS.items():
        lines, points = survey.lines_per_second / 20, survey.points // 20
        outliers = max(survey.outliers // 20, 5)
        fewer = replace(survey, lines_per_second=lines, points=points, outliers=outliers)
        monkeypatch.setitem(leslar.SURVEYS, name, fewer)
    for name, flight in aerial.FLIGHTS.items():
        shorter = replace(flight, lines=flight.lines // 10, shots=flight.shots // 20)
        monkeypatch.setitem(aerial.FLIGHTS, name, shorter)
    monkeypatch.setattr(aerial, 'GOOD', 50_000)
    for number, weather in streets.WEATHER.items():
        monkeypatch.setitem(streets.WEATHER, number, replace(weather, turns=2))
        sensor = streets.SENSORS[number]
        columns, column_time = sensor.columns // 8, 8 * sensor.column_time
        coarser = replace(sensor, columns=columns, column_time=column_time)
        monkeypatch.setitem(streets.SENSORS, number, coarser)


@pytest.mark.usefixtures('smaller')
@pytest.mark.parametrize('name', PRESETS)
def test_same_seed_same_points(name: str) -> None:
    """The same seed gives the same bytes, another seed others."""
    first, again, other = (tuple(make(name, seed)) for seed in (1, 1, 2))
    for a, b in zip(first, again, strict=True):
        assert (a.stamp, a.sent, a.topic) == (b.stamp, b.sent, b.topic)
        assert a.points.tobytes() == b.points.tobytes()
    assert any(cloud.points['label'].any() for cloud in first)
    assert first[0].points.tobytes() != other[0].points.tobytes()


@pytest.mark.parametrize(
    ('name', 'share', 'total', 'outliers'),
    [
        pytest.param('leslar-c', 0.0, 237_740, 0, marks=SLOW),
        pytest.param('leslar-c', 0.0003, 237_740, 71, marks=SLOW),
        pytest.param('kang-urban', 0.001, 500_000, 500, marks=SLOW),
        ('pirotti-fcd', 0.0, 72_000, 0),
        ('pirotti-fcd', 0.02, 72_000, 1440),
    ],
)
def test_other_shares(name: str, share: float, total: int, outliers: int) -> None:
    """Another share of outliers leaves the number of points as it is."""
    some = np.concatenate([cloud.points for cloud in make(name, share=share)])
    assert (len(some), sum(count(some).values())) == (total, outliers)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ({'name': 'leslar-d'}, 'the preset must be one of leslar-a, .*, got leslar-d'),
        ({'name': SMALL, 'seed': -1}, 'the seed must be at least 0, got -1'),
        ({'name': SMALL, 'share': 1.5}, 'the share must be from 0 to 1, got 1.5'),
        ({'name': SMALL, 'share': float('nan')}, 'the share must be from 0 to 1, got nan'),
        ({'name': SMALL, 'share': 0.1}, 'must be left as it is in this preset'),
        pytest.param(
            {'name': 'leslar-c', 'share': 0.5},
            r'the share must be from 0.000000 to 0.0\d+ here',
            marks=SLOW,
        ),
        ({'name': 'pirotti-fcd', 'share': 0.5}, 'the share must be from 0 to 0.1, got 0.5'),
        ({'name': 'kang-urban', 'share': 0.5}, 'the share must be from 0 to 0.1, got 0.5'),
        ({'name': 'pirotti-sfm', 'share': 0.5}, 'the share must be from 0 to 0.1, got 0.5'),
    ],
)
def test_refusals(arguments: dict[str, object], sentence: str) -> None:
    """What makes no sense is refused before anything is cast, or as soon as it is known."""
    with pytest.raises(FilterError, match=sentence):
        list(make(**arguments))  # type: ignore[arg-type]


def run(*arguments: str) -> int:
    """Run the command as the command line does."""
    parser = argparse.ArgumentParser()
    add_simulate(parser.add_subparsers())
    options = parser.parse_args(['simulate', *arguments])
    status: int = options.run(options)
    return status


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command records what a preset makes, and says what is in it."""
    assert run('pirotti-fcd', '--output', str(tmp_path / 'bag'), '--seed', '3') == 0
    printed = capsys.readouterr().out
    for word in ('72,000', '540', '0.750%', 'detour', 'single'):
        assert word in printed
    store = get_typestore(Stores.ROS2_JAZZY)
    made = list(make('pirotti-fcd', 3))
    with Recording(tmp_path / 'bag') as recording:
        read = list(recording.messages())
        assert recording.message_count == len(read) == 4
    for cloud, (topic, time, data) in zip(made, read, strict=True):
        assert (topic.name, time) == (cloud.topic, cloud.sent)
        message: Any = store.deserialize_cdr(data, topic.msgtype)
        rows = structured(message).reshape(-1)
        assert rows.tobytes() == cloud.points.tobytes()
        assert rows.dtype.names == cloud.points.dtype.names
        assert rows.dtype['label'] == np.uint8
        assert message.header.frame_id == cloud.frame


def test_command_files_are_the_same_twice(tmp_path: Path) -> None:
    """The same seed gives the same files, another seed others."""
    for name, seed in (('a', '5'), ('b', '5'), ('c', '6')):
        (tmp_path / name).mkdir()
        run(SMALL, '--output', str(tmp_path / name / 'bag'), '--seed', seed)
    a, b, c = ((tmp_path / name / 'bag' / 'bag.mcap').read_bytes() for name in 'abc')
    assert a == b
    assert a != c


def test_command_refuses_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is refused leaves no folder behind; the folder is named after the preset."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FilterError, match='the share must be'):
        run('pirotti-fcd', '--share', '0.9')
    assert list(tmp_path.iterdir()) == []
    assert run(SMALL) == 0
    assert [path.name for path in tmp_path.iterdir()] == [SMALL]
    with pytest.raises(FilterError, match='the output must be a new folder'):
        run(SMALL)
