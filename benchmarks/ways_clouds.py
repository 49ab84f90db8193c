# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that have no scan pattern as they come: moved, of a mirror that swings, of few lines."""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.simulation.papers import disturbance_counts as choose
from lidar_outlier_lab.simulation.papers.surveyed_streets import SURVEYS
from lidar_outlier_lab.simulation.papers.surveyed_streets import plan as survey_plan
from lidar_outlier_lab.simulation.scenes.spinning_streets import WEATHER
from lidar_outlier_lab.simulation.scenes.spinning_streets import plan as spinning_plan
from lidar_outlier_lab.simulation.world.drive import merge
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route
from lidar_outlier_lab.training.scenes import known_recordings, read_sweeps

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats
    from lidar_outlier_lab.simulation.world.drive import Drive, Returns
    from lidar_outlier_lab.simulation.world.trajectory import Path as Way

AWAY = (300.0, -120.0, 8.0)  # m: where the simulated streets are in their frame
TURNS = 2  # of each simulated street
MOST = 200_000  # points of a profile street
SWING = 1.75  # rad to either side of straight down
FEW = (1, 2, 3)  # lines of a stretch
FEW_POINTS = 50_000  # of a street that is cut into such stretches
# A curve, fast, far from the origin: turns of clean recordings are moved along it.
CURVE = Route(((0.0, 8.0, 0.3), (1.0, 12.0, 0.5)), start=(310.0, -120.0, 0.7), bump=0.03)


class Stretch(NamedTuple):
    """What is judged together: N points, which of them count, and which are outliers."""

    points: Points
    own: Bools
    bad: Bools


@dataclass(frozen=True, kw_only=True)
class Swinging(ProfileScanner):
    """A mirror that swings: a line to and fro, turning fastest in the middle."""

    def angle(self, shot: NDArray[np.int64]) -> Floats:
        """Scan angle of shots; half a swing is a line."""
        angle: Floats = np.pi + SWING * np.cos(np.pi / self.shots_per_line * shot)
        return angle


def moved_street(rings: int, seed: int) -> Iterator[Stretch]:
    """Simulate turns of a street, every point moved to the frame of the street; a turn at once."""
    drive = replace(spinning_plan(rings, seed), lines=TURNS)
    returns = choose.about(choose.gather(drive), WEATHER[rings].share)
    seen = _points(drive, returns, 'ring')
    # Far from the origin, about which azimuths would go on steadily.
    seen = replace(seen, xyz=moved(seen.xyz, seen.t, drive.trajectory) + AWAY)
    turn = returns.shot // drive.sensor.shots_per_line
    for k in range(TURNS):
        own = np.flatnonzero(turn == k)
        yield _whole(seen.take(own), returns.points['label'][own] > 0)


def moved_recordings(folder: Path) -> Iterator[tuple[str, Iterator[Stretch]]]:
    """Move clean recordings of spinning sensors along a curve."""
    for recording in known_recordings(folder):
        clouds = read_sweeps(recording, 2)
        start = min(int(cloud.t.min()) for cloud in clouds)
        yield (
            recording.sensor,
            (
                _whole(
                    replace(cloud, xyz=moved(cloud.xyz, cloud.t - start, CURVE)),
                    np.zeros(len(cloud), np.bool_),
                )
                for cloud in clouds
            ),
        )


def swinging(name: str, seed: int) -> Iterator[Stretch]:
    """Simulate a profile street whose scanner has a mirror that swings; blocks of the filter."""
    how = SURVEYS[name]
    drive = survey_plan(how, seed)
    sensor = drive.sensor
    mirror = Swinging(
        lines_per_second=sensor.lines_per_second,
        shots_per_line=sensor.shots_per_line,
        keeps_mixed=False,
        numbers_lines=True,
    )
    returns = _street(replace(drive, sensor=mirror), name, MOST)
    parameters = FilterParameters()
    block, halo = round(parameters.block * SECOND), round(parameters.halo * SECOND)
    yield from _cut(_points(drive, returns, 'line'), returns.points['label'] > 0, block, halo)


def few_lines(name: str, seed: int, lines: int) -> Iterator[Stretch]:
    """Simulate a profile street, and cut it into stretches of so many lines."""
    drive = survey_plan(SURVEYS[name], seed)
    returns = _street(drive, name, FEW_POINTS)
    block = lines * drive.sensor.shots_per_line * drive.sensor.interval
    yield from _cut(_points(drive, returns, 'line'), returns.points['label'] > 0, block, 0)


def moved(xyz: Floats, t: NDArray[np.int64], way: Way) -> Floats:
    """Move points from the sensor's own frame, each at its time, nanoseconds."""
    seconds = t / SECOND
    rotated = np.einsum('ijn,nj->ni', way.rotation(seconds), xyz + np.array(way.mount))
    result: Floats = rotated + way.position(seconds).T
    return result


def _street(drive: Drive, name: str, most: int) -> Returns:
    how = SURVEYS[name]
    count = min(most, how.points)
    block = choose.gather(drive, count)
    try:
        return choose.about(block, how.outliers / how.points)
    except FilterError:  # fewer shots are disturbed: all of them, then
        return merge(block.clean, block.spoilt)


def _points(drive: Drive, returns: Returns, line: str) -> Points:
    points = returns.points
    xyz = np.stack([points[axis] for axis in 'xyz'], axis=1).astype(np.float64)
    return Points(
        xyz,
        returns.shot * drive.sensor.interval,
        points[line].astype(np.int64),
        np.ones(len(points), np.bool_),
        intensity=points['intensity'].copy(),
    )


def _whole(points: Points, bad: Bools) -> Stretch:
    return Stretch(points, np.ones(len(points), np.bool_), bad)


def _cut(points: Points, bad: Bools, block: int, halo: int) -> Iterator[Stretch]:
    t = points.t
    for begin in range(0, int(t[-1]) + 1, block):
        low, high = np.searchsorted(t, (begin - halo, begin + block + halo))
        part = slice(int(low), int(high))
        own = (t[part] >= begin) & (t[part] < begin + block)
        if own.any():
            yield Stretch(points.take(part), own, bad[part])
