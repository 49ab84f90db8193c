# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``train``: weather on recordings and streets become a file of trees."""

import json
from pathlib import Path

import numpy as np
import pytest

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_lab.simulation.scenes import profile_streets
from lidar_outlier_lab.simulation.weather.kinds import WEATHERS
from lidar_outlier_lab.training import scenes, train, train_profile
from lidar_outlier_lab.training.ring_tables import TABLES, known_scanners, read_elevations
from lidar_outlier_lab.training.single_sweeps import read_single_sweeps

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make few scenes and few trees."""
    monkeypatch.setattr(scenes, 'STREETS', ())
    monkeypatch.setattr(scenes, 'OF_EACH', 1)
    monkeypatch.setattr(scenes, 'WEATHERS', {'dust': WEATHERS['dust']})
    monkeypatch.setattr(scenes, 'MAX_SHARE', {'dust': scenes.MAX_SHARE['dust']})
    seed, _, *others = train.Recipe.__new__.__defaults__ or ()
    monkeypatch.setattr(train.Recipe.__new__, '__defaults__', (seed, (3, 4), *others))


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


@pytest.mark.usefixtures('few', 'few_edges')
@pytest.mark.parametrize('free', [[], ['--free']])
def test_command(recordings: Path, tmp_path: Path, capsys: Capture, free: list[str]) -> None:
    """Recordings given train; the file says which. Without rings there is one law of weather."""
    onto = [str(recordings / 'bags' / name) for name in ('vlp16_mrpt_mcap', 'os0_32.bag')]
    output = tmp_path / 'mine.json'
    assert main(['train', *free, '--onto', *onto, '--output', str(output)]) == 0
    data = json.loads(output.read_text())
    assert data['trained_on']['recordings'] == ['vlp16_mrpt_mcap', 'os0_32']
    assert {*data['held_out']['weather']} == {'dust', *([] if free else ['waveforms dust'])}
    assert {'written', 'vlp16_mrpt_mcap'} <= {*capsys.readouterr().out.split()}


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
    output = tmp_path / 'mine.json'
    assert main(['train', '--profile', '--output', str(output)]) == 0
    data = json.loads(output.read_text())
    assert data['trained_on'] == {'streets': 3, 'street_seeds': [0, 2]}
    assert data['streets'] == [f'profile street {n}' for n in range(3)]
    assert 'street left out' in capsys.readouterr().out
