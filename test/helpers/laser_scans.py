# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of a 2-D scanner that drives through a room with posts; some returns stray before them."""

from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from sensor_msgs.msg import LaserEcho, LaserScan, MultiEchoLaserScan

from helpers.clouds import SECOND, STAMP
from lidar_outlier_filter.core.annotations import Bools, Floats, Singles

WALLS = 9.0, 6.0  # metres from the middle, along and across
POSTS = np.array([(4.0, 2.0, 0.1), (1.0, -2.5, 0.2), (-3.0, 3.0, 0.05), (6.0, -3.0, 0.5)])
NOISE, STRAYS = 0.01, 0.01
NO_RETURN = (np.nan, np.inf, -np.inf, 0.0, 30.0)


@dataclass(frozen=True)
class Scanner:
    """How often it scans, with how many shots, so many degrees apart; metres per second."""

    rate: int = 50
    shots: int = 541
    step: float = 0.5
    speed: float = 0.5

    @property
    def numbers(self) -> dict[str, float]:
        """What each scan says of itself, as float32."""
        step, turn = np.float32(np.radians(self.step)), (self.shots - 1) * self.step
        numbers = {
            'angle_min': np.float32(np.radians(-turn / 2)),
            'angle_max': np.float32(np.radians(turn / 2)),
            'angle_increment': step,
            'time_increment': np.float32(self.step / 360.0 / self.rate),
            'scan_time': np.float32(1.0 / self.rate),
            'range_min': np.float32(0.05),
            'range_max': np.float32(30.0),
        }
        return {name: float(number) for name, number in numbers.items()}

    def ranges(self, number: int) -> tuple[Singles, Bools]:
        """Measure walls and posts; also return which ranges stray. A few shots have no return."""
        rng, numbers = np.random.default_rng(number), self.numbers
        shot = np.arange(self.shots)
        angle = numbers['angle_min'] + shot * numbers['angle_increment']
        t = number / self.rate + shot.astype(np.float64) * numbers['time_increment']
        x = self.speed * t - 4.0
        far = _seen(x, np.stack([np.cos(angle), np.sin(angle)]))
        far += NOISE * rng.standard_normal(self.shots)
        stray = rng.random(self.shots) < STRAYS
        far[stray] *= rng.uniform(0.2, 0.8, np.count_nonzero(stray))
        for kind in NO_RETURN:
            at = rng.integers(0, self.shots, 2)
            far[at], stray[at] = kind, False
        return far.astype(np.float32), stray

    def scan(self, number: int) -> LaserScan:
        """Make a scan, with intensities."""
        ranges, _ = self.ranges(number)
        bright = np.random.default_rng(number).integers(0, 1000, self.shots)
        msg = LaserScan(ranges=_array(ranges), intensities=_array(bright))
        return self._described(msg, number)

    def several_echoes(self, number: int) -> MultiEchoLaserScan:
        """Make the same scan with these ranges as last echoes of up to three of a shot."""
        ranges, _ = self.ranges(number)
        counts = np.random.default_rng(number).integers(0, 4, self.shots)
        beams = [
            LaserEcho(echoes=_array(far - np.arange(count)[::-1]))
            for far, count in zip(ranges, counts, strict=True)
        ]
        bright = [LaserEcho(echoes=_array(np.full(count, 7.5))) for count in counts]
        return self._described(MultiEchoLaserScan(ranges=beams, intensities=bright), number)

    def _described(self, msg: Any, number: int) -> Any:
        time = STAMP + number * SECOND // self.rate
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(time, SECOND)
        # With its end 8 bytes: where ROS pads a name, the bytes may be any.
        msg.header.frame_id = 'scanner'
        for name, value in self.numbers.items():
            setattr(msg, name, value)
        return msg


def _seen(x: Floats, beam: Floats) -> Floats:
    """Return how far shots from (x, 0) see in directions (2, N)."""
    toward, across = beam
    far: Floats = np.minimum(
        (np.where(toward > 0, WALLS[0], -WALLS[0]) - x) / np.where(toward == 0, 1e-9, toward),
        WALLS[1] / np.maximum(np.abs(across), 1e-9),
    )
    for along, beside, radius in POSTS:
        middle = (along - x) * toward + beside * across
        off = (along - x) ** 2 + beside**2 - middle**2
        near = middle - np.sqrt(np.maximum(radius**2 - off, 0.0))
        far = np.where((off < radius**2) & (near > 0), np.minimum(far, near), far)
    return far


def _array(values: Any) -> 'array[float]':
    return array('f', np.asarray(values, np.float32).tobytes())
