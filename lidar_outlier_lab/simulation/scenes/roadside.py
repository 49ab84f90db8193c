# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What stands beside a street, thin or full of gaps: wires, fences, hedges.

All of it is good, however thin and alone its points are.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from lidar_outlier_filter.core.annotations import Triple
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab.simulation.scenes.random_streets import LANES
from lidar_outlier_lab.simulation.world.scene import Surface, box, crown, pole, tube

AHEAD, BEHIND = 22.0, -10.0  # metres of the way where things stand that are worth their rays


def _sagging(a: Triple, b: Triple, sag: float, radius: float) -> Iterator[Surface]:
    """Hang a wire between two points, ``sag`` metres below their line in its middle."""
    part = np.linspace(0.0, 1.0, 13)[:, None]
    at = (1.0 - part) * np.array(a) + part * np.array(b)
    at[:, 2] -= 4.0 * sag * (part * (1.0 - part))[:, 0]
    for foot, top in pairwise(map(tuple, at.tolist())):
        yield tube(foot, top, radius, Kind.WIRE)


def telephone(y: float, rng: np.random.Generator) -> Iterator[Surface]:
    """Put up poles along the pavement, with three wires, and one to a house at each."""
    x = np.arange(BEHIND - rng.uniform(0.0, 20.0), AHEAD + 30.0, rng.uniform(22.0, 30.0)).tolist()
    for one in x:
        yield pole(one, y, 0.12, 7.2)
        yield from _sagging((one, y, 6.9), (one + 4.0, y + 5.0, 5.0), 0.25, 0.004)
    for one, other in pairwise(x):
        for tall in (6.4, 6.7, 7.0):
            yield from _sagging((one, y, tall), (other, y, tall), rng.uniform(0.3, 0.7), 0.006)


def tramway(half: float, rng: np.random.Generator) -> Iterator[Surface]:
    """Hang a contact wire over each lane, from cables across the street between poles."""
    tall = rng.uniform(5.4, 5.8)
    spans = np.arange(BEHIND - rng.uniform(0.0, 15.0), AHEAD + 20.0, 18.0).tolist()
    for x in spans:
        for side in (half + 0.6, -half - 0.6):
            yield pole(x, side, 0.1, 8.0)
        yield from _sagging((x, -half - 0.6, 7.6), (x, half + 0.6, 7.6), 0.6, 0.006)
        for y in LANES:
            yield tube((x, y, tall), (x, y, 7.05), 0.006, Kind.WIRE)
    for one, other in pairwise(spans):
        for y in LANES:
            yield from _sagging((one, y, tall), (other, y, tall), 0.05, 0.007)


def posts(y: float, rng: np.random.Generator) -> Iterator[Surface]:
    """Drive in bollards and the thin posts of signs and delineators, in a row or two."""
    for x in np.arange(BEHIND - rng.uniform(0.0, 6.0), AHEAD, rng.uniform(1.5, 8.0)).tolist():
        yield pole(x, y + rng.uniform(-0.2, 0.2), rng.uniform(0.02, 0.06), rng.uniform(0.8, 3.2))


def laths(start: float, end: float, y: float) -> Iterator[Surface]:
    """Nail upright laths, gaps between them, to two rails."""
    for x in np.arange(start, end, 0.15).tolist():
        yield box((x, y - 0.01, 0.15), (x + 0.09, y + 0.01, 1.25), Kind.FENCE, 0.5)
    for tall in (0.4, 1.0):
        yield box((start, y + 0.01, tall), (end, y + 0.04, tall + 0.07), Kind.FENCE, 0.5)


def mesh(start: float, end: float, y: float) -> Iterator[Surface]:
    """Weld rods, ten a metre, to bars, and hang them between posts."""
    for x in np.arange(start, end, 0.1).tolist():
        yield tube((x, y, 0.15), (x, y, 1.75), 0.003, Kind.FENCE)
    for tall in np.arange(0.2, 1.8, 0.2).tolist():
        yield tube((start, y, tall), (end, y, tall), 0.004, Kind.FENCE)
    for x in np.arange(start, end, 2.5).tolist():
        yield tube((x, y, 0.0), (x, y, 1.9), 0.03, Kind.FENCE)


def hedges(start: float, end: float, y: float, rng: np.random.Generator) -> Iterator[Surface]:
    """Plant hedges in a row, each with its own leaves."""
    for x in np.arange(start, end, 1.6).tolist():
        half = (1.1, 0.45, rng.uniform(0.7, 0.9))
        yield crown((x, y, half[2]), half, int(rng.integers(2**31)), 0.08, 0.03, 0.4)
