# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Every preset: its figures, its truth, its seed; and the command that records it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.clouds import STORE

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab.simulation.papers import aerial
from lidar_outlier_lab.simulation.papers import surveyed_streets as leslar
from lidar_outlier_lab.simulation.presets import PRESETS, make
from lidar_outlier_lab.simulation.scenes import spinning_streets as streets

if TYPE_CHECKING:
    from pathlib import Path

SMALL = 'sotoodeh-hod'
SIZES = {
    'leslar-a': (1_098_689, 11_035),
    'leslar-b': (295_147, 872),
    'leslar-c': (237_740, 31),
    'pirotti-sfm': (1_002_596, 2596),
    'pirotti-fcd': (72_000, 540),
    'sotoodeh-hod': (656, 84),
    'kang-urban': (500_000, 250),
    'kang-mountain': (1_000_000, 240),
}


@pytest.mark.slow
@pytest.mark.parametrize('name', SIZES)
def test_sizes(name: str) -> None:
    """The papers' numbers of points and outliers are met exactly."""
    some = np.concatenate([cloud.points['label'] for cloud in make(name)])
    assert (len(some), int(np.count_nonzero(some))) == SIZES[name]


@pytest.mark.slow
@pytest.mark.parametrize('rings', streets.SENSORS)
def test_shares_of_streets(rings: int) -> None:
    """A street has the stated share of outliers, and one cloud a turn with all its rings."""
    made, weather = tuple(make(f'street-{rings}')), streets.WEATHER[rings]
    label = np.concatenate([cloud.points['label'] for cloud in made])
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
    ('arguments', 'sentence'),
    [
        ({'name': 'leslar-d'}, 'the preset must be one of leslar-a, .*, got leslar-d'),
        ({'name': SMALL, 'seed': -1}, 'the seed must be at least 0, got -1'),
        ({'name': SMALL, 'share': 1.5}, 'the share must be from 0 to 1, got 1.5'),
        ({'name': SMALL, 'share': 0.1}, 'must be left as it is in this preset'),
        ({'name': 'pirotti-fcd', 'share': 0.5}, 'the share must be from 0 to 0.1, got 0.5'),
    ],
)
def test_refusals(arguments: dict[str, object], sentence: str) -> None:
    """What makes no sense is refused before anything is cast, or as soon as it is known."""
    with pytest.raises(FilterError, match=sentence):
        list(make(**arguments))  # type: ignore[arg-type]


def test_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command records what a preset makes, and says what is in it; a folder is never reused."""
    assert main(['simulate', 'pirotti-fcd', '--output', str(tmp_path / 'bag'), '--seed', '3']) == 0
    printed = capsys.readouterr().out
    for word in ('72,000', '540', '0.750%', 'detour', 'single'):
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
