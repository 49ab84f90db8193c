# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Streets beside which the ground is lower than the road, and right: no mirror made these points.

A bridge, a ditch, stairs down to a basement, a ramp down to a garage; slopes are fine steps.
"""

from collections.abc import Callable, Iterator

import numpy as np

from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab.simulation.scenes.random_streets import DEEP, LANES, Town, car
from lidar_outlier_lab.simulation.scenes.roadside import mesh
from lidar_outlier_lab.simulation.world.scene import Surface, box, building, ground, pole

START, END = -25.0, 60.0  # metres of the way that are built
BOTTOM = -12.0  # metres, from where everything is filled up
STEP = 0.04  # metres from a step of a slope to the next: as uneven as grass
RISER, TREAD = 0.17, 0.29  # of stairs, metres
STRETCH = (4.0, 14.0)  # metres of the way that one thing takes, from and to


def lay_out_sunken(town: Town, rng: np.random.Generator) -> tuple[Surface, ...]:
    """Build a street with something sunken in turn on either side."""
    surfaces: list[Surface] = [ground(START, END, town.half_road, town.crown)]
    for side in (1.0, -1.0):
        x = START
        while x < END:
            stop = min(x + rng.uniform(*STRETCH), END)
            what = SUNKEN[int(rng.integers(len(SUNKEN)))]
            surfaces += what(town, side, x, stop, rng)
            x = stop
        for x in np.arange(START + rng.uniform(0.0, 20.0), END, rng.uniform(9.0, 20.0)).tolist():
            surfaces += car(x, side * (town.half_road - 1.05), rng)
    surfaces += car(rng.uniform(-5.0, 12.0), LANES[1], rng, (-rng.uniform(5.0, 12.0), 0.0, 0.0))
    return (*surfaces, *town.things)


def _filled(
    side: float, x: tuple[float, float], y: tuple[float, float], top: float, kind: Kind
) -> Surface:
    """Fill up everything from the bottom: x, and y away from the middle, from and to."""
    return box((x[0], side * y[0], BOTTOM), (x[1], side * y[1], top), kind, 0.3)


def _house(side: float, start: float, end: float, near: float, rng: np.random.Generator) -> Surface:
    """Put up a house, whose walls go on below the road, from so far off the road's middle on."""
    corners = (start, side * near, -3.0), (end, side * (near + DEEP), rng.uniform(6.0, 14.0))
    return building(*corners, pane=Kind.GLASS, reflectance=rng.uniform(0.25, 0.6))


def _bridge(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Let one look through a railing down to the land."""
    rim, deep = town.half_road + rng.uniform(0.5, 1.5), rng.uniform(2.5, 8.0)
    yield _filled(side, (start, end), (town.half_road, rim), town.kerb, Kind.KERB)
    yield _filled(side, (start, end), (rim, DEEP), -deep, Kind.TERRAIN)
    yield from mesh(start, end, side * (rim - 0.1))
    for x in np.arange(start, end, rng.uniform(2.0, 6.0)).tolist():
        tall = deep + rng.uniform(-1.0, 2.0)
        top = pole(x, side * (rim + rng.uniform(1.0, 8.0)), 0.1, max(tall, 1.0))
        top.row[[2, 5, 8]] -= deep  # it stands on the land
        yield top


def _ditch(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Dig a ditch along the road, and let a meadow rise or fall behind it."""
    verge, half = town.half_road + rng.uniform(0.3, 1.2), rng.uniform(0.8, 2.0)
    deep, rise = rng.uniform(0.5, 1.6), rng.uniform(-0.15, 0.2)
    yield _filled(side, (start, end), (town.half_road, verge), 0.02, Kind.TERRAIN)
    steps = int(deep / STEP)
    for k, top in enumerate(np.linspace(0.0, -deep, steps).tolist()):
        wide = half * k / steps
        down = (verge + wide, verge + wide + half / steps)
        yield _filled(side, (start, end), down, top, Kind.TERRAIN)
        up = (verge + 2.0 * half - wide - half / steps, verge + 2.0 * half - wide)
        yield _filled(side, (start, end), up, top, Kind.TERRAIN)
    y, top = verge + 2.0 * half, 0.0
    while y < town.half_road + 20.0:
        yield _filled(side, (start, end), (y, y + 0.5), top, Kind.TERRAIN)
        y, top = y + 0.5, top + 0.5 * rise


def _basement(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Lead stairs along a house down to a door, in a pit of the pavement."""
    near = town.half_road + rng.uniform(1.2, 2.5)
    far, floor = near + rng.uniform(1.0, 1.6), -rng.uniform(1.2, 2.6)
    yield _house(side, start, end, far, rng)
    yield _filled(side, (start, end), (town.half_road, near), town.kerb, Kind.SIDEWALK)
    left = start + rng.uniform(0.3, 1.0)
    yield _filled(side, (start, left), (near, far), town.kerb, Kind.SIDEWALK)
    top, x = town.kerb, left
    while top > floor and x < end - TREAD:
        yield _filled(side, (x, x + TREAD), (near, far), top, Kind.SIDEWALK)
        top, x = top - RISER, x + TREAD
    stop = min(x + rng.uniform(0.9, 3.0), end)
    yield _filled(side, (x, stop), (near, far), max(top, floor), Kind.SIDEWALK)
    yield _filled(side, (stop, end), (near, far), town.kerb, Kind.SIDEWALK)
    yield from mesh(left, stop, side * near)


def _ramp(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Lead a drive from the road down to a garage, between walls."""
    door, slope = town.half_road + rng.uniform(4.0, 9.0), rng.uniform(0.06, 0.25)
    left = start + rng.uniform(0.0, 1.0)
    right = min(left + rng.uniform(2.8, 4.5), end)
    for x in ((start, left), (right, end)):
        if x[0] < x[1]:
            yield _filled(side, x, (town.half_road, door), town.kerb, Kind.SIDEWALK)
    y, top, deep = town.half_road, 0.03, STEP / slope
    while y < door:
        yield _filled(side, (left, right), (y, min(y + deep, door)), top, Kind.TERRAIN)
        y, top = y + deep, top - STEP
    yield _house(side, start, end, door, rng)


def _plain(
    town: Town, side: float, start: float, end: float, rng: np.random.Generator
) -> Iterator[Surface]:
    """Put a house on a pavement."""
    yield _filled(side, (start, end), (town.half_road, DEEP), town.kerb, Kind.SIDEWALK)
    yield _house(side, start, end, town.half_road + rng.uniform(2.0, 5.0), rng)


SUNKEN: tuple[Callable[[Town, float, float, float, np.random.Generator], Iterator[Surface]], ...]
SUNKEN = (_bridge, _ditch, _basement, _ramp, _plain)
