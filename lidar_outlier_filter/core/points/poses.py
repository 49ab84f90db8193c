# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the vehicle was when: poses in order of time, interpolated at every point's own time."""

from __future__ import annotations

import math
import threading
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Triple
from lidar_outlier_filter.core.points.points import FARTHEST, SECOND, Points
from lidar_outlier_filter.errors import PoseError

KEPT_NS = 60 * SECOND  # poses that are older than the newest by more are forgotten
MAX_POSES = 200_000
NORM_TOLERANCE = 0.01  # how far the norm of a quaternion may be from 1


@dataclass(frozen=True)
class SensorExtrinsics:
    """Where the sensor is on the vehicle: metres, and a rotation from its axes to the vehicle's."""

    position: Floats
    matrix: Floats

    @classmethod
    def at(cls, position: Triple, angles: Triple) -> SensorExtrinsics:
        """Make it of x, y, z and roll, pitch, yaw (radians, about fixed axes, in turn)."""
        # Here, as it takes a third of a second to import, and few streams have poses.
        from scipy.spatial.transform import Rotation  # noqa: PLC0415

        return cls(np.array(position, np.float64), Rotation.from_euler('xyz', angles).as_matrix())

    @classmethod
    def of_pose(cls, pose: tuple[float, ...]) -> SensorExtrinsics:
        """Make it of x, y, z and a quaternion x, y, z, w; raise a PoseError if it is invalid."""
        from scipy.spatial.transform import Rotation  # noqa: PLC0415  as above

        x, y, z, *quaternion = _checked(pose)
        return cls(np.array([x, y, z]), Rotation.from_quat(quaternion).as_matrix())


class Track:
    """Poses of one body in one fixed frame, in order of time. One thread adds, another moves."""

    def __init__(self, max_gap: float, time_jump: float) -> None:
        """Interpolate over gaps of up to ``max_gap`` seconds.

        A time that goes back by more than ``time_jump`` seconds clears the poses.
        """
        self.max_gap = max_gap
        self._jump = round(time_jump * SECOND)
        self._lock = threading.Lock()
        self._times: list[int] = []
        self._poses: list[tuple[float, ...]] = []  # x y z, quaternion x y z w
        self._is_new = False  # cleared by such a time, and not used since

    def __len__(self) -> int:
        """Count the poses."""
        return len(self._times)

    def add(self, t: int, pose: tuple[float, ...]) -> bool:
        """Add the next pose: t in nanoseconds; x, y, z in metres and a quaternion x, y, z, w.

        Returns True where the poses before it were forgotten, because time was set back.

        Raises
        ------
        PoseError
            If it is no pose, or not later than the one before.

        """
        pose = _checked(pose)
        with self._lock:
            is_set_back = bool(self._times) and t < self._times[-1] - self._jump
            if is_set_back:
                self._times, self._poses = [], []
                self._is_new = True
            if self._times and t <= self._times[-1]:
                late = (self._times[-1] - t) / SECOND
                raise PoseError('the time of a pose', 'after the one before', f'{late:g} s before')
            self._times.append(t)
            self._poses.append(pose)
            old = max(bisect_left(self._times, t - KEPT_NS), len(self._times) - MAX_POSES)
            if 2 * old > len(self._times):  # not one by one
                del self._times[:old], self._poses[:old]
        return is_set_back

    def reset(self) -> None:
        """Forget the poses: the clock of the points was set back.

        Poses are kept if their own clock was set back before.
        """
        with self._lock:
            if not self._is_new:
                self._times, self._poses = [], []

    def reaches(self, last: int) -> bool:
        """Return whether all poses up to a time have arrived; they arrive in order."""
        with self._lock:
            return bool(self._times) and self._times[-1] >= last

    def move(self, points: Points, mounting: SensorExtrinsics) -> tuple[Points, Bools]:
        """Move points to the fixed frame, each from where the sensor was at its own time.

        Positions are interpolated linearly, rotations along the shortest arc. Points before the
        first pose, after the last or within a gap stay where they are; so do invalid ones.
        Whether a point is moved depends on its own time alone, in whatever message it comes.

        Returns
        -------
        points : Points
            ``own`` has the positions in the sensor's own frame.
        covered : (N,) bool
            Which of them were moved.

        """
        known = points.t[points.valid]
        if not len(known):
            return points, points.valid
        with self._lock:
            times, poses = self._between(int(known.min()), int(known.max()))
            covered = points.valid & is_covered(
                points.t, np.array(times), round(self.max_gap * SECOND)
            )
            if not covered.any():
                return points, covered
            self._is_new = False  # the points have caught up
        moved = np.empty((len(points), 3))
        _kernels.move_points(
            points.xyz,
            points.t,
            covered,
            np.array(times),
            np.array(poses),
            mounting.position,
            mounting.matrix,
            moved,
        )
        return replace(points, xyz=moved, own=points.in_own_frame.xyz), covered

    def _between(self, first: int, last: int) -> tuple[list[int], list[tuple[float, ...]]]:
        """Return the poses from the last at or before, to the first at or after; under the lock."""
        begin = max(bisect_right(self._times, first) - 1, 0)
        end = bisect_left(self._times, last) + 1
        return self._times[begin:end], self._poses[begin:end]


def _checked(pose: tuple[float, ...]) -> tuple[float, ...]:
    """Return a pose whose quaternion has the norm 1, or raise a PoseError."""
    if not np.isfinite(pose).all():
        raise PoseError('a pose', 'finite', ', '.join(f'{value:g}' for value in pose))
    if max(map(abs, pose[:3])) > FARTHEST:
        got = ', '.join(f'{value:g}' for value in pose[:3])
        raise PoseError('the position of a pose', f'within {FARTHEST:g} m', got)
    norm = math.hypot(*pose[3:])
    if abs(norm - 1) > NORM_TOLERANCE:
        raise PoseError('the norm of a quaternion', '1', f'{norm:g}')
    return (*pose[:3], *(value / norm for value in pose[3:]))


def is_covered(t: Ints, at: Ints, longest: int) -> Bools:
    """Return which times are those of a pose, or between two without a longer gap."""
    if not len(at):
        return np.zeros(len(t), np.bool_)
    before = np.searchsorted(at, t, side='right') - 1
    near, following = at[np.maximum(before, 0)], at[np.minimum(before + 1, len(at) - 1)]
    is_between = (following > t) & (following - near <= longest)
    covered: Bools = (before >= 0) & ((near == t) | is_between)
    return covered
