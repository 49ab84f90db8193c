# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a page keeps of a node's clouds: the last seconds, thinned, the rejected first."""

import numpy as np
import pytest
from helpers.report_pages import positions, read_message

from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.report import live
from lidar_outlier_filter.report.live import (
    KEPT_SECONDS,
    MAX_IN_FRAME,
    MAX_LIVE_FRAMES,
    MAX_PENDING_CLOUDS,
    LiveClouds,
)


def cloud(begin: float, seconds: float, count: int, rejected: int = 0) -> StreamCloud:
    """Make a judged cloud, the last points of which are rejected."""
    rng = np.random.default_rng(count)
    t = round(begin * SECOND) + (np.arange(count) * (seconds * SECOND / max(count, 1))).astype(
        np.int64
    )
    xyz, line, valid = rng.normal(0, 10, (count, 3)), np.arange(count) % 4, np.ones(count, bool)
    points = Points(xyz=xyz, t=t, line=line, valid=valid)
    made = StreamCloud(points)
    made.verdict.score[:] = 0.1
    made.verdict.score[count - rejected :] = 2
    made.verdict.rejected[count - rejected :] = True
    return made


def test_the_own_vehicle_is_drawn() -> None:
    """Masked points are no points for detectors, and drawn all the same, as such."""
    count, own = 50, np.arange(50) < 7
    rng = np.random.default_rng(1)
    t, line = np.arange(count) * (SECOND // 500), np.zeros(count, np.int64)
    made = StreamCloud(Points(rng.normal(0, 10, (count, 3)), t, line, ~own, masked=own))
    assert len(made.points) == 43
    clouds = LiveClouds()
    clouds.add(made, None)
    header, (words,), _ = read_message(clouds.since(-1))
    assert (header['frames'][0]['points'], header['frames'][0]['rejected']) == (50, 7)
    assert np.count_nonzero((words[:, 2] >> 24) & 0xF == 15) == 7


def test_sweeps_are_frames_and_go_when_they_are_old() -> None:
    """Only what is new is sent; what is older than the last seconds is forgotten."""
    clouds = LiveClouds()
    for number in range(80):
        clouds.add(cloud(0.1 * number, 0.1, 50, 3), None)
    header, *_ = read_message(clouds.since(-1))
    numbers = [frame['number'] for frame in header['frames']]
    assert numbers == list(range(header['oldest'], 80))
    assert header['frames'][-1]['start'] - header['frames'][0]['start'] <= KEPT_SECONDS
    assert len(numbers) == 51
    assert [frame['number'] for frame in read_message(clouds.since(78))[0]['frames']] == [79]
    assert read_message(clouds.since(79))[0]['frames'] == []


def test_short_clouds_lie_in_one_frame() -> None:
    """Those of a driver that sends packets, until 90 ms are covered."""
    clouds = LiveClouds()
    for number in range(250):
        clouds.add(cloud(0.001 * number, 0.001, 10), None)
    header, *_ = read_message(clouds.since(-1))
    assert [frame['points'] for frame in header['frames']] == [900, 900]


def test_rejected_points_stay_first() -> None:
    """A large sweep is thinned, which its frame says; positions are as exact as its box."""
    clouds, large = LiveClouds(), cloud(0, 0.1, 3 * MAX_IN_FRAME, 500)
    view = np.linspace(0, 1, 3 * MAX_IN_FRAME, dtype=np.float32).view([('intensity', '<f4')])
    clouds.add(large, view)
    header, (words,), columns = read_message(clouds.since(-1))
    (frame,) = header['frames']
    assert (frame['count'], frame['points']) == (MAX_IN_FRAME, 3 * MAX_IN_FRAME)
    assert (frame['rejected'], frame['marked']) == (500, 500)
    assert words[:500, 3].astype(bool).all()
    assert not (words[500:, 3] & 3).any()
    x = positions(frame, words[:500])[:, 0]
    expected = large.points.xyz[-500:, 0]
    np.testing.assert_allclose(np.sort(x), np.sort(expected), atol=frame['step'][0])
    assert set(columns['intensity'].tolist()) <= set(view['intensity'].tolist())
    assert header['intensity'] == pytest.approx([0.02, 0.98], abs=1e-3)


def test_memory_is_bounded_where_time_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are cut at so many clouds or points, and forgotten."""
    clouds, same = LiveClouds(), cloud(1, 0, 1)
    for _ in range(MAX_PENDING_CLOUDS * (MAX_LIVE_FRAMES + 2)):
        clouds.add(same, None)
    header, *_ = read_message(clouds.since(-1))
    assert len(header['frames']) == MAX_LIVE_FRAMES
    assert header['frames'][0]['points'] == MAX_PENDING_CLOUDS
    monkeypatch.setattr(live, 'MAX_PENDING_POINTS', 1000)
    clouds, same = LiveClouds(), cloud(1, 0, 400)
    for _ in range(7):
        clouds.add(same, None)
    frames = read_message(clouds.since(-1))[0]['frames']
    assert [frame['points'] for frame in frames] == [1200, 1200]


def test_a_clock_that_goes_back_begins_anew() -> None:
    """A recording that is played again does not lie among what was."""
    clouds = LiveClouds()
    for begin in (10, 10.1, 3, 3.1):
        clouds.add(cloud(begin, 0.1, 20), None)
    header, *_ = read_message(clouds.since(-1))
    assert [frame['start'] for frame in header['frames']] == [3, 3.1]
    assert header['oldest'] == 2
    clouds.add(cloud(3.2, 0.1, 0), None)
    assert read_message(clouds.since(3))[0]['frames'] == []
