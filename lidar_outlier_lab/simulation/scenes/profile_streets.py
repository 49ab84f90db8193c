# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streets seen by profile scanners of many kinds, to train on: no two have the same measures."""

import numpy as np

from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.scenes.random_streets import LANES, Town, exhaust, lay_out
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive
from lidar_outlier_lab.simulation.world.particles import ThinFall
from lidar_outlier_lab.simulation.world.scene import Air, Scene, Surface, barrier_arm
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

STREAM = 1701  # of random numbers, which no preset uses
SHOTS = 150_000  # about: four of five have an echo
SHORTEST = 0.6  # seconds
# Lines per second, and shots per line.
SCANNERS = (
    *((100.0, 800), (100.0, 1000), (100.0, 2000), (125.0, 1600), (156.25, 1280), (156.25, 800)),
    *((200.0, 1250), (200.0, 1000), (200.0, 800), (250.0, 800)),
)
TREES, MIXED, WET, FALLS, STOPS = 0.3, 0.6, 0.5, 0.4, 0.3  # shares of the streets
SNOW = 0.7  # of those with a fall; else it rains


def training_street(seed: int) -> Drive:
    """Draw a street, what is in its air, a scanner, and how it passes through; seeds from 0."""
    rng = np.random.default_rng([seed, STREAM])
    town = Town(
        half_road=rng.uniform(4.4, 6.2),
        crown=rng.uniform(0.03, 0.1),
        kerb=rng.uniform(0.07, 0.16),
        trees=bool(rng.random() < TREES),
    )
    speed = rng.uniform(4.5, 12.0)
    lines, shots = SCANNERS[int(rng.integers(len(SCANNERS)))]
    seconds = max(SHOTS / (lines * shots), SHORTEST)
    arms = tuple(_arm(town, speed, seconds, rng) for _ in range(int(rng.integers(0, 9))))
    sensor = ProfileScanner(
        lines_per_second=lines,
        shots_per_line=shots,
        keeps_mixed=bool(rng.random() < MIXED),
        numbers_lines=True,
        noise=rng.uniform(0.004, 0.012),
        yaw=np.radians(rng.uniform(30.0, 55.0)),
        tilt=np.radians(rng.uniform(5.0, 30.0)),
    )
    return Drive(
        Scene((*lay_out(town, rng), *arms), _air(speed * seconds, rng)),
        lines=int(seconds * lines),
        sensor=sensor,
        trajectory=_route(speed, rng),
        disturbances=_disturbances(rng),
        seed=seed,
    )


def _arm(town: Town, speed: float, seconds: float, rng: np.random.Generator) -> Surface:
    """Let a barrier open or close while one passes it, steep or level."""
    length, y = rng.uniform(1.5, town.half_road), town.half_road - rng.uniform(0.2, 0.8)
    x = speed * rng.uniform(0.1, 0.9 * seconds) - 3.0
    # The scan plane points to the left and back: when does it come to the arm's middle?
    late = (x + 1.0 + y - length / 2.0 - LANES[0]) / speed
    rate = rng.uniform(0.4, 1.0) * rng.choice([-1.0, 1.0])
    angle = rng.uniform(-0.1, 1.45) - rate * late
    return barrier_arm((x, y, 1.0), length, angle, rate, radius=rng.uniform(0.025, 0.05))


def _air(way: float, rng: np.random.Generator) -> tuple[Air, ...]:
    """Put up to three clouds of exhaust along the way, metres; let it snow or rain, or not."""
    positions = range(int(rng.integers(0, 4)))
    lanes = (LANES[0], LANES[0], LANES[1])
    cause = Cause.SNOW if rng.random() < SNOW else Cause.RAIN
    fall = ThinFall(cause, 10 ** rng.uniform(-3.5, -1.8), rng.uniform(4.0, 15.0))
    exhausts = tuple(
        puff
        for _ in positions
        for puff in exhaust(
            rng.uniform(-2.0, way + 4.0),
            float(rng.choice(lanes)) + rng.uniform(-0.6, 0.6),
            rng,
            rng.uniform(0.8, 2.6),
        )
    )
    return (*exhausts, fall) if rng.random() < FALLS else exhausts


def _disturbances(rng: np.random.Generator) -> Disturbances:
    low = rng.uniform(0.03, 0.05)
    return Disturbances(
        reflection=(rng.random() < WET) * 10 ** rng.uniform(-3.3, -2.0),
        near_surface=10 ** rng.uniform(-3.6, -2.5),
        near_surface_height=(low, low + rng.uniform(0.04, 0.14)),
    )


def _route(speed: float, rng: np.random.Generator) -> Route:
    """Weave a little; stop, slow down, or go on."""
    turns = rng.uniform(-0.06, 0.06, 3)
    knots = [(0.0, speed, 0.0), (0.3, speed, turns[0])]
    if rng.random() < STOPS:
        knots += [(0.5, 0.0, 0.0), (rng.uniform(0.7, 1.2), 0.0, 0.0), (1.6, speed, turns[1])]
    else:
        knots += [(0.8, rng.uniform(0.3, 1.1) * speed, turns[1]), (1.6, speed, turns[2])]
    start = (0.0, LANES[0], rng.uniform(-0.005, 0.005))
    return Route(tuple(knots), start, phase=rng.uniform(0.0, 6.0))
