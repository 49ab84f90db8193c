# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streets that a mobile mapping system passes: what it sees besides houses, and what goes wrong.

Wires that sag, fences of laths and of mesh, and hedges are good points, however thin and alone they
are. Water and panes mirror, the sun's light is taken for echoes, dust hangs before the window.
"""

import numpy as np

from lidar_outlier_filter.core.points.points import SECOND
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
    telephone,
    tramway,
)
from lidar_outlier_lab.simulation.world.drive import Disturbances, Drive
from lidar_outlier_lab.simulation.world.particles import SunNoise, ThinFall
from lidar_outlier_lab.simulation.world.scene import (
    Air,
    Scene,
    barrier_arm,
)
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner
from lidar_outlier_lab.simulation.world.trajectory import Route

STREAM = 6207  # of random numbers; the forms use it, too
YAW = np.radians(45.0)  # of the mirror's axis: helical
STREET_SPEED, SUBURB_SPEED, AVENUE_SPEED = 9.0, 11.0, 7.0  # metres per second
DUST = ThinFall(Cause.DUST, 2e-3, 0.5)  # before the window: as good as all of it within 3 m
FENCE = 1.6  # metres that fences and hedges stand from the kerb


def street(seed: int) -> Drive:
    """Draw a plain street for 150 turns a second, with some hundreds of outliers."""
    rng = np.random.default_rng([seed, STREAM])
    town = Town(half_road=5.4, crown=0.06, kerb=0.12, trees=True)
    arm = barrier_arm((STREET_SPEED * 0.4, 5.0, 1.0), 4.6, rng.uniform(0.2, 0.5), 0.4)
    falls = ThinFall(Cause.SNOW, 1e-4, 8.0)
    turn = rng.uniform(-0.05, 0.05)
    return Drive(
        Scene((*lay_out(town, rng), arm), (falls,)),
        lines=180,
        # 149.99 turns of 1000 shots
        sensor=_head(6667, 1000, noise=0.008),
        trajectory=Route(((0.0, STREET_SPEED, 0.0), (0.8, STREET_SPEED, turn)), _start()),
        disturbances=Disturbances(reflection=0.002, near_surface=0.0005),
        seed=seed,
    )


def suburb(seed: int) -> Drive:
    """Draw a dry suburb for 250 turns a second: fences, hedges, telephone wires, sun."""
    rng = np.random.default_rng([seed, STREAM, 3])
    half = rng.uniform(3.6, 4.4)
    left, right = half + FENCE, -half - FENCE
    middle = rng.uniform(2.0, 8.0)
    things = (
        *hedges(BEHIND, middle, left, rng),
        *laths(middle + 1.0, AHEAD, left),
        *mesh(BEHIND, middle, right),
        *hedges(middle + 1.0, AHEAD, right, rng),
        *telephone(half + 0.7, rng),
        *car(rng.uniform(-6.0, 4.0), LANES[1], rng, (-rng.uniform(8.0, 13.0), 0.0, 0.0)),
        *birds((rng.uniform(0.0, 8.0), rng.uniform(-3.0, 3.0)), 8, rng),
    )
    town = Town(half_road=half, crown=0.05, kerb=rng.uniform(0.05, 0.1), things=things)
    air: tuple[Air, ...] = (SunNoise(2e-4), DUST, *exhaust(rng.uniform(0.0, 6.0), LANES[1], rng))
    return Drive(
        Scene(lay_out(town, rng), air),
        lines=220,
        sensor=_head(4000, 1000),
        trajectory=_route(SUBURB_SPEED, rng),
        disturbances=Disturbances(reflection=0.0, near_surface=0.0003),
        seed=seed,
    )


def avenue(seed: int) -> Drive:
    """Draw a wet avenue for 200 turns a second: a tramway, traffic, spray, panes that mirror."""
    rng = np.random.default_rng([seed, STREAM, 4])
    half = rng.uniform(5.2, 6.2)
    speed, x = rng.uniform(9.0, 13.0), rng.uniform(-4.0, 6.0)
    things = (
        *tramway(half, rng),
        *mesh(BEHIND, AHEAD / 2, half + FENCE),
        *car(x, LANES[1], rng, (-speed, 0.0, 0.0)),
        *car(-9.0, LANES[0], rng, (AVENUE_SPEED, 0.0, 0.0)),
    )
    town = Town(half_road=half, crown=0.08, kerb=0.12, things=things)
    air: tuple[Air, ...] = (
        SunNoise(5e-5),
        ThinFall(Cause.RAIN, 1e-3, 6.0),
        *spray(x, LANES[1], -speed, rng, 0.8),
        *spray(-9.0, LANES[0], AVENUE_SPEED, rng, 0.5),
    )
    return Drive(
        Scene(lay_out(town, rng), air),
        lines=200,
        sensor=_head(4000, 1250),
        trajectory=_route(AVENUE_SPEED, rng),
        disturbances=Disturbances(reflection=0.002, near_surface=0.0005, glass=0.04, wet=0.06),
        seed=seed,
    )


STREETS = {'mapping-a': suburb, 'mapping-b': avenue}


def _head(interval: int, shots: int, noise: float = 0.005) -> ProfileScanner:
    """Mount a head whose axis points to the front and left; nanoseconds between its shots."""
    rate = SECOND / (interval * shots)
    return ProfileScanner(lines_per_second=rate, shots_per_line=shots, yaw=YAW, noise=noise)


def _start() -> tuple[float, float, float]:
    return (0.0, LANES[0], 0.0)


def _route(speed: float, rng: np.random.Generator) -> Route:
    """Drive, a little faster or slower at the end."""
    turn, end = rng.uniform(-0.05, 0.05), rng.uniform(0.8, 1.1) * speed
    return Route(((0.0, speed, 0.0), (0.6, speed, turn), (1.2, end, -turn)), _start())
