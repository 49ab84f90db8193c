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

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab.cli.simulate import add_simulate
from lidar_outlier_lab.simulation.papers import aerial
from lidar_outlier_lab.simulation.papers import surveyed_streets as leslar
from lidar_outlier_lab.simulation.presets import PRESETS, make
from lidar_outlier_lab.simulation.scenes import spinning_streets as streets

if TYPE_CHECKING:
    from pathlib import Path

    from lidar_outlier_filter.core.annotations import Rows
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
