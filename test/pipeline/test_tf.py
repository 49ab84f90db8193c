# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Motion by tf: which points are moved, and where to."""

import math
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from helpers.turned_poses import LEVEL, SECOND, START, points, turned
from scipy.spatial.transform import Rotation, Slerp

from lidar_outlier_filter.core.points.poses import KEPT_NS, Track
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.tf import MAX_NAME, MAX_TF_FRAMES, Tf

Pose = tuple[float, ...]

MOUNTED = (1.0, 0.0, 2.0, *turned(90))


def transform(parent: str, child: str, seconds: float, pose: Pose) -> TransformStamped:
    """Make a transform; x y z in metres, then a quaternion x y z w."""
    msg = TransformStamped()
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(at(seconds), SECOND)
    msg.header.frame_id, msg.child_frame_id = parent, child
    p, q = msg.transform.translation, msg.transform.rotation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = map(float, pose)
    return msg


def message(*transforms: TransformStamped) -> Any:
    """Make what comes on /tf; its package is not on PyPI."""
    return SimpleNamespace(transforms=transforms)


def make(poses: Iterable[tuple[float, Pose]], **values: Any) -> Tf:
    """Make the motion of a lidar on a vehicle, with poses at seconds after the start."""
    given = {'motion.source': 'tf'} | {f'motion.{name}': value for name, value in values.items()}
    tf = Tf(FilterParameters().changed(given))
    tf.take_static(message(transform('base', '/lidar', 0, MOUNTED)))
    drive(tf, poses)
    return tf


def drive(tf: Tf, poses: Iterable[tuple[float, Pose]], parent: str = 'odom') -> None:
    """Publish poses of the vehicle."""
    tf.take(message(*(transform(parent, 'base', seconds, pose) for seconds, pose in poses)))


def at(seconds: float) -> int:
    """Return nanoseconds."""
    return START + round(seconds * SECOND)


def covered(tf: Tf, *seconds: float, frame: str = 'lidar') -> list[bool]:
    """Return at which times points are moved; each alone is as among the others."""
    rows = [(t, 1.0, 2.0, 3.0) for t in seconds]
    moved, known = tf.move(points(*rows), frame)
    for row, xyz, is_known in zip(rows, moved.xyz, known, strict=True):
        alone, alone_known = tf.move(points(row), frame)
        assert alone_known.tolist() == [is_known]
        np.testing.assert_array_equal(alone.xyz[0], xyz)
    return [bool(one) for one in known]


def straight(begin: float, end: float, step: float) -> list[tuple[float, Pose]]:
    """Make poses of a vehicle that drives 10 m/s straight on."""
    times = np.arange(round(begin / step), round(end / step) + 1) * step
    return [(float(t), (10 * float(t), 0.0, 0.0, *LEVEL)) for t in times]


def winding(seed: int) -> list[tuple[float, Pose]]:
    """Make poses that turn in all directions, 20 ms apart, far from the origin."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.05, (40, 3)), axis=0)).as_quat()
    positions = 1000 + np.cumsum(rng.normal(0, 0.3, (40, 3)), axis=0)
    return [(i * 0.02, (*p, *q)) for i, (p, q) in enumerate(zip(positions, turns, strict=True))]


def expected(poses: list[tuple[float, Pose]], t: float, xyz: Any, *, back: bool = False) -> Any:
    """Move a point by a pose that scipy interpolates, or by its inverse."""
    times = [one for one, _ in poses]
    turn = Slerp(times, Rotation.from_quat([pose[3:] for _, pose in poses]))(t)
    place = np.array([np.interp(t, times, [pose[k] for _, pose in poses]) for k in range(3)])
    return turn.inv().apply(xyz - place) if back else turn.apply(xyz) + place


@pytest.mark.parametrize('back', [False, True])
def test_moved_at_the_time_of_each_point(*, back: bool) -> None:
    """By the interpolated pose, also where the fixed frame hangs on the vehicle; cut anywhere."""
    poses, rng = winding(3), np.random.default_rng(4)
    tf = make([] if back else poses)
    if back:
        tf.take(message(*(transform('base', 'odom', t, pose) for t, pose in poses)))
    times = np.sort(rng.uniform(0.2, 0.5, 200))
    given = points(*((t, *rng.normal(0, 9, 3)) for t in times))
    assert tf.reaches(at(0.5), 'lidar')
    moved, known = tf.move(given, 'lidar')
    assert known.all()
    np.testing.assert_array_equal(moved.range, given.range)
    mounted = Rotation.from_quat(MOUNTED[3:]).apply(given.xyz) + MOUNTED[:3]
    for i, t in enumerate(times):
        there = expected(poses, round(t, 9), mounted[i], back=back)
        np.testing.assert_allclose(moved.xyz[i], there, atol=1e-6)
    for part in (slice(None, 137), slice(137, None)):
        np.testing.assert_array_equal(tf.move(given.take(part), 'lidar')[0].xyz, moved.xyz[part])


def test_several_transforms_on_the_way() -> None:
    """Moving and static ones, up to the common frame and down from it; gaps of each count."""
    tf = make(straight(0, 1, 0.1), fixed_frame='map', max_gap=0.2)
    tf.take_static(message(transform('hall', 'map', 0, (0, 5, 0, *turned(90)))))
    for seconds in (0.0, 0.3, 0.35, 0.4, 1.0):
        tf.take(message(transform('/odom', 'hall', seconds, (1.0, 0, 0, *LEVEL))))
    for seconds in (0.0, 1.0):
        tf.take(message(transform('base', 'wheel', seconds, (1.0, 0, 0, *LEVEL))))
    moved, _ = tf.move(points((0.35, 0, 3, 0)), 'lidar')
    np.testing.assert_allclose(moved.xyz, [(-5, -(3.5 + 1 - 3 - 1), 2)], atol=1e-9)
    assert covered(tf, 0.29, 0.3, 0.38, 0.4, 0.41) == [False, True, True, True, False]
    assert covered(tf, 0.32, 0.38, frame='wheel') == [False, False]
    assert covered(tf, 0.32, 0.38, frame='base') == [True, True]
    assert covered(tf, 5.0, frame='map') == [True]
    # A slash before the name of a frame is ROS 1's.
    assert covered(tf, 0.32, 0.38, frame='/base') == [True, True]
    assert covered(make(straight(0, 1, 0.1), fixed_frame='/odom'), 0.5, frame='/lidar') == [True]


def test_what_is_not_known() -> None:
    """What is after the last pose may still come; each point is moved by what there is."""
    tf = make(straight(0, 1, 0.1))
    reached = [tf.reaches(at(t), 'lidar') for t in (0.1, 0.999, 1.0, 1.001)]
    assert reached == [True, True, True, False]
    assert not tf.reaches(at(0.2), 'radar')
    assert covered(tf, -0.01, -0.001, 0.0, 0.9, 1.0) == [False, False, True, True, True]
    assert covered(tf, 0.9, 1.001, 1.01) == [True, False, False]
    assert covered(tf, 0.1, 0.2, frame='radar') == [False, False]
    nothing = points((0.5, 1, 1, 1)).take(slice(0, 0))
    assert tf.move(nothing, 'lidar')[0] is nothing


@pytest.mark.parametrize(
    ('pose', 'reason'),
    [
        ((0, 0, 0, 0, 0, 0, 1.02), 'the norm of a quaternion'),
        ((math.nan, 0, 0, *LEVEL), 'a pose'),
        ((1e300, 0, 0, *LEVEL), 'the position of a pose'),
    ],
)
def test_poses_that_are_refused(pose: Pose, reason: str) -> None:
    """They are counted, and move no points."""
    tf = make([(0.0, pose), (1.0, pose)])
    tf.take_static(message(transform('base', 'radar', 0, pose)))
    assert not tf.move(points((0.5, 1, 1, 1)), 'lidar')[1].any()
    assert not tf.move(points((0.5, 1, 1, 1)), 'radar')[1].any()
    assert tf.refusals == {reason: 3}


def test_late_and_repeated_transforms_are_ignored() -> None:
    """Without being counted; those of other frames lag behind as they like."""
    tf = make(straight(1, 3, 0.1))
    drive(tf, straight(3, 3, 0.1))
    drive(tf, straight(2.5, 2.5, 0.1))
    tf.take(message(transform('base', 'wheel', 1, (1.0, 0, 0, *LEVEL))))
    assert tf.reaches(at(3), 'lidar')
    assert tf.refusals == {}


def test_what_is_kept_is_bounded() -> None:
    """Of one transform the last minutes; no more frames than a tree has, nor longer names."""
    tf = make([])
    for number in range(40_000):
        drive(tf, [(number / 10, (0.0, 0, 0, *LEVEL))])
        if number % 100 == 0:
            track = tf._links['base']
            assert isinstance(track, Track)
            assert len(track) <= 2 * (KEPT_NS // SECOND * 10 + 2)
    assert covered(tf, 3999.9 - KEPT_NS / SECOND) == [True]
    for number in range(MAX_TF_FRAMES + 3):
        tf.take(message(transform('odom', f'frame {number}', 0, (0.0, 0, 0, *LEVEL))))
    tf.take_static(message(transform('o' * (MAX_NAME + 1), 'base', 0, (0.0, 0, 0, *LEVEL))))
    assert len(tf._links) == MAX_TF_FRAMES
    assert tf.refusals == {'the number of frames': 5, 'the name of a frame': 1}


def test_frames_in_a_circle() -> None:
    """Frames that hang on each other are no reason to search for ever."""
    tf = make([])
    for parent, child in (('a', 'b'), ('b', 'a')):
        tf.take(message(transform(parent, child, 0, (0.0, 0, 0, *LEVEL))))
    assert not tf.reaches(at(0), 'a')


def test_a_clock_that_was_set_back() -> None:
    """A clock set back, in points or any transform, clears moving transforms; static ones stay."""
    tf = make(straight(0, 5, 0.1))
    tf.reset()
    assert not tf.reaches(at(0.6), 'lidar')
    drive(tf, straight(0, 5, 0.1))
    assert covered(tf, 0.5, 0.6) == [True, True]
    tf.take(message(transform('base', 'wheel', 5, (1.0, 0, 0, *LEVEL))))
    drive(tf, straight(0, 0.3, 0.1))
    assert not tf.reaches(at(0.1), 'wheel')
    assert [tf.reaches(at(t), 'lidar') for t in (0.3, 0.4)] == [True, False]
    tf.reset()  # the points follow: poses are new
    assert covered(tf, 0.1) == [True]
    tf.reset()
    assert not tf.reaches(at(0.3), 'lidar')
