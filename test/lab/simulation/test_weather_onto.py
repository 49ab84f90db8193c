# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Weather in real recordings: what it leaves alone stays, and what it adds is where a beam went."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.drives import STRING, cdr, content, first_cloud, topic_of
from numpy.lib.recfunctions import repack_fields

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import NewBag, Recording
from lidar_outlier_lab.simulation.presets import WEATHER_NAMES
from lidar_outlier_lab.simulation.weather.beams import MIN_RING_POINTS
from lidar_outlier_lab.simulation.weather.clouds import CloudWeather
from lidar_outlier_lab.simulation.weather.labelled_cloud import LabelledCloud
from lidar_outlier_lab.simulation.world.recording import to_message

TOPIC = '/velodyne_points'
PAGE = ROOT / 'doc' / 'evaluate.md'
TURN = 2 * np.pi


# The field of the times, and how well a time says the azimuth, rad: float32 and float64 times, an
# organised cloud, and missing rows in a list, with 250 times a turn.
SENSORS = {
    'vlp16_mrpt_mcap': ('time', 0.01),
    'hesai_xt32_nebula_mcap': ('stamp', 0.01),
    'os0_32.bag': ('t', 0.01),
    'cloudini_lidar_link_mcap': ('timestamp', TURN / 250),
}
BRIGHT = ('intensity', 'reflectivity')


def reading(name: str) -> FilterParameters:
    """Return how the clouds of a sensor are read."""
    return FilterParameters().changed({'time_field': SENSORS[name][0]})


def rows(msg: Any) -> Rows:
    """View the points in a row."""
    return structured(msg).reshape(-1)


def decoded(msg: Any, name: str) -> Points:
    """Read a cloud as the filter does."""
    return Decoder(reading(name)).decode(msg)


def find(some: Rows, others: Rows, fields: list[str]) -> list[int]:
    """Say which row each is, by the bytes of these fields."""
    positions = {row.tobytes(): i for i, row in enumerate(repack_fields(others[fields]))}
    return [positions[row.tobytes()] for row in repack_fields(some[fields])]


def put(msg: Any, name: str, weather: str, seed: int = 1, returns: str = 'strongest') -> Any:
    """Put weather into one cloud."""
    return CloudWeather(weather, seed, returns, reading(name)).put(msg)


@pytest.mark.parametrize('weather', WEATHER_NAMES)
def test_what_is_left_alone(real_data: Path, weather: str) -> None:
    """Good points are those of the input in their order, but darker; an outlier says its cause."""
    name = 'os0_32.bag' if weather == 'heavy_snow' else 'vlp16_mrpt_mcap'
    msg = first_cloud(real_data / 'bags' / name)
    old, new = rows(msg), rows(put(msg, name, weather))
    label, fields = new['label'], [n for n in old.dtype.names or () if n not in BRIGHT]
    there = (new['x'] != 0) | (new['y'] != 0) | (new['z'] != 0)
    good = there & (label == 0)
    assert good.mean() > 0.2
    assert (label[~there] == 0).all()
    assert len(np.unique(label[label > 0])) == 1
    where = find(new[good], old, fields)
    assert where == sorted(where)
    assert (new['intensity'][good] <= old['intensity'][where]).all()
    hidden = np.setdiff1d(np.flatnonzero(old['x'] != 0), where)
    assert len(hidden) <= np.count_nonzero(label) + np.count_nonzero(~there)


@pytest.mark.parametrize('name', SENSORS)
def test_particles_are_where_beams_went(recordings: Path, name: str) -> None:
    """Each is on its ring, at the azimuth of its time, and what says its range is true."""
    msg = first_cloud(recordings / 'bags' / name)
    made = put(msg, name, 'heavy_snow')
    points, new, old = decoded(made, name), rows(made), decoded(msg, name)
    snow = new['label'] == Cause.SNOW
    assert snow.mean() > 0.02
    assert (points.range[snow] > 0.75).all()
    assert points.t[snow].min() >= old.t[old.valid].min()
    assert points.t[snow].max() <= old.t[old.valid].max()
    azimuth = np.arctan2(points.xyz[:, 1], points.xyz[:, 0])
    up = points.xyz[:, 2] / np.maximum(points.range, 1e-9)
    for ring in np.unique(points.line[snow])[::5]:
        clean = np.flatnonzero((points.line == ring) & points.valid & ~snow)
        mine = np.flatnonzero((points.line == ring) & snow)
        assert np.abs(up[mine] - np.median(up[clean])).max() < 0.03
        order = clean[np.argsort(points.t[clean], kind='stable')]
        # Turned back as the head turns, azimuths hardly change.
        turned = [sign * TURN * (points.t[order] - old.t.max()) / 1e8 for sign in (1, -1)]
        steady = [np.unwrap(azimuth[order] - angle) for angle in turned]
        best = int(np.argmin([np.abs(np.diff(phase)).sum() for phase in steady]))
        expected = np.interp(points.t[mine], points.t[order], steady[best])
        expected += [1, -1][best] * TURN * (points.t[mine] - old.t.max()) / 1e8
        off = np.angle(np.exp(1j * (expected - azimuth[mine])))
        inside = (points.t[mine] > points.t[order[0]]) & (points.t[mine] < points.t[order[-1]])
        assert np.median(np.abs(off[inside])) < SENSORS[name][1]
    if 'range' in (new.dtype.names or ()):
        np.testing.assert_allclose(new['range'][snow], 1000 * points.range[snow], rtol=0.02)


def test_clouds_without_a_pattern_stay(recordings: Path) -> None:
    """Empty ones, those without a return, and with too few of them get labels of 0, and count."""
    msg = first_cloud(recordings / 'bags' / 'vlp16_mrpt_mcap')
    kept = rows(msg)[: 2 * MIN_RING_POINTS].copy()
    lost = kept.copy()
    for axis in 'xyz':
        lost[axis] = 0
    weather = CloudWeather('heavy_snow', 1, 'strongest', FilterParameters())
    for points in (kept[:0], lost, kept):
        few = replace(
            msg, width=len(points), row_step=points.nbytes, data=points.view(np.uint8).reshape(-1)
        )
        made = weather.put(few)
        assert made.width == len(points)
        if len(points):
            assert rows(made)['label'].tolist() == [0] * len(points)
            assert rows(made)['x'].tobytes() == points['x'].tobytes()
    assert weather.counts.untouched == weather.counts.messages == 3


@pytest.mark.parametrize(
    ('kinds', 'no_return', 'hidden'),
    [
        ('fff', (np.nan, np.nan, np.nan), (np.nan, np.nan, np.nan)),
        ('fff', (0, 0, 0), (0, 0, 0)),
        ('fff', (1, 2, 3), (np.nan, np.nan, np.nan)),  # a return in every row
        ('uff', (1, 2, 3), (0, 0, 0)),
    ],
)
def test_hidden_like_what_is_missing(
    kinds: str, no_return: tuple[float, ...], hidden: tuple[float, ...]
) -> None:
    """All axes alike; points in a plane through the sensor, at x = 0, are not missing."""
    points = np.ones(8, [(axis, f'<{kind}4') for axis, kind in zip('xyz', kinds, strict=True)])
    for row, axis in enumerate('xyz'):
        points[axis][row] = 0
    points[3] = no_return
    msg = replace(to_message(10**18, points), height=2, width=4, row_step=48)
    cloud = LabelledCloud(msg)
    cloud.hide(np.array([5, 6]))
    made = rows(cloud.message())
    np.testing.assert_array_equal([[*row][:3] for row in made[5:7].tolist()], [hidden] * 2)
    assert [[*row][:3] for row in made[:3].tolist()] == [[0, 1, 1], [1, 0, 1], [1, 1, 0]]


XYZ = [(axis, '<f4') for axis in 'xyz']


@pytest.mark.parametrize(
    ('fields', 'returns', 'words'),
    [
        ([*XYZ, ('t', '<u4'), ('ring', '<u2')], 'first', 'the lines of a cloud must be rings of a'),
        ([*XYZ, ('t', '<u4')], 'first', 'a cloud for weather must be one with a field of rings'),
        ([*XYZ, ('ring', '<u2')], 'first', 'with a field of times'),
        ([*XYZ, ('label', '|u1')], 'first', "the fields must be without 'label'"),
        (XYZ, 'second', 'the return must be one of strongest, first, last, dual, got second'),
    ],
)
def test_refused(fields: list[tuple[str, str]], returns: str, words: str) -> None:
    """Clouds in which no sensor spins, and clouds without times and directions."""
    rng, points = np.random.default_rng(1), np.zeros(4000, fields)
    for name, kind in fields:
        points[name] = np.arange(4000) if kind == '<u4' else rng.uniform(1, 9, 4000)
    parameters = FilterParameters().changed({'points_per_second': 1e6})
    with pytest.raises(FilterError, match=words):
        CloudWeather('rain', 1, returns, parameters).put(to_message(10**18, points))


def excerpt(recordings: Path, folder: Path, count: int = 2) -> Path:
    """Write the first clouds of a recording, and between them another topic."""
    other = topic_of('/note', STRING)
    with Recording(recordings / 'bags' / 'vlp16_mrpt_mcap') as source, NewBag(folder) as bag:
        for topic in source.topics:
            bag.add(topic)
        bag.add(other)
        for number, (topic, time, data) in enumerate(source.messages()):
            if number < count:
                bag.write(topic, time, data)
                bag.write(other, time, cdr(STRING, f'{number}'))
    return folder


def test_recipe(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The recipe of the documentation runs: weather into a recording, filtered, compared."""
    part = PAGE.read_text('utf-8').partition('## Put weather into your own recording')[2]
    code = re.search(r'```bash\n(.*?)```', part, re.DOTALL)
    assert code is not None
    lines = code.group(1).replace('\\\n', ' ').splitlines()
    assert len(lines) <= 5
    monkeypatch.chdir(tmp_path)
    excerpt(recordings, tmp_path / 'my_drive')
    for line in lines:
        command, *arguments = line.partition('#')[0].split()
        assert command == 'lidar-outlier-filter'
        assert main(arguments) == 0, capsys.readouterr().err
    before, after = (content(tmp_path / name) for name in ('my_drive', 'my_drive_light_snow'))
    assert before['/note'] == after['/note']
    assert [time for time, _ in before[TOPIC]] == [time for time, _ in after[TOPIC]]
    judged = read_recording(tmp_path / 'my_drive_light_snow_cleaned')
    snow = judged.code == Cause.SNOW
    assert judged.rejected[snow].mean() > 0.8
    assert judged.rejected[~snow].mean() < 0.01


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ([], 'the arguments must be a PRESET, or --onto RECORDING --weather WEATHER, got neither'),
        (['--onto', 'DRIVE'], 'the arguments must be .*, got --onto'),
        (['leslar-b', '--weather', 'rain'], 'the arguments must be .*, got PRESET and --weather'),
        (['--onto', 'DRIVE', '--weather', 'rain', '--topic', '/x'], "a topic for weather .*'/x'"),
        (
            ['--onto', 'DRIVE', '--weather', 'rain', '--set', 'line_source=message'],
            'the topic /velodyne_points must be one that weather can be put into, got "a cloud for',
        ),
    ],
)
def test_refused_in_a_sentence(
    recordings: Path, tmp_path: Path, capsys: Any, arguments: list[str], sentence: str
) -> None:
    """And nothing is written."""
    drive = str(recordings / 'bags' / 'vlp16_mrpt_db3')
    given = [drive if argument == 'DRIVE' else argument for argument in arguments]
    assert main(['simulate', *given, '--output', str(tmp_path / 'out')]) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert re.search(sentence, error)
    assert list(tmp_path.iterdir()) == []
