# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streets seen by profile scanners of many kinds, to train on: no two have the same measures."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.scenes.random_streets import (
    LANES,
    Town,
    birds,
    car,
    exhaust,
    lay_out,
    spray,
)
from lidar_outlier_lab.simulation.scenes.roadside import (
    AHEAD,
    BEHIND,
    hedges,
    laths,
    mesh,
    posts,
    telephone,
    tramway,
)
from lidar_outlier_lab.simulation.scenes.sunken_ground import lay_out_sunken
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive
from lidar_outlier_lab.simulation.world.particles import Puff, SunNoise, ThinFall
from lidar_outlier_lab.simulation.world.scene import Air, Scene, Surface, barrier_arm
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

STREAM = 1701  # of random numbers, which no preset uses
SHOTS = 150_000  # about: four of five have an echo
SHORTEST, SHORTEST_DENSE = 0.6, 0.3  # seconds; of lines of more than DENSE shots
DENSE = 2000
# Lines per second, and shots per line.
SCANNERS = (
    *((100.0, 800), (100.0, 1000), (100.0, 2000), (125.0, 1600), (156.25, 1280), (156.25, 800)),
    *((200.0, 1250), (200.0, 1000), (200.0, 800), (250.0, 800)),
    *((200.0, 4000), (125.0, 4000), (250.0, 3200), (200.0, 2500)),
)
HEADS = ((200.0, 5000), (250.0, 5000))  # of mapping systems
# Shares of the streets.
TREES, MIXED, WET, FALLS, STOPS = 0.5, 0.6, 0.5, 0.4, 0.3
SUNKEN, PANES, SUN, DIRT, TRAFFIC, BIRDS = 0.2, 0.5, 0.5, 0.3, 0.5, 0.2
BY_HEADS = 0.3
FARTHEST = (1.3, 2.2)  # log10 of metres: range gates of the noise of the sun
TWICE = 0.5  # give second echoes
OWN_FRAME = 0.3  # are not moved to the street
SNOW = 0.7  # of those with a fall; else it rains
ROADSIDE = 0.35  # of streets for each thin thing


class TrainingStreet(NamedTuple):
    """A drive, and how many echoes of a shot its scanner gives."""

    drive: Drive
    echoes: int


def training_street(seed: int) -> TrainingStreet:
    """Draw a street, what is in its air, a scanner, and how it passes through; seeds from 0."""
    rng = np.random.default_rng([seed, STREAM])
    half = rng.uniform(3.6, 6.2)
    speed = rng.uniform(2.0, 20.0)
    lines, shots = SCANNERS[int(rng.integers(len(SCANNERS)))]
    own = np.random.default_rng([seed, STREAM, 1])  # other draws stay as they are
    if own.random() < BY_HEADS:
        lines, shots = HEADS[int(own.integers(len(HEADS)))]
    seconds = max(SHOTS / (lines * shots), SHORTEST_DENSE if shots > DENSE else SHORTEST)
    wet = bool(rng.random() < WET)
    arms = [_arm(half, speed, seconds, rng) for _ in range(int(rng.integers(0, 9)))]
    town = Town(
        half_road=half,
        crown=rng.uniform(0.03, 0.1),
        kerb=rng.uniform(0.07, 0.16),
        trees=bool(rng.random() < TREES),
        things=(*_roadside(half, rng), *arms),
    )
    sensor = ProfileScanner(
        lines_per_second=lines,
        shots_per_line=shots,
        keeps_mixed=bool(rng.random() < MIXED),
        numbers_lines=True,
        noise=rng.uniform(0.004, 0.012),
        yaw=np.radians(rng.uniform(30.0, 55.0)) * rng.choice([-1.0, 1.0]),
        tilt=np.radians(rng.uniform(5.0, 30.0)),
    )
    traffic = _traffic(wet, rng) if rng.random() < TRAFFIC else ((), ())
    build = lay_out_sunken if rng.random() < SUNKEN else lay_out
    air = (*_air(speed * seconds, rng), *traffic[1])
    drive = Drive(
        Scene((*build(town, rng), *traffic[0]), air),
        lines=int(seconds * lines),
        sensor=sensor,
        trajectory=_route(speed, rng),
        disturbances=_disturbances(rng, wet=wet),
        seed=seed,
    )
    echoes = 2 if rng.random() < TWICE else 1
    return TrainingStreet(replace(drive, in_own_frame=bool(rng.random() < OWN_FRAME)), echoes)


def _roadside(half: float, rng: np.random.Generator) -> Iterator[Surface]:
    """Put up wires, fences, hedges and posts, or not."""
    chosen = rng.random(5) < ROADSIDE
    left, right = half + rng.uniform(0.4, 2.2), -half - rng.uniform(0.4, 2.2)
    split = rng.uniform(0.0, 12.0)
    if chosen[0]:
        yield from telephone(half + rng.uniform(0.4, 1.2), rng)
    if chosen[1]:
        yield from tramway(half, rng)
    if chosen[2]:
        yield from mesh(BEHIND, split, right)
    if chosen[3]:
        yield from laths(split, AHEAD, left)
    if rng.random() < BIRDS:
        yield from birds((rng.uniform(-4.0, 10.0), rng.uniform(-4.0, 4.0)), 6, rng)
    if chosen[4]:
        yield from hedges(BEHIND, split - 1.0, left, rng)
        yield from hedges(split + 1.0, AHEAD, right, rng)
    own = rng.spawn(1)[0]  # numbers of its own: other draws stay as they are
    for side in (half, -half):
        if own.random() < ROADSIDE:
            yield from posts(side + np.sign(side) * own.uniform(0.3, 1.0), own)


def _traffic(
    wet: bool,  # noqa: FBT001  the weather
    rng: np.random.Generator,
) -> tuple[tuple[Surface, ...], tuple[Puff, ...]]:
    """Let cars come and go, with spray behind them on a wet road."""
    cars: list[Surface] = []
    puffs: list[Puff] = []
    for lane, sign in zip(LANES, (1.0, -1.0), strict=True):
        x, speed = rng.uniform(-12.0, 10.0), sign * rng.uniform(5.0, 15.0)
        # None in the lane of the scanner near it.
        x = rng.uniform(-16.0, -7.0) if lane == LANES[0] else x
        cars += car(x, lane, rng, (speed, 0.0, 0.0))
        puffs += spray(x, lane, speed, rng, rng.uniform(0.2, 1.0)) if wet else ()
    return tuple(cars), tuple(puffs)


def _arm(half_road: float, speed: float, seconds: float, rng: np.random.Generator) -> Surface:
    """Let a barrier open or close while one passes it, steep or level."""
    length, y = rng.uniform(1.5, half_road), half_road - rng.uniform(0.2, 0.8)
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
    found: list[Air] = [
        puff
        for _ in positions
        for puff in exhaust(
            rng.uniform(-2.0, way + 4.0),
            float(rng.choice(lanes)) + rng.uniform(-0.6, 0.6),
            rng,
            rng.uniform(0.8, 2.6),
        )
    ]
    if rng.random() < FALLS:
        found.append(fall)
    if rng.random() < SUN:
        farthest = 10 ** rng.uniform(*FARTHEST)
        found.append(SunNoise(10 ** rng.uniform(-4.3, -3.0), farthest))
    if rng.random() < DIRT:
        found.append(ThinFall(Cause.DUST, 10 ** rng.uniform(-3.2, -2.3), rng.uniform(0.3, 1.0)))
    return tuple(found)


def _disturbances(rng: np.random.Generator, *, wet: bool) -> Disturbances:
    low = rng.uniform(0.03, 0.05)
    return Disturbances(
        reflection=wet * 10 ** rng.uniform(-3.3, -2.0),
        near_surface=10 ** rng.uniform(-3.6, -2.5),
        near_surface_height=(low, low + rng.uniform(0.04, 0.14)),
        glass=(rng.random() < PANES) * 10 ** rng.uniform(-2.5, -1.0),
        wet=wet * 10 ** rng.uniform(-2.0, -0.7),
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
