# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Spinning sensors on a vehicle that turns into a side street, in bad weather: one cloud a turn.

Every cloud is in the sensor's own frame, each point in that of its own moment. Weather is chosen so
that a stated share of the points are outliers; mixed pixels, ghosts and birds are as many as the
scene makes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.scenes.random_streets import (
    LANES,
    Town,
    birds,
    car,
    lay_out,
    spray,
)
from lidar_outlier_lab.simulation.weather.beams import Optics
from lidar_outlier_lab.simulation.weather.drops import rain, snow
from lidar_outlier_lab.simulation.world.drive import Block, Disturbances, Drive, about, gather
from lidar_outlier_lab.simulation.world.particles import Fall
from lidar_outlier_lab.simulation.world.prisms import FreeScanner
from lidar_outlier_lab.simulation.world.recording import Cloud, messages
from lidar_outlier_lab.simulation.world.scene import Air, Scene, Surface
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner
from lidar_outlier_lab.simulation.world.trajectory import Route


def rings(lowest: float, highest: float, count: int) -> tuple[float, ...]:
    """Spread elevations evenly, both ends included: degrees to rad."""
    return tuple(np.radians(np.linspace(lowest, highest, count)).tolist())


# About ten turns per second each.
SENSORS = {
    16: SpinningScanner(
        elevation=rings(-15.0, 15.0, 16), columns=1800, column_time=55_296, noise=0.015
    ),
    32: SpinningScanner(elevation=rings(-30.67, 10.67, 32), columns=2000, column_time=50_016),
    64: SpinningScanner(elevation=rings(-24.8, 2.0, 64), columns=1800, column_time=55_552),
    128: SpinningScanner(
        elevation=rings(-22.5, 22.5, 128),
        columns=1024,
        column_time=97_664,
        noise=0.008,
        resolution=0.001,
    ),
}


DRY = Disturbances(reflection=0.0, near_surface=0.0, glass=0.06)


@dataclass(frozen=True)
class Weather:
    """What falls and what the road is like; ``share`` of the points are outliers of any cause."""

    turns: int
    share: float
    falls: tuple[Fall, ...] = ()
    spray: float = 0.0  # density behind each car that drives, at most; 0: none
    disturbances: Disturbances = DRY


FIRST = 0.2  # lots of what does not fall are so many times as small
WET = Disturbances(reflection=0.002, near_surface=0.0005, glass=0.06, wet=0.05)
# Of the receivers above: their cones, from a point as Kilic et al. (2021) have it, and the weakest
# echo that they see.
OPTICS = Optics(
    divergence=2.0 * SpinningScanner.divergence,
    aperture=0.0,
    nearest=SpinningScanner.nearest,
    farthest=float(np.sqrt(0.9 / SpinningScanner.weakest)),
)
RAIN = Fall(Cause.RAIN, rain(80.0), OPTICS)  # mm/h; as much of it is seen as the share says
SNOW = Fall(Cause.SNOW, snow(1.0), OPTICS)
WEATHER = {
    16: Weather(24, 0.020, (RAIN,), spray=3.0, disturbances=WET),
    32: Weather(16, 0.030, (SNOW,)),
    64: Weather(10, 0.025, (RAIN,), disturbances=WET),
    128: Weather(8, 0.025, (RAIN,), spray=2.0, disturbances=WET),
}


def street(
    name: str, seed: int, share: float | None, progress: Callable[[float], object]
) -> Iterator[Cloud]:
    """Simulate ``street-RINGS``; None: the share of outliers that the table of weather says."""
    count = int(name.removeprefix('street-'))
    drive = plan(count, seed)
    block = _weigh(gather(drive, progress=progress))
    returns = about(block, WEATHER[count].share if share is None else share)
    return messages(drive, [(drive.shots, returns)], lines_per_message=1)


def _weigh(block: Block) -> Block:
    """Choose from dense clouds first: thinned out like rain they would be none."""
    falls = np.isin(block.spoilt.points['label'], (Cause.RAIN, Cause.SNOW))
    return block._replace(lot=np.where(falls, block.lot, FIRST * block.lot))


def plan(count: int, seed: int) -> Drive:
    """Draw the street of a seed, and how the vehicle passes through it."""
    return _drive(SENSORS[count], WEATHER[count], seed)


def _drive(sensor: SpinningScanner | FreeScanner, weather: Weather, seed: int) -> Drive:
    rng = np.random.default_rng([seed, sensor.rings])
    start = rng.uniform(4.0, 9.0)
    things, air = _traffic(start, weather, rng)
    flight = (start + rng.uniform(-2.0, 14.0), rng.uniform(-3.0, 3.0))
    town = Town(
        start=-80.0,
        end=100.0,
        half_road=rng.uniform(4.6, 5.8),
        crown=rng.uniform(0.03, 0.1),
        kerb=rng.uniform(0.08, 0.15),
        crossing=(start, start + rng.uniform(10.0, 14.0)),
        things=(*things, *birds(flight, 20, rng)),
    )
    return Drive(
        Scene(lay_out(town, rng), (*weather.falls, *air)),
        lines=weather.turns,
        sensor=sensor,
        trajectory=_route(weather.turns / sensor.lines_per_second, rng),
        disturbances=weather.disturbances,
        seed=seed,
        in_own_frame=True,
    )


def _traffic(
    start: float, weather: Weather, rng: np.random.Generator
) -> tuple[list[Surface], list[Air]]:
    """Let a car drive ahead and one come the other way, whirling up what lies on the road."""
    things: list[Surface] = []
    air: list[Air] = []
    ahead, oncoming = start + rng.uniform(12.0, 18.0), start + rng.uniform(4.0, 30.0)
    for x, y, speed in ((ahead, LANES[0], 7.0), (oncoming, LANES[1], -8.0)):
        things += car(x, y, rng, (speed, 0.0, 0.0))
        if weather.spray:
            air += spray(x, y, speed, rng, weather.spray)
    return things, air


def _route(seconds: float, rng: np.random.Generator) -> Route:
    """Come to a crossing and turn left, faster and faster; bumps on the way."""
    speed = rng.uniform(4.5, 6.0)
    bend = rng.uniform(0.4, 0.7)
    knots = ((0.0, speed, 0.0), (0.3 * seconds, speed, 0.1), (seconds, 0.9 * speed, bend))
    start = (rng.uniform(-2.0, 0.0), LANES[0], 0.0)
    phase = rng.uniform(0.0, 6.0)
    return Route(knots, start, bump=0.03, phase=phase, mount=(0.0, 0.0, 1.9))


def dry_turn(sensor: SpinningScanner | FreeScanner, seed: int) -> Cloud:
    """Simulate one turn, or cloud, of a sensor in a street of a seed, in dry air.

    What mirrors, edges and birds make of it is labelled.
    """
    drive = _drive(sensor, Weather(1, 0.0), seed)
    block = gather(drive)
    return next(iter(messages(drive, [(drive.shots, block.clean)], lines_per_message=1)))
