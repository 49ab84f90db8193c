# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the sensor was when, by tf2; and which source of poses the parameters ask for."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rclpy.time import Duration, Time

from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.poses import Mounting, Track
from lidar_outlier_filter.errors import ParameterError, PoseError
from lidar_outlier_filter.ros.tf_links import Links
from lidar_outlier_filter.stream.motion import Odometry
from lidar_outlier_filter.stream.statistics import Kinds

if TYPE_CHECKING:
    from rclpy.node import Node

    from lidar_outlier_filter.annotations import Bools
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.stream.motion import PoseSource


STEP = SECOND // 100  # between two looks into tf: vehicles turn slowly
NOWHERE = Mounting.at((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class Tf:
    """tf2: the transform from the frame of the cloud to one that stands still.

    It is looked up every 10 ms and interpolated between, because one look takes 10 µs and a cloud
    has as many times as points. These times are multiples of 10 ms, so that a point is moved by the
    same looks in whatever message it comes. tf2 interpolates over any gap: we look for them.
    """

    def __init__(self, node: Node, parameters: FilterParameters) -> None:
        """Listen to /tf and /tf_static.

        Raises
        ------
        ParameterError
            If tf2_ros is not installed.

        """
        try:
            tf2_ros = importlib.import_module('tf2_ros')
        except ImportError as err:
            must_be = "'none' or 'odometry' where tf2_ros is not installed"
            raise ParameterError('motion.source', must_be, "'tf'") from err
        self.topic = ''
        self._fixed = parameters.motion.fixed_frame
        self.refusals = Kinds()
        self._time: Any = lambda t: Time(nanoseconds=t)
        self._jump, self._gap = parameters.time_jump, parameters.motion.max_gap
        self._buffer: Any = tf2_ros.Buffer(cache_time=Duration(seconds=60), node=node)
        self._unknown: Any = tf2_ros.TransformException
        self._links = Links(self._buffer, parameters.time_jump)
        self._links.refuse = self.refusals.note
        self._listener = tf2_ros.TransformListener(self._links, node)

    def take(self, msg: Any) -> None:
        """Do nothing: tf2 has its own subscriptions."""

    def reaches(self, last: int, frame: str) -> bool:
        """Return whether tf knows ``frame`` at the look behind ``last``, or never will."""
        look = _looks(last, last)[-1]
        return look <= 0 or bool(self._buffer.can_transform(self._fixed, frame, self._time(look)))

    def move(self, points: Points, frame: str) -> tuple[Points, Bools]:
        """Move points from ``frame`` to the one that stands still.

        A point is moved where tf knows both looks around it, and has no gap between them.
        """
        known = points.t[points.valid]
        if not len(known):
            return points, points.valid
        looks = _looks(int(known.min()), int(known.max()))
        free = points.valid.copy()
        for begin, end in self._links.gaps(
            self._fixed, frame, looks[0], looks[-1], round(self._gap * SECOND)
        ):
            around = _looks(begin, end)
            free &= (points.t <= around[0]) | (points.t >= around[-1])
        track = self._look_up(looks, frame)
        moved, covered = track.move(replace(points, valid=free), NOWHERE)
        if not covered.any():
            return points, covered
        self._links.caught_up()
        return replace(moved, valid=points.valid), covered

    def _look_up(self, looks: range, frame: str) -> Track:
        """Gather what tf knows at some looks, between which nothing is interpolated but there."""
        track = Track(STEP / SECOND, self._jump)
        wrong: set[str] = set()
        for t in looks:
            if t <= 0:  # to tf2 the latest time, or an error
                continue
            try:
                found = self._buffer.lookup_transform(self._fixed, frame, self._time(t))
                p, q = found.transform.translation, found.transform.rotation
                track.add(t, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))
            except self._unknown:
                continue
            except PoseError as err:
                wrong.add(err.what)
        for what in sorted(wrong):
            self.refusals.note(what)
        return track

    def begin_anew(self) -> None:
        """Forget the transforms of before; those that hold for ever stay."""
        self._links.begin_anew()


def _looks(first: int, last: int) -> range:
    """List when to look for points from ``first`` to ``last``: from before to behind, ns."""
    begin = first // STEP * STEP
    return range(begin, max(-(-last // STEP) * STEP, begin) + 1, STEP)


def make_motion(node: Node, parameters: FilterParameters) -> PoseSource | None:
    """Make what ``motion.source`` asks for; None for 'none'.

    Raises
    ------
    ParameterError
        If it is not to be had here.

    """
    if parameters.motion.source == 'none':
        return None
    return Odometry(parameters) if parameters.motion.source == 'odometry' else Tf(node, parameters)
