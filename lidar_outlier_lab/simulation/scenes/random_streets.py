# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streets drawn by lot: houses, kerbs, parked cars, poles, manholes, trees, and who is about."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.world.particles import Puff
from lidar_outlier_lab.simulation.world.scene import (
    Surface,
    ball,
    box,
    building,
    crown,
    ground,
    lid,
    pole,
    tube,
)

KERB_WIDTH = 0.15
DEEP = 60.0  # metres from the road to where a block of houses ends
CAR = (2.1, 0.85)  # half the length and half the width of a car
# Shares of kerbs that are lowered, houses with a shop, gaps between houses, positions with a car.
ENTRANCES, SHOPS, GAPS, PARKED = 0.2, 0.4, 0.4, 0.5
LOWERED = 0.03  # height of a lowered kerb, metres
WIDE = 8.0  # metres that a house with a shop has at least
FURNITURE = {'lamp': 0.3, 'sign': 0.25, 'tree': 0.3, 'hedge': 0.15}
LANES = (-1.6, 1.7)  # where one drives: along x, and against it


@dataclass(frozen=True)
class Town:
    """The measures of a street along x, from ``start`` to ``end``, and what stands in it.

    Between ``crossing`` a street along y crosses it; None: none does.
    """

    start: float = -70.0
    end: float = 110.0
    half_road: float = 5.0  # metres from the middle of the road to its kerbs
    crown: float = 0.07
    kerb: float = 0.12
    crossing: tuple[float, float] | None = None
    trees: bool = True
    things: tuple[Surface, ...] = field(default=())


def lay_out(town: Town, rng: np.random.Generator) -> tuple[Surface, ...]:
    """Build the street: road, four blocks or two, and what stands on and beside the road."""
    surfaces: list[Surface] = [
        ground(town.start, town.end, town.half_road, town.crown),
        ground(town.start, town.end, 2.0 * DEEP),
    ]
    for side in (1.0, -1.0):
        for start, end in _stretches(town):
            surfaces += _block(town, side, start, end, rng)
            surfaces += _parked(town, side, start, end, rng)
            surfaces += _furniture(town, side, start, end, rng)
    surfaces += _manholes(town, rng)
    surfaces += _wires(town, rng)
    return (*surfaces, *town.things)


def _stretches(town: Town) -> list[tuple[float, float]]:
    """Parts of the street between crossings."""
    if town.crossing is None:
        return [(town.start, town.end)]
    return [(town.start, town.crossing[0]), (town.crossing[1], town.end)]


def _block(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Raise a pavement with kerbs along both streets, and put houses on it."""
    near, far = side * town.half_road, side * (town.half_road + DEEP)
    rim = side * (town.half_road + KERB_WIDTH)
    x = start
    while x < end:
        stop = min(x + rng.uniform(8.0, 30.0), end)
        # Here and there a kerb is lowered for an entrance.
        height = LOWERED if rng.random() < ENTRANCES else town.kerb
        yield box((x, near, -0.5), (stop, rim, height), Kind.KERB, 0.35)
        x = stop
    inner = (start + KERB_WIDTH, end - KERB_WIDTH)
    for low, high in ((start, inner[0]), (inner[1], end)):
        yield box((low, rim, -0.5), (high, far, town.kerb), Kind.KERB, 0.35)
    pavement = (inner[0], rim, -0.5), (inner[1], far, town.kerb)
    yield box(*pavement, Kind.SIDEWALK, 0.3)
    yield from _houses(town, side, start + 3.0, end - 3.0, rng)


def _houses(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Put houses in a row, some apart, some with a shop window."""
    x = start
    while x < end - 4.0:
        stop = min(x + rng.uniform(10.0, 24.0), end)
        front = side * (town.half_road + rng.uniform(2.6, 4.5))
        back = side * (town.half_road + DEEP - 2.0)
        yield building(
            (x, front, 0.0),
            (stop, back, rng.uniform(7.0, 16.0)),
            pane=Kind.GLASS,
            reflectance=rng.uniform(0.25, 0.6),
            pitch=rng.uniform(2.2, 3.8),
            storey=rng.uniform(2.9, 3.6),
            window=(rng.uniform(0.9, 1.6), rng.uniform(1.2, 1.8)),
            recess=rng.uniform(0.06, 0.25),
            open_every=int(rng.integers(3, 7)),
            all_around=True,
        )
        if rng.random() < SHOPS and stop - x > WIDE:
            left = x + rng.uniform(1.0, 3.0)
            shop = ((left, front - side * 0.03, 0.4), (left + rng.uniform(3.0, 5.0), front, 2.6))
            yield box(*shop, Kind.GLASS, 0.1)
        x = stop + (rng.uniform(3.0, 8.0) if rng.random() < GAPS else 0.0)


def _parked(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Park cars along the kerb, here and there."""
    x = start + 6.0
    while x < end - 8.0:
        if rng.random() < PARKED:
            yield from car(x, side * (town.half_road - 1.05), rng)
        x += rng.uniform(5.2, 9.0)


def car(
    x: float, y: float, rng: np.random.Generator, velocity: tuple[float, float, float] = (0, 0, 0)
) -> Iterator[Surface]:
    """Build a car around (x, y): bonnet and boot, cabin."""
    long, wide, shade = CAR[0], CAR[1], rng.uniform(0.1, 0.7)
    waist, roof = rng.uniform(0.75, 0.95), rng.uniform(1.35, 1.9)
    body = ((x - long, y - wide, 0.22), (x + long, y + wide, waist))
    yield box(*body, Kind.CAR, shade, velocity=velocity)
    low = (x - rng.uniform(0.9, 1.9), y - wide + 0.1, waist)
    yield box(low, (x + 0.9, y + wide - 0.1, roof), Kind.CAR, 0.3, velocity=velocity)


def _furniture(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Put lamps, signs, trees and hedges on the pavement."""
    x = start + 2.0
    while x < end - 2.0:
        y = side * (town.half_road + rng.uniform(0.5, 0.9))
        what = str(rng.choice(tuple(FURNITURE), p=tuple(FURNITURE.values())))
        if what == 'lamp':
            yield pole(x, y, rng.uniform(0.05, 0.1), rng.uniform(4.0, 8.0))
        elif what == 'sign':
            yield pole(x, y, 0.03, 2.6)
            low, high = (x - 0.02, y - 0.3, 2.0), (x + 0.02, y + 0.3, 2.6)
            yield box(low, high, Kind.SIGN, 0.8)
        elif what == 'tree' and town.trees:
            yield from _tree(x, y, rng)
        elif town.trees:
            half = (rng.uniform(1.0, 2.5), 0.45, rng.uniform(0.5, 0.8))
            seed = int(rng.integers(2**31))
            yield crown((x, y + side * 0.6, half[2]), half, seed, 0.1, 0.05, 0.4)
        x += rng.uniform(4.0, 10.0)


def _tree(x: float, y: float, rng: np.random.Generator) -> Iterator[Surface]:
    tall, wide = rng.uniform(5.0, 9.0), rng.uniform(1.4, 2.6)
    foot, top = (x, y, 0.0), (x + rng.uniform(-0.3, 0.3), y, tall - 1.0)
    yield tube(foot, top, rng.uniform(0.08, 0.2), Kind.POLE)
    half = (wide, wide, (tall - 2.2) / 2.0)
    yield crown((x, y, tall - half[2]), half, int(rng.integers(2**31)))


def _manholes(town: Town, rng: np.random.Generator) -> Iterator[Surface]:
    """Let lids stand out of the road a little."""
    x = town.start
    while x < town.end:
        y = rng.uniform(-0.7, 0.7) * town.half_road
        height = town.crown * (1.0 - (y / town.half_road) ** 2)
        position = (x, y, height + rng.uniform(0.008, 0.025))
        yield lid(position, rng.uniform(0.28, 0.38), rng.uniform(0.003, 0.008))
        x += rng.uniform(4.0, 12.0)


def _wires(town: Town, rng: np.random.Generator) -> Iterator[Surface]:
    """Hang wires across the street."""
    x = town.start + 10.0
    while town.trees and x < town.end:
        reach, tall = town.half_road + 2.5, rng.uniform(5.0, 7.0)
        ends = ((x, -reach, tall), (x + rng.uniform(-4.0, 4.0), reach, tall))
        yield tube(*ends, rng.uniform(0.006, 0.015), Kind.WIRE)
        x += rng.uniform(12.0, 25.0)


def exhaust(x: float, y: float, rng: np.random.Generator, density: float = 1.6) -> tuple[Puff, ...]:
    """Put overlapping puffs behind an exhaust pipe, wider and thinner as they drift off."""
    puffs, drift, rise, grow = [], 0.0, 0.4, rng.uniform(1.2, 1.8)
    for _ in range(3):
        size = (0.32 * grow, 0.25 * grow, 0.12 * grow)
        puffs.append(Puff((x - drift, y + 0.2 * drift, rise), size, density / grow**2))
        drift += rng.uniform(0.6, 1.1)
        rise += rng.uniform(0.1, 0.22)
        grow *= rng.uniform(1.2, 1.4)
    return tuple(puffs)


def spray(
    x: float, y: float, speed: float, rng: np.random.Generator, density: float
) -> tuple[Puff, ...]:
    """Let a wet road be whirled up behind a car around (x, y) that drives along x."""
    back, puffs = -1.0 if speed >= 0.0 else 1.0, []
    for i in range(4):
        behind = x + back * (CAR[0] + 0.5 + 1.1 * i)
        size = (0.6, 0.45 + 0.1 * i, 0.22 + 0.08 * i)
        centre = (behind, y + rng.uniform(-0.1, 0.1), 0.3 + 0.12 * i)
        moving = (speed, 0.0, 0.0)
        puffs.append(Puff(centre, size, density / (1.0 + i), Cause.SPRAY, moving))
    return tuple(puffs)


def birds(middle: tuple[float, float], count: int, rng: np.random.Generator) -> tuple[Surface, ...]:
    """Let a flock fly over, some 2 to 9 m high."""
    centre = (*middle, rng.uniform(3.5, 7.0))
    flight = (*rng.uniform(-8.0, 8.0, 2), rng.uniform(-1.0, 1.0))
    flock = []
    for _ in range(count):
        position = (a + b for a, b in zip(centre, rng.normal(0.0, (2.5, 2.5, 0.7)), strict=True))
        x, y, z = position
        flock.append(ball((x, y, z), rng.uniform(0.06, 0.14), flight))
    return tuple(flock)
