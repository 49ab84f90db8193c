# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Positions of two bus lines, one a second, as in Pirotti et al. 2018 ("FCD - Floating Car data").

The paper has its lines 11 and 39 in latitude, longitude and speed, and gives no counts. Here they
are in metres, z being 0, or the speed in km/h. Outliers are positions that are off the route:
thrown far by a reflection of the satellite's signal, or driven on a detour, some of them parked.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Floats, Rows
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.world.recording import START, Cloud
from lidar_outlier_lab.simulation.world.sensors import FIRST, TRUTH

POSITION = np.dtype([*FIRST, ('second', '<u4'), *TRUTH])
BLOCK = 90.0  # metres between the streets of a city in squares
STOP_EVERY, STOP_TIME = 350.0, 20.0  # metres, seconds
DRIFT_TIME = 30.0  # seconds over which the error of a position is alike
THROWN = (40.0, 400.0)  # metres that a reflection throws a position
PACE = (0.6, 1.3)  # times the usual speed between stops, and the usual time at one
GATHERING = 11  # seconds, odd
OFF = 30.0  # metres that a detour stays away from the route
STANDING = 0.4  # share of the detours that end with the bus parked
KMH = 3.6  # km/h in a metre per second


@dataclass(frozen=True)
class Line:
    """A bus line.

    Attributes
    ----------
    points, outliers : positions, and those of them that are off the route
    corners : of the route
    speed : between stops, metres per second
    noise : standard deviation of a position, metres, most of it slow
    rests : seconds that the bus stands at each end of the route
    thrown : (low, high) metres that a reflection throws a position
    off : metres that a detour is away from the route at least
    detours : (low, high) positions of one
    standing : share of the detours that end with the bus standing

    """

    points: int
    outliers: int
    corners: int
    speed: float
    noise: float
    rests: float
    thrown: tuple[float, float] = THROWN
    off: float = OFF
    detours: tuple[int, int] = (12, 40)
    standing: float = STANDING


# Line 11 is dense all along; 39 goes fast, and stands long at its ends.
LINES = {11: Line(24_000, 160, 14, 7.0, 3.0, 60.0), 39: Line(12_000, 110, 9, 13.0, 5.0, 900.0)}
# As hard as in the paper: outliers come near to the route, on 11 alone, on 39 many in one position.
HARD = {
    11: Line(24_000, 480, 30, 10.0, 4.0, 60.0, (6.0, 100.0), 6.0, (2, 4), 0.0),
    39: Line(12_000, 440, 9, 13.0, 8.0, 900.0, (8.0, 150.0), 8.0, (20, 60), 0.7),
}


def lines(
    _name: str, seed: int, share: float | None, progress: Callable[[float], object]
) -> Iterator[Cloud]:
    """Simulate both lines, each as a flat cloud and as one with the speed for its third dimension.

    Topics are /line_11/flat, /line_11/speed, /line_39/flat and /line_39/speed.
    """
    for i, (number, how) in enumerate(LINES.items()):
        outliers = how.outliers if share is None else round(share * how.points)
        if not 0 <= outliers <= how.points // 10:
            raise FilterError('the share', 'from 0 to 0.1', share)
        points = track(how, outliers, np.random.default_rng([seed, number]))
        for name in ('flat', 'speed'):
            cloud = points.copy()
            if name == 'flat':
                cloud['z'] = 0.0
            yield Cloud(START, START, cloud, f'/line_{number}/{name}')
        progress((i + 1) / len(LINES))


class _Way(NamedTuple):
    """Where a bus is each second (N, 2), metres, and how fast (N,), metres per second."""

    position: Floats
    speed: Floats


def track(how: Line, outliers: int, rng: np.random.Generator) -> Rows:
    """Drive a line to and fro, go astray now and then, and note a position each second."""
    route = _route(how.corners, rng)
    way = _drive(route, how, how.points - outliers, rng)
    thrown = outliers // 3
    near = cKDTree(way.position)
    detours = _detours(way, how, outliers - thrown, near, rng)
    count = len(way.speed)
    position = np.concatenate([way.position + _drift(count, how.noise, rng), detours.position])
    speed = np.concatenate([way.speed, detours.speed])
    speed = np.maximum(speed + 0.3 * rng.standard_normal(len(speed)), 0.0)
    position = np.concatenate([position, _throw(way, how, thrown, near, rng)])
    speed = np.concatenate([speed, rng.uniform(0.0, how.speed, thrown)])
    points = np.zeros(how.points, POSITION)
    points['x'], points['y'], points['z'] = position[:, 0], position[:, 1], KMH * speed
    points['label'][count:] = Cause.DETOUR
    points['label'][how.points - thrown :] = Cause.SINGLE
    points['surface'][:count] = Kind.ROUTE
    # Outliers come when they come.
    when = np.concatenate([np.arange(count), np.sort(rng.uniform(0, count, outliers - thrown))])
    when = np.concatenate([when, rng.uniform(0, count, thrown)])
    points = points[np.argsort(when, kind='stable')]
    points['second'] = np.arange(how.points)
    return points


def _route(corners: int, rng: np.random.Generator) -> Floats:
    """Walk through a city in squares, never back: corners (corners + 1, 2), metres."""
    positions = [np.zeros(2)]
    for i in range(corners):
        blocks = rng.integers(3, 9)
        step = (blocks, 0) if i % 2 == 0 else (0, blocks * rng.choice([-1, 1]))
        positions.append(positions[-1] + BLOCK * np.array(step))
    return np.array(positions)


def _drive(route: Floats, how: Line, seconds: int, rng: np.random.Generator) -> _Way:
    """Drive to and fro along a route, with stops, for so many seconds."""
    steps = np.linalg.norm(np.diff(route, axis=0), axis=1)
    ends = np.concatenate([[0.0], np.cumsum(steps)])
    stops = [*np.arange(STOP_EVERY, ends[-1], STOP_EVERY), ends[-1]]
    # When the bus reaches and leaves each stop, and how far along the route that is.
    times, marks, forward = [0.0], [0.0], True
    while times[-1] < seconds:
        for stop in stops:
            goal = stop if forward else ends[-1] - stop
            pace = how.speed * rng.uniform(*PACE)
            times.append(times[-1] + abs(goal - marks[-1]) / pace)
            rest = STOP_TIME * rng.uniform(*PACE) if stop < ends[-1] else how.rests
            times.append(times[-1] + rest)
            marks += [goal, goal]
        forward = not forward
    # A bus gathers speed and loses it over some seconds.
    smooth = np.hanning(GATHERING + 2)[1:-1] / np.hanning(GATHERING + 2).sum()
    t = np.arange(seconds + GATHERING - 1) - GATHERING // 2
    along = np.convolve(np.interp(t, times, marks), smooth, 'valid')
    position = np.stack([np.interp(along, ends, route[:, i]) for i in (0, 1)], axis=1)
    return _Way(position, np.abs(np.gradient(along)))


def _drift(count: int, noise: float, rng: np.random.Generator) -> Floats:
    """Errors of positions (count, 2), most of which change slowly, metres."""
    kernel = np.exp(-np.arange(6.0 * DRIFT_TIME) / DRIFT_TIME)
    kernel /= np.sqrt((kernel**2).sum())
    raw = rng.standard_normal((count + len(kernel) - 1, 2))
    slow = np.stack([np.convolve(raw[:, i], kernel, 'valid') for i in (0, 1)], axis=1)
    return noise * (0.95 * slow + 0.3 * rng.standard_normal((count, 2)))


def _throw(way: _Way, how: Line, count: int, near: cKDTree, rng: np.random.Generator) -> Floats:
    """Throw some positions (count, 2) off the route, anywhere."""
    positions: list[Floats] = []
    while len(positions) < count:
        heading, length = rng.uniform(0.0, 2.0 * np.pi), np.exp(rng.uniform(*np.log(how.thrown)))
        start = way.position[rng.integers(len(way.position))]
        position = start + length * np.array([np.cos(heading), np.sin(heading)])
        if near.query(position)[0] >= how.thrown[0]:
            positions.append(position)
    return np.reshape(positions, (-1, 2))


def _detours(way: _Way, how: Line, count: int, near: cKDTree, rng: np.random.Generator) -> _Way:
    """Leave the route along another street, now and then to stand there."""
    positions, speeds = [np.zeros((0, 2))], [np.zeros(0)]
    left = count
    while left:
        size = min(int(rng.integers(*how.detours)), left)
        start = way.position[rng.integers(len(way.speed))]
        heading = rng.choice([-1.0, 1.0], 2) * rng.permutation([1.0, 0.35])
        heading /= np.linalg.norm(heading)
        speed = np.full(size, rng.uniform(6.0, 12.0))
        if rng.random() < how.standing:
            speed[size // 2 :] = 0.0
        position = start + (how.thrown[0] + np.cumsum(speed))[:, None] * heading
        # One that stands is at the very same position each second.
        moving = speed > 0.0
        position[moving] += rng.normal(0.0, 2.0, (int(moving.sum()), 2))
        if near.query(position)[0].min() < how.off:
            continue
        positions.append(position)
        speeds.append(speed)
        left -= size
    return _Way(np.concatenate(positions), np.concatenate(speeds))
