# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in order of time, interpolated at every point's own time."""

import math
import threading
from typing import Any

import numpy as np
import pytest
from helpers.turned_poses import LEVEL, SECOND, START, points, turned
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.poses import KEPT_NS, SensorExtrinsics, Track
from lidar_outlier_filter.errors import PoseError

NOWHERE = SensorExtrinsics.at((0, 0, 0), (0, 0, 0))


def track(*poses: tuple[float, tuple[float, ...]], max_gap: float = 1.0) -> Track:
    """Make a track of poses at seconds after the start."""
    made = Track(max_gap, time_jump=1.0)
    for seconds, pose in poses:
        made.add(START + round(seconds * SECOND), pose)
    return made


def move(made: Track, given: Points, mounting: SensorExtrinsics) -> Points:
    """Move points that are covered."""
    moved, covered = made.move(given, mounting)
    np.testing.assert_array_equal(covered, given.valid)
    return moved


def covered(made: Track, *seconds: float) -> list[bool]:
    """Say which of some times a track has poses for; each alone is as among the others."""
    rows = [(t, 1.0, 0.0, 0.0) for t in seconds]
    together: list[bool] = made.move(points(*rows), NOWHERE)[1].tolist()
    assert [made.move(points(row), NOWHERE)[1].item() for row in rows] == together
    return together


@pytest.mark.parametrize('seed', range(3))
def test_naive(seed: int) -> None:
    """Point by point, as in a book, with times and poses at random."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.01, 0.1, 30))
    rotations = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.1, (30, 3)), axis=0))
    positions = np.cumsum(rng.normal(0, 1, (30, 3)), axis=0) + np.array([5e5, 5e6, 100])
    made = track(
        *((t, (*p, *q)) for t, p, q in zip(times, positions, rotations.as_quat(), strict=True))
    )
    mounting = SensorExtrinsics.at(tuple(rng.normal(0, 1, 3)), tuple(rng.uniform(-3, 3, 3)))
    rows = np.column_stack(
        [rng.choice(rng.uniform(times[3], times[20], 20), 50), rng.normal(0, 9, (50, 3))]
    )
    given = points(*rows.tolist())
    moved = move(made, given, mounting)
    for i, (t, *xyz) in enumerate(rows.tolist()):
        after = int(np.searchsorted(times, t))
        share = (t - times[after - 1]) / (times[after] - times[after - 1])
        turn = (rotations[after - 1].inv() * rotations[after]).as_rotvec()
        rotation = rotations[after - 1] * Rotation.from_rotvec(share * turn)
        position = (1 - share) * positions[after - 1] + share * positions[after]
        on_vehicle = mounting.matrix @ xyz + mounting.position
        np.testing.assert_allclose(moved.xyz[i], rotation.apply(on_vehicle) + position, atol=1e-6)


def test_covered() -> None:
    """From the first pose to the last, both included, except between two that are far apart.

    What is before the last will not get another one.
    """
    made = track(*((seconds, (0.0,) * 3 + LEVEL) for seconds in (0.0, 0.5, 1.0, 2.1, 2.5)))
    assert covered(made, 0.0, 0.2, 0.5, 0.7, 1.0) == [True] * 5
    assert covered(made, -1e-9, 1.0 + 1e-9, 1.5, 2.1 - 1e-9, 2.5 + 1e-9) == [False] * 5
    assert covered(made, 2.1, 2.2, 2.5) == [True] * 3
    assert covered(Track(1.0, 1.0), 0.0) == [False]
    assert [made.reaches(START + t) for t in (-SECOND, 0, SECOND, 5 * SECOND // 2)] == [True] * 4
    assert not made.reaches(START + 5 * SECOND // 2 + 1)
    assert not Track(1.0, 1.0).reaches(START)


@pytest.mark.parametrize(
    ('seconds', 'pose', 'sentence'),
    [
        (1.0, (math.nan, 0, 0, *LEVEL), r'^a pose must be finite, got nan, 0, 0, 0, 0, 0, 1$'),
        (1.0, (1.0000001e9, 0, 0, *LEVEL), r'^the position of a pose must be within 1e\+09 m'),
        (1.0, (0, 0, 0, 0, 1e300, 0, 0), r'^the norm of a quaternion must be 1, got 1e\+300$'),
        (1.0, (0, 0, 0, 0, 0, 0, 0), r'^the norm of a quaternion must be 1, got 0$'),
        (1.0, (0, 0, 0, 0, 0, 0, 1.02), r'^the norm of a quaternion must be 1, got 1.02$'),
        (0.5, (0, 0, 0, *LEVEL), r'^the time of a pose must be after .*, got 0 s before$'),
        (0.4, (0, 0, 0, *LEVEL), r'^the time of a pose must be after .*, got 0.1 s before$'),
    ],
)
def test_refused(seconds: float, pose: tuple[float, ...], sentence: str) -> None:
    """What is no pose, or not later, is refused; the track is as before."""
    made = track((0.0, (0.0,) * 3 + LEVEL), (0.5, (0.0,) * 3 + LEVEL))
    with pytest.raises(PoseError, match=sentence):
        made.add(START + round(seconds * SECOND), pose)
    assert len(made) == 2


def test_old_poses_are_forgotten() -> None:
    """A drive of a day takes no more memory than one of two minutes; the last minute is there."""
    made = Track(1.0, 1.0)
    most = 0
    for i in range(20_000):
        made.add(START + i * SECOND // 10, (0.0,) * 3 + LEVEL)
        most = max(most, len(made))
    assert most <= 2 * (KEPT_NS // SECOND * 10 + 2)
    last = START + 19_999 * SECOND // 10
    assert covered(made, (last - KEPT_NS - START) / SECOND, (last - START) / SECOND) == [True, True]


def test_not_covered() -> None:
    """Nothing is extrapolated; others are moved all the same."""
    made = track((0.0, (5.0, 0.0, 0.0, *LEVEL)), (0.5, (5.0, 0.0, 0.0, *LEVEL)))
    given = points((0.2, 1, 0, 0), (0.6, 1, 0, 0))
    moved, known = made.move(given, NOWHERE)
    assert known.tolist() == [True, False]
    assert moved.xyz[:, 0].tolist() == [6, 1]
    np.testing.assert_array_equal(moved.in_own_frame.xyz, given.xyz)
    alone = given.take(np.array([1]))
    for one in (made, Track(1.0, 1.0)):
        assert one.move(alone, NOWHERE)[0] is alone


def test_the_poses_around_make_no_difference() -> None:
    """Bit for bit: at a pose itself too, with and without others before and behind it."""
    rng = np.random.default_rng(1)
    quaternions = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.1, (9, 3)), axis=0)).as_quat()
    poses = [(i / 10, (*rng.normal(0, 9, 3), *q)) for i, q in enumerate(1.002 * quaternions)]
    rows = [(t, *rng.normal(0, 9, 3)) for t in (0.2, 0.25, 0.3, 0.3, 0.47, 0.5)]
    mounting = SensorExtrinsics.at((1, 2, 3), (0.1, 0.2, 0.3))
    together = move(track(*poses), points(*rows), mounting).xyz
    for i, row in enumerate(rows):
        needed = [pose for pose in poses if abs(pose[0] - row[0]) < 0.1 - 1e-9]
        assert (move(track(*needed), points(row), mounting).xyz == together[i]).all()


# Threads, and a clock that was set back ---------------------------------------------------------


@pytest.mark.parametrize('work', ['add', 'reset', 'move', 'reaches'])
def test_threads_wait_for_each_other(work: str) -> None:
    """No thread reads or changes the poses while another one does."""
    made = track((0.0, (0.0,) * 3 + LEVEL), (0.5, (0.0,) * 3 + LEVEL))
    given: dict[str, tuple[Any, ...]] = {
        'add': (START + SECOND, (0.0,) * 3 + LEVEL),
        'move': (points((0.2, 1, 0, 0)), NOWHERE),
        'reaches': (START,),
    }
    thread = threading.Thread(target=getattr(made, work), args=given.get(work, ()))
    with made._lock:
        thread.start()
        thread.join(0.2)
        assert thread.is_alive()
    thread.join(60)
    assert not thread.is_alive()


def test_poses_of_before_a_clock_was_set_back_are_forgotten() -> None:
    """Unless their own clock was set back first, and they are newer."""
    made = track((0.0, (0.0,) * 3 + LEVEL), (5.0, (0.0,) * 3 + LEVEL))
    made.reset()
    assert len(made) == 0
    # The poses go back first, and then the clouds.
    made.add(START + 5 * SECOND, (0.0,) * 3 + LEVEL)
    made.add(START, (0.0,) * 3 + LEVEL)
    made.reset()
    assert len(made) == 1
    # Points that were moved by them are of their time: the next time the clock is set back, is not.
    move(made, points((0.0, 1, 0, 0)), NOWHERE)
    made.reset()
    assert len(made) == 0


def test_opposite_quaternions_are_one_rotation() -> None:
    """Between q and -q nothing turns; a norm that is 1 but for rounding makes nothing larger."""
    still = (0.0, 0.0, 0.0, *turned(30))
    opposite = (0.0, 0.0, 0.0, *(-value for value in turned(30)))
    longer = (0.0, 0.0, 0.0, *(1.005 * value for value in turned(30)))
    given = points((0.5, 1.0, 2.0, 3.0))
    expected = move(track((0.0, still), (1.0, still)), given, NOWHERE)
    for other in (opposite, longer):
        moved = move(track((0.0, still), (1.0, other)), given, NOWHERE)
        np.testing.assert_allclose(moved.xyz, expected.xyz, atol=1e-12)
