# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How a vehicle moves: along a street, through turns, over bumps."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import FilterError

STEP = 0.001  # seconds: grid on which speeds are summed up to positions
SLOPE_LENGTH = 1.5  # metres from the middle to an axle: turns heights of bumps into a lean


@dataclass(frozen=True)
class Trajectory:
    """Along x, with slow changes of speed, and over bumps.

    Angles and heights swing as sums of two sines each, which is smooth, and known at any time.
    """

    start: tuple[float, float] = (0.0, -1.6)
    speed: float = 8.5
    speed_change: float = 0.4
    speed_period: float = 3.0
    bump: float = 0.012  # metres
    sway: float = 0.003  # rad
    mount: tuple[float, float, float] = (-1.0, 0.0, 2.4)  # the scanner in the vehicle's frame

    def position(self, t: Floats) -> Floats:
        """Position of the vehicle on the road (3, N), metres, at t (N,) seconds."""
        rate = 2.0 * np.pi / self.speed_period
        x = self.start[0] + self.speed * t + self.speed_change / rate * (1.0 - np.cos(rate * t))
        y = self.start[1] + 0.05 * np.sin(0.9 * t)
        z = self.bump * (0.7 * np.sin(8.8 * t) + 0.3 * np.sin(19.0 * t + 1.0))
        return np.stack([x, y, z])

    def rotation(self, t: Floats) -> Floats:
        """Rotation (3, 3, N) (roll, pitch, yaw) from the vehicle's frame to the scene's."""
        roll = self.sway * (0.8 * np.sin(7.1 * t) + 0.2 * np.sin(23.0 * t))
        pitch = self.sway * (0.8 * np.sin(8.8 * t + 0.6) + 0.2 * np.sin(17.0 * t))
        yaw = self.sway * np.sin(1.9 * t)
        return rotation(roll, pitch, yaw)


@dataclass(frozen=True)
class Route:
    """A drive with stops and turns, over bumps that lie where they lie.

    Attributes
    ----------
    knots : ((t, speed, turn), ...), seconds, metres per second and rad per second (left is
        positive); speed and turn change evenly between knots, and stay as they are after the last
    start : (x, y, heading), metres and rad, at the first knot's time
    bump : metres that the road lifts and lowers the vehicle, three standard deviations or so
    tremble : rad that the engine shakes it, also when it stands
    phase : rad; shifts the bumps along the way

    """

    knots: tuple[tuple[float, float, float], ...]
    start: tuple[float, float, float] = (0.0, -1.6, 0.0)
    bump: float = 0.015
    tremble: float = 0.0002
    phase: float = 0.0
    mount: tuple[float, float, float] = (-1.0, 0.0, 2.4)

    def __post_init__(self) -> None:
        """Refuse knots that are out of order, and a vehicle that goes backwards."""
        times = [t for t, _, _ in self.knots]
        if not times or any(b <= a for a, b in pairwise(times)):
            raise FilterError('the times of the knots', 'one or more, increasing', times)
        if any(speed < 0.0 for _, speed, _ in self.knots):
            raise FilterError('the speeds of the knots', 'at least 0', self.knots)

    @cached_property
    def _way(self) -> tuple[Floats, Floats]:
        """Times (M,), and there: distance driven, heading, x, y (4, M)."""
        knots = np.array(self.knots)
        t = np.arange(knots[0, 0], knots[-1, 0] + STEP, STEP)
        speed, turn = (np.interp(t, knots[:, 0], knots[:, i]) for i in (1, 2))
        heading = self.start[2] + _sum_up(turn)
        x = self.start[0] + _sum_up(speed * np.cos(heading))
        y = self.start[1] + _sum_up(speed * np.sin(heading))
        return t, np.stack([_sum_up(speed), heading, x, y])

    def _at(self, t: Floats) -> Floats:
        """Distance driven, heading, x, y (4, N) at t (N,) seconds."""
        times, way = self._way
        inside = np.stack([np.interp(t, times, values) for values in way])
        _, speed, turn = self.knots[-1]
        over = np.maximum(t - times[-1], 0.0)
        late = over > 0.0
        if late.any():
            heading = inside[1] + turn * over
            # An arc: its chord points half the turn away from the heading at its start.
            chord = speed * over * np.sinc(turn * over / (2.0 * np.pi))
            inside[2] += chord * np.cos(inside[1] + turn * over / 2.0)
            inside[3] += chord * np.sin(inside[1] + turn * over / 2.0)
            inside[0], inside[1] = inside[0] + speed * over, heading
        return inside

    def position(self, t: Floats) -> Floats:
        """Position of the vehicle on the road (3, N), metres, at t (N,) seconds."""
        way, _, x, y = self._at(t)
        return np.stack([x, y, self._height(way)])

    def rotation(self, t: Floats) -> Floats:
        """Rotation (3, 3, N) from the vehicle's frame to the scene's."""
        way, heading, _, _ = self._at(t)
        front, back = self._height(way + SLOPE_LENGTH), self._height(way - SLOPE_LENGTH)
        pitch = -(front - back) / (2.0 * SLOPE_LENGTH) + self.tremble * np.sin(61.0 * t)
        roll = 0.2 * self.bump * np.sin(1.3 * way + 2.0 * self.phase)
        return rotation(roll + self.tremble * np.sin(83.0 * t + 0.4), pitch, heading)

    def _height(self, way: Floats) -> Floats:
        """Height of the vehicle after a way of so many metres, metres."""
        long, short = np.sin(0.9 * way + self.phase), np.sin(2.3 * way + 3.0 * self.phase)
        return self.bump * (0.7 * long + 0.3 * short)


def _sum_up(rate: Floats) -> Floats:
    """Integrate what is given every ``STEP`` seconds, from 0, by trapezia."""
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) * (STEP / 2.0))])


def rotation(roll: Floats, pitch: Floats, yaw: Floats) -> Floats:
    """Rotation (3, 3, N): first about x, then y (nose down is positive), then z."""
    cr, cp, cy = np.cos([roll, pitch, yaw])
    sr, sp, sy = np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
