# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The street of the demo: wet, just below 0 °C, as in Leslar et al. 2010, section 4; and in snow.

A profile scanner drives along it, and in the snow a sensor with 32 rings that spins.
"""

from dataclasses import replace

import numpy as np

from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.scenes.random_streets import car, spray
from lidar_outlier_lab.simulation.scenes.spinning_streets import DRY, OPTICS, rings
from lidar_outlier_lab.simulation.weather.drops import snow
from lidar_outlier_lab.simulation.world.drive import Drive
from lidar_outlier_lab.simulation.world.particles import Fall, Puff
from lidar_outlier_lab.simulation.world.scene import (
    Air,
    Scene,
    Surface,
    barrier_arm,
    box,
    building,
    ground,
    pole,
)
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner
from lidar_outlier_lab.simulation.world.trajectory import Trajectory

HALF_ROAD = 5.0  # metres from the middle of the road to its kerbs
KERB = 0.12  # height of kerbs and sidewalks, metres
KERB_WIDTH = 0.15
FRONT = 8.0  # metres from the middle of the road to the buildings
BACK = 20.0
START, END = -60.0, 100.0  # metres along the street
SNOWFALL = 0.3  # mm of water per hour
TURN = 100_000_000  # nanoseconds

# How the filter reads the drive's clouds.
SENSOR: dict[str, object] = {'line_source': 'angle', 'angle_field': 'scan_angle'}


def street() -> Scene:
    """Build a street with parked cars, poles, a swinging barrier arm and two clouds of exhaust."""
    surfaces: list[Surface] = [ground(START, END, HALF_ROAD, crown=0.08)]
    surfaces += _sidewalk(1.0) + _sidewalk(-1.0)
    surfaces += [
        _building(1.0, -45.0, -2.0, 11.0),
        _building(1.0, 2.5, 21.0, 9.5),
        _building(1.0, 27.0, 60.0, 12.5),
        _building(-1.0, -45.0, 9.0, 10.0),
        _building(-1.0, 15.5, 33.0, 13.0),
        _building(-1.0, 33.0, 60.0, 8.0),
    ]
    surfaces += [pole(x, 5.6) for x in (-8.0, 10.0, 28.0, 46.0)]
    surfaces += [pole(x, -5.6, 0.03, 2.6) for x in (3.0, 12.5, 30.0)]
    surfaces += [part for x in (4.0, 23.5, 29.0) for part in _car(x, -4.0)]
    surfaces += [part for x in (-3.0, 33.0) for part in _car(x, 4.0)]
    surfaces.append(barrier_arm((20.0, 4.7, 1.0), 4.2, angle=1.4, rate=-0.55))
    return Scene(tuple(surfaces), _exhaust(8.5, -1.9) + _exhaust(18.5, -1.2))


def _sidewalk(side: float) -> list[Surface]:
    kerb, edge, back = side * HALF_ROAD, side * (HALF_ROAD + KERB_WIDTH), side * 30.0
    return [
        box((START, kerb, -0.5), (END, edge, KERB), Kind.KERB, 0.35),
        box((START, edge, -0.5), (END, back, KERB), Kind.SIDEWALK, 0.3),
    ]


def _building(side: float, start: float, end: float, height: float) -> Surface:
    return building((start, side * FRONT, 0.0), (end, side * BACK, height), reflectance=0.45)


def _car(x: float, y: float) -> list[Surface]:
    """Build a parked car around (x, y): its body, and its cabin on top."""
    return [
        box((x - 2.1, y - 0.85, 0.2), (x + 2.1, y + 0.85, 0.85), Kind.CAR, 0.5),
        box((x - 1.3, y - 0.75, 0.85), (x + 0.9, y + 0.75, 1.4), Kind.CAR, 0.3),
    ]


def _exhaust(x: float, y: float) -> tuple[Puff, ...]:
    """Put three overlapping puffs behind an exhaust pipe, wider and thinner as they drift off."""
    return (
        Puff((x, y, 0.35), (0.30, 0.25, 0.12), 1.6),
        Puff((x - 0.5, y + 0.15, 0.50), (0.45, 0.35, 0.18), 0.9),
        Puff((x - 1.2, y + 0.25, 0.70), (0.65, 0.45, 0.24), 0.4),
    )


def demo_drive() -> Drive:
    """Drive four seconds through the street: 800 scan lines, about half a million points."""
    return Drive(street(), lines=800)


def snow_drive() -> Drive:
    """Turn three times, 0.3 s, on the same street in snow, behind a car that whirls it up."""
    rng = np.random.default_rng(1)
    things = [thing for thing in street().surfaces if thing.cause != Cause.BARRIER]
    things += car(18.0, -1.6, rng, (8.0, 0.0, 0.0))
    things += car(30.0, 1.6, rng, (-7.0, 0.0, 0.0))
    air: tuple[Air, ...] = (
        Fall(Cause.SNOW, snow(SNOWFALL), OPTICS),
        *spray(18.0, -1.6, 8.0, rng, 1.5),
    )
    return Drive(
        Scene(tuple(things), air),
        lines=3,
        sensor=SpinningScanner(elevation=rings(-25.0, 15.0, 32), columns=1024, column_time=97_664),
        trajectory=Trajectory(start=(5.0, -1.6), mount=(0.0, 0.0, 2.0)),
        disturbances=DRY,
        in_own_frame=True,
    )


def demo_sweeps(count: int, columns: int) -> Drive:
    """Turn once, 0.1 s, on the same street in dry air, with so many rings and columns."""
    column_time = TURN // (columns * count) * count  # all rings take equally long
    sensor = SpinningScanner(
        elevation=rings(-25.0, 15.0, count), columns=columns, column_time=column_time
    )
    drive = snow_drive()
    return replace(drive, scene=Scene(drive.scene.surfaces), sensor=sensor, lines=1)
