# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Every preset: its figures, its truth, its seed; and the command that records it."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clouds import STORE

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab.simulation import forms
from lidar_outlier_lab.simulation.papers import aerial
from lidar_outlier_lab.simulation.papers import surveyed_streets as leslar
from lidar_outlier_lab.simulation.presets import PRESETS, make
from lidar_outlier_lab.simulation.scenes import mapping_streets
from lidar_outlier_lab.simulation.scenes import spinning_streets as streets
from lidar_outlier_lab.simulation.world.drive import Drive

SMALL = 'sotoodeh-hod'


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
    for name, draw in mapping_streets.STREETS.items():
        monkeypatch.setitem(mapping_streets.STREETS, name, partial(_few_turns, draw))
    monkeypatch.setattr(aerial, 'GOOD', 50_000)
    monkeypatch.setattr(aerial, 'OUTLIERS', 260)
    for number, weather in streets.WEATHER.items():
        monkeypatch.setitem(streets.WEATHER, number, replace(weather, turns=2))
        sensor = streets.SENSORS[number]
        columns, column_time = sensor.columns // 8, 8 * sensor.column_time
        coarser = replace(sensor, columns=columns, column_time=column_time)
        monkeypatch.setitem(streets.SENSORS, number, coarser)


def _few_turns(draw: Callable[[int], Drive], seed: int) -> Drive:
    return replace(draw(seed), lines=20)


@pytest.mark.usefixtures('smaller')
@pytest.mark.parametrize('name', PRESETS)
def test_points_and_outliers(name: str) -> None:
    """Each has the paper's numbers, and a street its share of outliers; a seed gives its bytes."""
    made = tuple(make(name))
    for cloud, again in zip(made, make(name), strict=True):
        assert (cloud.stamp, cloud.sent, cloud.topic) == (again.stamp, again.sent, again.topic)
        assert cloud.points.tobytes() == again.points.tobytes()
    label = np.concatenate([cloud.points['label'] for cloud in made])
    if name.startswith('street-'):
        rings = int(name.removeprefix('street-'))
        weather = streets.WEATHER[rings]
        assert np.mean(label != 0) == pytest.approx(weather.share, abs=2 / len(label))
        assert len(made) == weather.turns
        for cloud in made:
            assert cloud.frame == 'lidar'
            assert np.unique(cloud.points['ring']).tolist() == list(range(rings))
            t = cloud.points['t'].astype(np.int64)
            assert (np.diff(t) > 0).all()
            assert t[-1] < cloud.sent - cloud.stamp
        # The sky, and open windows, leave shots without a point.
        shots = streets.SENSORS[rings].shots_per_line * weather.turns
        assert 0.7 < len(label) / shots < 0.99
        return
    if name.startswith('mapping-'):
        # Two messages of each head; of its shots, some have two echoes.
        assert [cloud.topic for cloud in made] == 2 * list(forms.TOPICS)
        for cloud in made:
            assert set(cloud.points['return_number']) == {1, 2}
            assert (np.diff(cloud.points['t'].astype(np.int64)) >= 0).all()
        kinds = set(np.concatenate([cloud.points['surface'] for cloud in made]).tolist())
        assert {Kind.FENCE, Kind.WIRE, Kind.CAR, Kind.FOLIAGE, Kind.ROAD} <= kinds
        return
    sizes = {
        **{one: (how.points, how.outliers) for one, how in leslar.SURVEYS.items()},
        **{one: (how.lines * how.shots, how.outliers) for one, how in aerial.FLIGHTS.items()},
        'pirotti-sfm': (aerial.GOOD + aerial.OUTLIERS, aerial.OUTLIERS),
        'pirotti-fcd': (72_000, 540),
        SMALL: (656, 84),
    }
    assert (len(label), int(np.count_nonzero(label))) == sizes[name]


def test_numbers_of_the_papers() -> None:
    """Those of table 1 of Leslar et al., of Pirotti et al., and of the flights."""
    found = {one: (how.points, how.outliers) for one, how in leslar.SURVEYS.items()}
    assert found == {
        'leslar-a': (1_098_689, 11_035),
        'leslar-b': (295_147, 872),
        'leslar-c': (237_740, 31),
    }
    assert (aerial.GOOD, aerial.OUTLIERS) == (1_000_000, 2596)
    points = [how.lines * how.shots for how in aerial.FLIGHTS.values()]
    assert points == [500_000, 1_000_000]


@pytest.mark.usefixtures('smaller')
@pytest.mark.parametrize('name', [SMALL, 'pirotti-fcd', 'leslar-c', 'street-16'])
def test_seeds_differ(name: str) -> None:
    """Another seed gives other points, by each maker of presets."""
    one, other = (next(iter(make(name, seed))) for seed in (1, 2))
    assert one.points.tobytes() != other.points.tobytes()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ({'name': 'leslar-d'}, 'the preset must be one of leslar-a, .*, got leslar-d'),
        ({'name': SMALL, 'seed': -1}, 'the seed must be at least 0, got -1'),
        ({'name': SMALL, 'share': 1.5}, 'the share must be from 0 to 1, got 1.5'),
        ({'name': SMALL, 'share': 0.1}, 'must be left as it is in this preset'),
        ({'name': SMALL, 'form': 'line'}, 'the form must be of a preset mapping-..., got line of'),
        (
            {'name': 'mapping-a', 'form': 'lines'},
            'the form must be one of line, turn, .*, got lines',
        ),
        ({'name': 'pirotti-fcd', 'share': 0.5}, 'the share must be from 0 to 0.1, got 0.5'),
    ],
)
def test_refusals(arguments: dict[str, object], sentence: str) -> None:
    """What makes no sense is refused before anything is cast, or as soon as it is known."""
    with pytest.raises(FilterError, match=sentence):
        list(make(**arguments))  # type: ignore[arg-type]


@pytest.mark.usefixtures('smaller')
def test_forms() -> None:
    """A preset of a profile scanner is sent in a driver's form, with a share of outliers."""
    made = tuple(make('mapping-b', form='packets', share=0.01))
    points = np.concatenate([cloud.points for cloud in made])
    assert points.dtype.names == ('x', 'y', 'z', 'intensity', 't', 'label', 'surface')
    assert np.mean(points['label'] != 0) == pytest.approx(0.01, abs=1e-4)
    assert {cloud.sent - cloud.stamp for cloud in made[:-1]} == {384 * 4000}


def test_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command records what a preset makes, and says what is in it; a folder is never reused."""
    assert main(['simulate', 'pirotti-fcd', '--output', str(tmp_path / 'bag'), '--seed', '3']) == 0
    printed = capsys.readouterr().out
    for word in ('72,000', '540', '0.750 %', 'detour', 'single'):
        assert word in printed
    with Recording(tmp_path / 'bag') as recording:
        read = list(recording.messages())
    for cloud, (topic, time, data) in zip(make('pirotti-fcd', 3), read, strict=True):
        assert (topic.name, time) == (cloud.topic, cloud.sent)
        message: Any = STORE.deserialize_cdr(data, topic.msgtype)
        rows = structured(message).reshape(-1)
        assert rows.tobytes() == cloud.points.tobytes()
        assert rows.dtype.names == cloud.points.dtype.names
        assert message.header.frame_id == cloud.frame
    monkeypatch.chdir(tmp_path)
    assert main(['simulate', 'pirotti-fcd', '--share', '0.9']) == 1
    assert [path.name for path in tmp_path.iterdir()] == ['bag']
    assert [main(['simulate', SMALL]) for _ in range(2)] == [0, 1]
    assert {path.name for path in tmp_path.iterdir()} == {'bag', SMALL}
    assert 'the output must be a new folder' in capsys.readouterr().err
    onto = ['simulate', '--onto', 'bag', '--weather', 'rain']
    assert main([*onto, '--form', 'rows']) == 1
    assert '--form must be given with a PRESET, got rows' in capsys.readouterr().err
