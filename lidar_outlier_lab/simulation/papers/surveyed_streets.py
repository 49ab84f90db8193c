# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds like A, B and C of Leslar et al. 2010, section 4 and Table 1: a street, surveyed.

The scanner says the merged pulse of a silhouette by its form and gives no echo for it, as survey
scanners can: the outliers are those that the paper says of, and as many as its table counts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from lidar_outlier_lab.simulation.scenes.random_streets import LANES, Town, exhaust, lay_out
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive, exactly, gather
from lidar_outlier_lab.simulation.world.particles import Puff
from lidar_outlier_lab.simulation.world.recording import Cloud, messages
from lidar_outlier_lab.simulation.world.scene import Scene, Surface, barrier_arm
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

LONGEST = 60.0  # seconds that a drive may take to give its points


@dataclass(frozen=True)
class Survey:
    """One of the paper's clouds: a row of its Table 1, and how it came about."""

    points: int
    outliers: int
    lines_per_second: float
    shots_per_line: int
    disturbances: Disturbances
    speed: float  # metres per second
    stands: float = 0.0  # seconds that the vehicle stands, after its first
    has_arm: bool = False
    exhaust: float = 0.0  # density of the clouds at their centres; 0: no clouds


# Wet and just below 0 °C; wet and just above; dry and warm.
SURVEYS = {
    'leslar-a': Survey(
        1_098_689,
        11_035,
        200.0,
        1250,
        Disturbances(reflection=0.002, near_surface=0.0005),
        speed=7.0,
        stands=1.2,
        has_arm=True,
        exhaust=2.2,
    ),
    'leslar-b': Survey(
        295_147,
        872,
        156.25,
        1280,
        Disturbances(reflection=0.008, near_surface=0.0015),
        speed=8.0,
        has_arm=True,
    ),
    'leslar-c': Survey(
        237_740,
        31,
        250.0,
        800,
        Disturbances(reflection=0.0, near_surface=0.001, near_surface_height=(0.04, 0.16)),
        speed=9.0,
    ),
}


def survey(
    name: str, seed: int, share: float | None, progress: Callable[[float], object]
) -> Iterator[Cloud]:
    """Simulate one of ``SURVEYS``; ``share`` of its points are outliers, None: as in the paper."""
    how = SURVEYS[name]
    drive = plan(how, seed)
    outliers = how.outliers if share is None else round(share * how.points)
    block = gather(drive, how.points, progress)
    returns = exactly(block, how.points, outliers)
    return messages(drive, [(int(returns.shot[-1]) + 1, returns)])


def plan(how: Survey, seed: int) -> Drive:
    """Draw the street of a seed, and how the vehicle passes through it."""
    rng = np.random.default_rng([seed, how.points])
    town = Town(
        half_road=rng.uniform(4.7, 5.8),
        crown=rng.uniform(0.04, 0.1),
        kerb=rng.uniform(0.08, 0.15),
        trees=False,
    )
    speed = how.speed * rng.uniform(0.9, 1.1)
    surfaces = lay_out(town, rng)
    if how.has_arm:
        surfaces += (_arm(town, speed, rng),)
    air: tuple[Puff, ...] = ()
    if how.exhaust:
        air = tuple(
            puff
            for x in (speed * 0.9 + rng.uniform(-1.0, 0.5), speed * 1.5 + rng.uniform(3.0, 6.0))
            for puff in exhaust(x, LANES[0] + rng.uniform(-0.5, 0.5), rng, how.exhaust)
        )
    sensor = ProfileScanner(
        lines_per_second=how.lines_per_second,
        shots_per_line=how.shots_per_line,
        keeps_mixed=False,
        numbers_lines=True,
    )
    return Drive(
        Scene(surfaces, air),
        lines=int(LONGEST * how.lines_per_second),
        sensor=sensor,
        trajectory=_route(how, speed, rng),
        disturbances=how.disturbances,
        seed=seed,
    )


def _arm(town: Town, speed: float, rng: np.random.Generator) -> Surface:
    """Let a barrier across the other lane open or close while one passes it."""
    length, y = town.half_road - rng.uniform(0.2, 0.6), town.half_road - 0.3
    x = speed * rng.uniform(0.3, 0.6) - 3.0
    # The scan plane points to the left and back, 45° each: when does it come to the arm's middle?
    late = (x + 1.0 + y - length / 2.0 - LANES[0]) / speed
    rate = rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
    angle = rng.uniform(0.5, 1.0) - rate * late
    return barrier_arm((x, y, 1.0), length, angle, rate, radius=0.03)


def _route(how: Survey, speed: float, rng: np.random.Generator) -> Route:
    """Weave a little; stop once, if one is to."""
    turns = rng.uniform(-0.03, 0.03, 2)
    knots = [(0.0, speed, 0.0), (0.6, speed, turns[0]), (1.2, 0.9 * speed, -turns[0])]
    if how.stands:
        knots += [(2.4, 0.0, 0.0), (2.4 + how.stands, 0.0, 0.0)]
    later = knots[-1][0]
    knots += [(later + 1.4, speed, turns[1]), (later + 2.4, 1.1 * speed, -turns[1])]
    knots += [(later + 3.4, speed, 0.0)]
    start = (0.0, LANES[0], rng.uniform(-0.005, 0.005))
    return Route(tuple(knots), start, phase=rng.uniform(0.0, 6.0))
