# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The lot that gives a cloud exactly the outliers it is to have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.simulation.papers import disturbance_counts as choose
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive
from lidar_outlier_lab.simulation.world.drive import Block, Returns, merge
from lidar_outlier_lab.simulation.world.recording import POINT

GOOD, SNOW, MIXED = Cause.GOOD, Cause.SNOW, Cause.MIXED


def returns(shots: list[int], labels: list[Cause]) -> Returns:
    """Make points of shots, with x = shot."""
    points = np.zeros(len(shots), POINT)
    points['x'], points['label'] = shots, labels
    return Returns(np.array(shots, np.int64), points)


# Shots 0 to 9; 3 and 4 see the sky, 6 a silhouette. Five are disturbed, 2 and 4 most likely.
CLEAN = returns([0, 1, 2, 5, 6, 7, 8, 9], [GOOD, GOOD, GOOD, GOOD, MIXED, GOOD, GOOD, GOOD])
SPOILT = returns([2, 4, 5, 6, 9], [SNOW] * 5)
BLOCK = Block(CLEAN, SPOILT, np.array([0.1, 0.2, 0.5, 0.3, 0.9]))


def test_merge() -> None:
    """Disturbed shots take the place of what they had measured, in order."""
    shot, points = merge(CLEAN, SPOILT)
    assert shot.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert points['x'].tolist() == shot.tolist()
    assert points['label'].tolist() == [0, 0, SNOW, SNOW, SNOW, SNOW, 0, 0, SNOW]


@pytest.mark.parametrize(
    ('points', 'outliers', 'shots'),
    [
        (8, 1, []),  # the silhouette alone
        (8, 2, [2]),
        (8, 3, [2, 5]),  # 4 would be one point more, 6 is an outlier already
        (8, 4, [2, 5, 9]),
        (4, 1, [2]),
        (4, 2, [2, 5]),
    ],
)
def test_exactly(points: int, outliers: int, shots: list[int]) -> None:
    """The first points stay; by lot as many of the good ones as said become outliers."""
    shot, cloud = choose.exactly(BLOCK, points, outliers)
    assert shot.tolist() == CLEAN.shot[:points].tolist()
    assert cloud['x'].tolist() == shot.tolist()
    assert shot[cloud['label'] == SNOW].tolist() == shots
    assert np.count_nonzero(cloud['label']) == outliers


@pytest.mark.parametrize(
    ('share', 'shots'),
    [
        (1 / 8, []),
        (2 / 8, [2]),
        (3 / 9, [2, 4]),
        (0.31, [2, 4]),  # nearer than 2 of 8
        (4 / 9, [2, 4, 5, 6]),  # 6 changes no count, and 5 comes after it
        (5 / 9, [2, 4, 5, 6, 9]),
    ],
)
def test_about(share: float, shots: list[int]) -> None:
    """Shots at the sky make points that would not be; the share comes as near as it can."""
    shot, cloud = choose.about(BLOCK, share)
    assert shot[cloud['label'] == SNOW].tolist() == shots


def test_gather_stops_where_there_are_enough() -> None:
    """A drive is cast until there are points enough, the share done said; too few are refused."""
    drive = replace(demo_drive(), lines=100)
    done: list[float] = []
    some = choose.gather(drive, 15_000, done.append)
    assert done[-1] == 1.0
    assert done == sorted(done)
    assert 15_000 <= len(some.clean.shot) < 30_000
    whole = choose.gather(drive)
    np.testing.assert_array_equal(whole.clean.shot[: len(some.clean.shot)], some.clean.shot)
    np.testing.assert_array_equal(whole.clean.points[: len(some.clean.shot)], some.clean.points)
    with pytest.raises(FilterError, match='the points of the drive must be at least 90000, got'):
        choose.gather(drive, 90_000)
