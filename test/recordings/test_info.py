# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Output of ``info``: it agrees with the sensor's maker and with a replay."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.drives import STRING, cdr, write_messages
from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.files.judged_file import describe_file
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.cloud_topic import MessageTimes
from lidar_outlier_filter.recordings.info import describe_recording, scan_geometry
from lidar_outlier_filter.recordings.replay import replay

Capture = pytest.CaptureFixture[str]


@given(st.lists(st.integers(0, 10**12), max_size=40))
def test_times_as_loops_see_them(times: list[int]) -> None:
    """Median, jumps, the longest distance, gaps; messages at one time have no rate."""
    found = MessageTimes(times)
    distances = [after - before for before, after in pairwise(times)]
    assert (found.count, found.longest) == (len(times), max([0, *distances]))
    assert found.jumps == sum(distance < 0 for distance in distances)
    if not distances:
        assert math.isnan(found.usual)
        return
    usual = max(0, sorted(distances)[(len(distances) - 1) // 2])
    assert found.usual == pytest.approx(usual * 1e-9)
    assert math.isnan(found.rate) if usual == 0 else found.rate == pytest.approx(1e9 / usual)
    # A cloud is missing where a distance is longer than twice the median of all distances.
    assert found.gaps == sum(distance > 2 * usual > 0 for distance in distances)


def rings(elevations: list[float], columns: int = 360) -> Points:
    """Make a turn of 0.1 s around a sensor in a round room of 10 m; its last column is missing."""
    up, around = np.meshgrid(np.radians(elevations), 2 * np.pi * np.arange(columns) / columns)
    xyz = 10 * np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    t = np.repeat(np.arange(columns) * 10**8 // columns, len(elevations))
    line = np.tile(np.arange(len(elevations)), columns)
    valid = np.repeat(np.arange(columns) < columns - 1, len(elevations))
    return Points(xyz.reshape(-1, 3), t, line, valid)


def test_rings_are_seen() -> None:
    """Elevation, steps and azimuth of a simulated sensor are recovered."""
    found = scan_geometry(StreamCloud(rings([-15.0, -5.0, 5.0, 15.0])))
    assert found is not None
    assert (found.lines, found.per_line, found.even) == (4, 359, True)
    angles = (found.low, found.high, found.step, found.azimuth)
    assert angles == pytest.approx((-15, 15, 10, 1))
    assert (found.near, found.far) == pytest.approx((10, 10))
    assert found.invalid == pytest.approx(1 / 360)
    assert found.seconds == pytest.approx(0.1 * 358 / 360, abs=1e-6)
    uneven = scan_geometry(StreamCloud(rings([-15.0, -5.0, -4.0, -3.0])))
    assert uneven is not None
    assert not uneven.even
    assert uneven.step == pytest.approx(1)


def test_lines_across_a_road_are_no_rings() -> None:
    """Profiles have no elevation; a cloud without a valid point has nothing."""
    xyz = np.zeros((3000, 3))
    xyz[:, 0] = np.repeat(np.arange(3) * 0.05, 1000)
    xyz[:, 1] = np.tile(np.linspace(-5, 5, 1000), 3)
    xyz[:, 2] = -2.5
    time, line = np.arange(3000), np.repeat(np.arange(3), 1000)
    found = scan_geometry(StreamCloud(Points(xyz, time, line, np.ones(3000, np.bool_))))
    assert found is not None
    assert (found.lines, found.per_line, found.is_spinning) == (3, 1000, False)
    assert scan_geometry(StreamCloud(Points(xyz, time, line, np.zeros(3000, np.bool_)))) is None


@pytest.mark.parametrize(
    ('name', 'lines', 'low', 'high', 'even'),
    [
        ('vlp16_mrpt.bag', 16, -15, 15, True),
        ('vlp16_mrpt_db3', 16, -15, 15, True),
        ('vlp32_nebula.bag', 32, -25, 15, False),
    ],
)
def test_real_sensors(  # noqa: PLR0913  a row of the table
    real_data: Path, name: str, lines: int, low: float, high: float, *, even: bool
) -> None:
    """Number and elevation of rings agree with the data sheet."""
    info = describe_recording(real_data / 'bags' / name)
    (cloud,) = info.clouds.values()
    found = cloud.geometry
    assert found is not None
    assert (found.lines, found.even) == (lines, even)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1.5)
    assert cloud.stamps.rate == pytest.approx(10, rel=0.02)
    assert any("scan lines by field 'ring'" in text for text in cloud.found)
    assert [text for text in cloud.found if 'judged' in text] == [
        'judged by trees on the scan pattern'
    ]


def test_the_defaults_reject_what_a_replay_rejects(recordings: Path, tmp_path: Path) -> None:
    """Where the sample is the recording, its counts are those of a replay."""
    path = recordings / 'bags' / 'vlp16_mrpt_mcap'
    (cloud,) = describe_recording(path, sample=60).clouds.values()
    assert (cloud.report,) == replay(path, tmp_path / 'out').topics
    (short,) = describe_recording(path, sample=0.15).clouds.values()
    assert short.report is not None
    assert short.report.messages == 2
    with Recording(path) as source:
        assert (
            sum(times.count for times in describe_recording(path, 0).topics.values())
            == source.message_count
        )


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the terminal so wide that no cell is folded."""
    monkeypatch.setenv('COLUMNS', '200')


@pytest.mark.usefixtures('wide')
def test_command_on_a_recording(real_data: Path, capsys: Capture) -> None:
    """The tables have the topic, how it is read, its lines and what the defaults do."""
    assert main(['info', str(real_data / 'bags' / 'vlp16_mrpt_mcap')]) == 0
    text = capsys.readouterr().out
    for part in (
        '/velodyne_points',
        'ring uint16',
        '16 rings',
        'even steps of 1.9°',
        '│ read   ',
        '│ judged   ',
        '× real time',
    ):
        assert part in text


@pytest.mark.usefixtures('wide')
def test_command_without_clouds(tmp_path: Path, capsys: Capture) -> None:
    """A recording of other topics is described; it has no clouds."""
    messages = [('/text', second * 10**9, cdr(STRING, 'x')) for second in (1, 2, 5)]
    write_messages(tmp_path / 'texts', {'/text': STRING}, messages)
    assert main(['info', str(tmp_path / 'texts')]) == 0
    text = capsys.readouterr().out
    assert 'No topic has clouds.' in text
    (row,) = [line for line in text.splitlines() if '/text' in line and '│' in line]
    cells = [cell.strip() for cell in row.split('│')[1:-1]]
    assert cells == ['/text', STRING, '3', '1', '1', '3 s', '0']


def test_command_on_a_file(real_data: Path, capsys: Capture) -> None:
    """A file of points has its columns and their extents."""
    path = real_data / 'clouds' / 'autzen-point-format-3.las'
    assert main(['info', str(path)]) == 0
    text = capsys.readouterr().out
    assert '106 points' in text
    assert '\npoint format: 3\n' in text
    assert '\nunit: ft (0.3048 m)\n' in text
    assert '\nCRS: ' in text
    assert 'CRS: none' not in text
    assert 'gps_time' in text
    assert 'judged by trees on the neighbours of each point' in text


def test_extent_of_a_file(tmp_path: Path) -> None:
    """Missing numbers do not count in the extent of a column."""
    path = tmp_path / 'a.csv'
    path.write_text('x,y,note\n1,nan,a\n-2.5,7,b\n')
    info = describe_file(path)
    assert (info.points, info.extent) == (2, {'x': (-2.5, 1.0), 'y': (7.0, 7.0)})


def test_a_sensor_that_turns_clockwise() -> None:
    """The step in azimuth has no sign."""
    turned = rings([-15.0, 15.0])
    xyz = turned.xyz * np.array([1.0, -1.0, 1.0])
    found = scan_geometry(StreamCloud(Points(xyz, turned.t, turned.line, turned.valid)))
    assert found is not None
    assert found.azimuth == pytest.approx(1)
