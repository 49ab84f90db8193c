# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Motion that is said by tf: which points are moved, and where to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.tf_buffer import Listener, make_tf, transform
from helpers.turned_poses import LEVEL, SECOND, START, points, turned
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.core.points.poses import KEPT
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lidar_outlier_filter.ros.tf import Tf

MOUNTED = (1.0, 0.0, 2.0, *turned(90))


def make(
    monkeypatch: pytest.MonkeyPatch, poses: Iterable[tuple[float, tuple[float, ...]]], **values: Any
) -> tuple[Tf, Listener]:
    """Make the motion of a lidar on a vehicle, with poses at seconds after the start."""
    given = {'motion.source': 'tf'} | {f'motion.{name}': value for name, value in values.items()}
    tf, listener = make_tf(monkeypatch, FilterParameters().changed(given))
    listener.buffer.set_transform_static(transform('base', 'lidar', 0, MOUNTED), '')
    drive(listener, poses)
    return tf, listener


def drive(listener: Listener, poses: Iterable[tuple[float, tuple[float, ...]]]) -> None:
    """Let tf have poses of the vehicle."""
    for seconds, pose in poses:
        msg = transform('odom', 'base', at(seconds), pose)
        listener.buffer.set_transform(msg, '')


def at(seconds: float) -> int:
    """Return nanoseconds."""
    return START + round(seconds * SECOND)


def covered(tf: Tf, *seconds: float, frame: str = 'lidar') -> list[bool]:
    """Say at which of some times points are moved; each alone is as among the others."""
    rows = [(t, 1.0, 2.0, 3.0) for t in seconds]
    moved, known = tf.move(points(*rows), frame)
    for row, xyz, is_known in zip(rows, moved.xyz, known, strict=True):
        alone, alone_known = tf.move(points(row), frame)
        assert alone_known.tolist() == [is_known]
        np.testing.assert_array_equal(alone.xyz[0], xyz)
    return [bool(one) for one in known]


def straight(begin: float, end: float, step: float) -> list[tuple[float, tuple[float, ...]]]:
    """Make poses of a vehicle that drives 10 m/s straight on."""
    times = np.arange(round(begin / step), round(end / step) + 1) * step
    return [(float(t), (10 * float(t), 0.0, 0.0, *LEVEL)) for t in times]


def test_moved_as_tf_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Point by point, as tf has it at its time; the distance stays that from the sensor."""
    rng = np.random.default_rng(3)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.02, (40, 3)), axis=0)).as_quat()
    positions = np.cumsum(rng.normal(0, 0.3, (40, 3)), axis=0)
    poses = [(i * 0.02, (*p, *q)) for i, (p, q) in enumerate(zip(positions, turns, strict=True))]
    tf, _ = make(monkeypatch, poses)
    times = np.append(rng.permutation(np.arange(0, 300) / 1000 + 0.2), [0.2, 0.499])
    given = points(*((t, *rng.normal(0, 9, 3)) for t in times))
    assert tf.reaches(at(0.499), 'lidar')
    tf._buffer.looks = 0
    moved, known = tf.move(given, 'lidar')
    assert known.all()
    assert tf._buffer.looks <= 32  # every 10 ms
    np.testing.assert_array_equal(moved.range, given.range)
    time = tf._time
    for i, t in enumerate(given.t.tolist()):
        found = tf._buffer.lookup_transform('odom', 'lidar', time(t)).transform
        q, p = found.rotation, found.translation
        turned_by = Rotation.from_quat([q.x, q.y, q.z, q.w])
        there = turned_by.apply(given.xyz[i]) + np.array([p.x, p.y, p.z])
        # Between two looks the lidar moves along a straight line, in tf along an arc.
        np.testing.assert_allclose(moved.xyz[i], there, atol=1e-3)


def test_worked_out_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A vehicle drives 10 m/s; the lidar is 1 m ahead and 2 m above on it, and looks left."""
    tf, _ = make(monkeypatch, straight(0, 1, 0.1))
    moved, _ = tf.move(points((0.1, 3, 0, 0), (0.105, 3, 0, 0), (0.35, 0, 3, 0)), 'lidar')
    expected = [(1 + 1, 3, 2), (1.05 + 1, 3, 2), (3.5 + 1 - 3, 0, 2)]
    np.testing.assert_allclose(moved.xyz, expected, atol=1e-9)


def test_points_of_one_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is one look, at the last time as at any other."""
    tf, _ = make(monkeypatch, straight(0, 1, 0.1))
    moved, _ = tf.move(points((0.3, 0, 0, 0.5), (0.3, 0, 0, 1)), 'lidar')
    np.testing.assert_allclose(moved.xyz, [(4, 0, 2.5), (4, 0, 3)], atol=1e-9)
    assert tf._buffer.looks == 1


def test_what_tf_does_not_know(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is after the last pose may still come; each point is moved by what there is."""
    tf, _ = make(monkeypatch, straight(0, 1, 0.1))
    reached = [tf.reaches(at(t), 'lidar') for t in (0.1, 0.999, 1.0, 1.001)]
    assert reached == [True, True, True, False]
    assert not tf.reaches(at(0.2), 'radar')
    assert covered(tf, -0.01, -0.001, 0.0, 0.9, 1.0) == [False, False, True, True, True]
    assert covered(tf, 0.9, 1.001, 1.01) == [True, False, False]
    assert covered(tf, 0.1, 0.2, frame='radar') == [False, False]
    nothing = points((0.5, 1, 1, 1)).take(slice(0, 0))
    assert tf.move(nothing, 'lidar')[0] is nothing


def test_times_that_tf_cannot_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """To tf 0 is the latest pose there is, and a time before it an error."""
    tf, _ = make(monkeypatch, straight(0, 1, 0.1))
    assert tf.reaches(0, 'lidar')
    assert tf.reaches(-1, 'lidar')
    for first in (-SECOND // 20, -1, 0):
        given = points((0.1, 1, 1, 1), (0.2, 1, 1, 1))
        given.t[:] = first
        assert not tf.move(given, 'lidar')[1].any()


@pytest.mark.parametrize(
    ('wrong', 'reason'),
    [
        ({'w': 1.02}, 'the norm of a quaternion'),
        ({'x': math.nan}, 'a pose'),
    ],
)
def test_poses_that_make_no_sense(
    monkeypatch: pytest.MonkeyPatch, wrong: dict[str, float], reason: str
) -> None:
    """They are counted, and the points are not moved."""
    tf, _ = make(monkeypatch, straight(0, 1, 0.1))
    look = tf._buffer.lookup_transform

    def look_wrong(*arguments: Any) -> Any:
        found = look(*arguments)
        found.transform.rotation.z = 0.0
        for name, value in wrong.items():
            setattr(found.transform.rotation, name, value)
        return found

    monkeypatch.setattr(tf._buffer, 'lookup_transform', look_wrong)
    assert not tf.move(points((0.5, 1, 1, 1)), 'lidar')[1].any()
    assert tf.refusals == {reason: 1}


def test_a_position_that_makes_no_sense(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is counted, and the points are not moved."""
    tf, _ = make(monkeypatch, [(0.0, (1e300, 0, 0, *LEVEL)), (1.0, (1e300, 0, 0, *LEVEL))])
    assert not tf.move(points((0.5, 1, 1, 1)), 'lidar')[1].any()
    assert tf.refusals == {'the position of a pose': 1}


# Gaps -------------------------------------------------------------------------------------------


def test_gaps_are_not_covered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tf interpolates over any gap; what is wider than ``motion.max_gap`` is not covered."""
    poses = [*straight(0, 1, 0.1), *straight(1.3, 2, 0.1)]
    tf, _ = make(monkeypatch, poses, max_gap=0.2)
    assert covered(tf, 0.5, 0.95, 1.0, 1.3, 1.35, 1.9) == [True] * 6
    assert covered(tf, 0.9, 1.001, 1.01, 1.15, 1.299, 1.31) == [True, *[False] * 4, True]
    assert covered(tf, 1.9, 2.0, 2.1) == [True, True, False]
    assert tf.reaches(at(1.1), 'lidar')


def test_a_look_within_a_gap_moves_no_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the gap begins and ends between two looks, or is shorter than their distance."""
    poses = [*straight(0, 1.003, 0.001), *straight(1.304, 2, 0.001)]
    tf, _ = make(monkeypatch, poses, max_gap=0.2)
    assert covered(tf, 0.999, 1.0, 1.002, 1.305, 1.31) == [True, True, False, False, True]
    poses = [*straight(0, 1.003, 0.001), *straight(1.006, 2, 0.001)]
    tf, _ = make(monkeypatch, poses, max_gap=0.002)
    assert covered(tf, 0.999, 1.0, 1.002, 1.007, 1.01) == [True, True, False, False, True]


def test_a_gap_of_exactly_the_longest(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is covered; one that is longer by a nanosecond is not."""
    tf, _ = make(monkeypatch, straight(0, 1, 0.2), max_gap=0.2)
    assert covered(tf, 0.1, 0.2, 0.9) == [True, True, True]
    tf, _ = make(monkeypatch, straight(0, 1, 0.2), max_gap=0.2 - 1e-9)
    assert covered(tf, 0.1, 0.2, 0.9) == [False, True, False]


def test_gaps_of_each_transform_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those between the two frames count, in either direction; others and fixed ones do not."""
    tf, listener = make(monkeypatch, straight(0, 1, 0.1), fixed_frame='map', max_gap=0.2)
    buffer = listener.buffer
    for seconds in (0.0, 0.3, 0.35, 0.4, 1.0):
        buffer.set_transform(transform('/odom', 'map', at(seconds), (1.0, 0, 0, *LEVEL)), '')
    for seconds in (0.0, 1.0):
        buffer.set_transform(transform('base', 'wheel', at(seconds), (1.0, 0, 0, *LEVEL)), '')
    assert covered(tf, 0.29, 0.3, 0.38, 0.4, 0.41) == [False, True, True, True, False]
    assert covered(tf, 0.32, 0.38, frame='wheel') == [False, False]
    assert covered(tf, 0.32, 0.38, frame='base') == [True, True]


def test_transforms_out_of_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """What comes late fills the gap, and what comes twice is none."""
    tf, listener = make(monkeypatch, [*straight(0, 0.4, 0.1), *straight(0.7, 1, 0.1)])
    assert covered(tf, 0.3, 0.5, 0.8) == [True, False, True]
    drive(listener, straight(0.5, 0.6, 0.1))
    drive(listener, straight(0.5, 0.6, 0.1))
    assert covered(tf, 0.3, 0.5, 0.8) == [True, True, True]


def test_old_transforms_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """After an hour no more is held than after a few minutes; the last minute is there."""
    tf, listener = make(monkeypatch, [])
    most = 0
    for number in range(40_000):
        t = START + number * SECOND // 10
        listener.buffer.note(transform('odom', 'base', t, (0.0, 0, 0, *LEVEL)))
        most = max(most, len(tf._links))
    assert most <= 2 * (KEPT // SECOND * 10 + 2)
    last = START + 39_999 * SECOND // 10
    assert not tf._links.gaps('odom', 'base', last - KEPT, last, SECOND // 10)
    assert tf._links.gaps('odom', 'base', last - KEPT, last, SECOND // 10 - 1)


def test_frames_in_a_circle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames that hang on each other are no reason to search for ever."""
    tf, listener = make(monkeypatch, [])
    for parent, child in (('a', 'b'), ('b', 'a')):
        listener.buffer.note(transform(parent, child, at(0), (0.0, 0, 0, *LEVEL)))
    assert not tf._links.gaps('odom', 'a', at(0), at(1), SECOND)


# A clock that was set back ----------------------------------------------------------------------


def test_transforms_of_before_a_clock_was_set_back_are_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the points, or by what comes on tf; what holds for ever stays."""
    tf, listener = make(monkeypatch, straight(0, 5, 0.1))
    tf.reset()
    assert not tf.reaches(at(0.6), 'lidar')
    drive(listener, straight(0, 1, 0.1))
    assert tf.reaches(at(0.6), 'lidar')
    assert covered(tf, 0.5, 0.6) == [True, True]


def test_transforms_that_go_back_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of before are forgotten then, and not those of now when the points follow."""
    tf, listener = make(monkeypatch, straight(0, 5, 0.1))
    drive(listener, straight(0, 0.3, 0.1))
    assert tf.reaches(at(0.3), 'lidar')
    assert not tf.reaches(at(0.4), 'lidar')
    tf.reset()
    assert tf.reaches(at(0.3), 'lidar')
    # The points have caught up: what is there the next time is of before.
    assert covered(tf, 0.1) == [True]
    tf.reset()
    assert not tf.reaches(at(0.3), 'lidar')


def test_a_transform_that_is_late_by_less_than_the_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is forgotten for it, nor for the transforms of another frame that lag behind."""
    tf, listener = make(monkeypatch, straight(1, 3, 0.1))
    drive(listener, straight(2, 2, 0.1))
    listener.buffer.set_transform(transform('base', 'wheel', at(1), (1.0, 0, 0, *LEVEL)), '')
    assert tf.reaches(at(3), 'lidar')
    drive(listener, straight(1.9, 1.9, 0.1))
    assert not tf.reaches(at(3), 'lidar')


def test_a_cut_elsewhere_moves_no_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points are where they are, bit for bit, in whatever messages they come."""
    rng = np.random.default_rng(5)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.05, (40, 3)), axis=0)).as_quat()
    positions = np.cumsum(rng.normal(0, 0.3, (40, 3)), axis=0)
    poses = [(i * 0.02, (*p, *q)) for i, (p, q) in enumerate(zip(positions, turns, strict=True))]
    tf, _ = make(monkeypatch, poses)
    times = np.sort(rng.uniform(0.2, 0.5, 1000))
    given = points(*((t, *rng.normal(0, 9, 3)) for t in times))
    whole, known = tf.move(given, 'lidar')
    assert known.all()
    for cut in (1, 137, 500, 999):
        for part in (slice(None, cut), slice(cut, None)):
            moved, _ = tf.move(given.take(part), 'lidar')
            np.testing.assert_array_equal(moved.xyz, whole.xyz[part])
