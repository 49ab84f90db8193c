# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated cloud like that of Sotoodeh (2007), section 4.1: 656 points, 84 of them outliers.

The paper shows its cloud in a figure only and says how many points there are. Here they are on two
surfaces, scanned in steps of 0.2 m and 0.1 m: a wavy wall, and a bent board 1.8 m in front of it.
Rays without echo leave holes. The outliers are 36 single points and three clusters of 13 that are
far from both, and 4 single points and a cluster of 5 near to one.
"""

from collections.abc import Callable, Iterator

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.world.recording import START, Cloud
from lidar_outlier_lab.simulation.world.sensors import FIRST, TRUTH

GOOD, STRAY, CLUSTERS, NEAR_STRAY, NEAR_CLUSTER = 572, 36, (13, 13, 13), 4, 5
FAR = (0.8, np.inf)  # metres from the nearest good point
NEAR = (0.2, 0.6)
SPREAD = 0.08  # standard deviation of a cluster's coordinates, metres
NOISE = 0.01  # standard deviation of the scanner's, metres
JITTER = 0.25  # of a step
BRANCHES, TWIGS = 4, 5  # thin things that stick out of the wall, good points along each
FIRST_TWIG, LONGER = 0.12, 1.6  # metres from the wall to the first, and how each step grows
MARGIN = (np.array([0.6, 0.6, 0.6]), np.array([0.6, 1.2, 0.6]))  # around the good points, metres


def simulate(seed: int, *, cluttered: bool = False) -> tuple[Floats, Bools]:
    """Scan the two surfaces and scatter the outliers; the same seed gives the same points.

    Points (656, 3) are in metres, y away from the scanner, z up; outliers (656,) are on no surface.

    With clutter some of the good points are on thin things that stick out of the wall, the farther
    the sparser: points that are right, and that no method which goes by distances can keep.
    """
    rng = np.random.default_rng(seed)
    u, v = _grid(rng, (24, 21), 0.2)
    wall = np.stack([u, 0.35 * np.sin(1.1 * u) * np.cos(0.8 * v), v], axis=1)
    u, v = _grid(rng, (12, 12), 0.1)
    board = np.stack([u + 1.2, 0.3 * (u - 0.6) ** 2 - 1.8, v + 0.8], axis=1)
    good = np.concatenate([wall, board])
    good += rng.normal(0.0, NOISE, good.shape)
    loose = _branches(rng, wall) if cluttered else np.zeros((0, 3))
    good = good[np.sort(rng.permutation(len(good))[: GOOD - len(loose)])]
    good = np.concatenate([good, loose])
    outliers = np.concatenate(
        [
            _scatter(rng, good, STRAY, FAR),
            _scatter(rng, good, NEAR_STRAY, NEAR),
            *(
                _scatter(rng, good, 1, FAR) + rng.normal(0.0, SPREAD, (size, 3))
                for size in CLUSTERS
            ),
            _scatter(rng, good, 1, NEAR) + rng.normal(0.0, SPREAD / 2, (NEAR_CLUSTER, 3)),
        ]
    )
    truth = np.arange(len(good) + len(outliers)) >= len(good)
    return np.concatenate([good, outliers]), truth


def _grid(rng: np.random.Generator, shape: tuple[int, int], step: float) -> tuple[Floats, Floats]:
    """Scan columns and rows of a surface, not quite evenly."""
    u, v = np.meshgrid(step * np.arange(shape[0]), step * np.arange(shape[1]))
    jitter = JITTER * step
    u, v = u.ravel(), v.ravel()
    return u + rng.uniform(-jitter, jitter, len(u)), v + rng.uniform(-jitter, jitter, len(v))


def _branches(rng: np.random.Generator, wall: Floats) -> Floats:
    """Let thin things stick out of the wall, towards the scanner and aside."""
    reach = np.cumsum(FIRST_TWIG * LONGER ** np.arange(TWIGS))
    found = []
    for foot in wall[rng.choice(len(wall), BRANCHES, replace=False)]:
        heading = np.array([rng.uniform(-0.5, 0.5), -1.0, rng.uniform(-0.5, 0.5)])
        heading /= np.linalg.norm(heading)
        found.append(foot + reach[:, None] * heading + rng.normal(0.0, NOISE, (TWIGS, 3)))
    return np.concatenate(found)


def _scatter(
    rng: np.random.Generator, good: Floats, count: int, between: tuple[float, float]
) -> Floats:
    """Throw points into the space around the good ones, so far from the nearest of them."""
    low, high = good.min(axis=0) - MARGIN[0], good.max(axis=0) + MARGIN[1]
    found: list[Floats] = []
    while len(found) < count:
        point = rng.uniform(low, high)
        if between[0] < np.linalg.norm(good - point, axis=1).min() < between[1]:
            found.append(point)
    return np.array(found)


SINGLES = STRAY + NEAR_STRAY  # the first of the outliers


def cloud(
    _name: str, seed: int, share: float | None, progress: Callable[[float], object]
) -> Iterator[Cloud]:
    """Simulate Sotoodeh's cloud, all of one instant (t = 0); its share of outliers is fixed."""
    if share is not None:
        raise FilterError('the share', 'left as it is in this preset', share)
    xyz, outlier = simulate(seed)
    points = np.zeros(len(xyz), np.dtype([*FIRST, *TRUTH]))
    for axis, name in enumerate('xyz'):
        points[name] = xyz[:, axis]
    rank = np.cumsum(outlier)
    cause = np.where(rank <= SINGLES, Cause.SINGLE, Cause.CLUSTER)
    points['label'] = np.where(outlier, cause, Cause.GOOD)
    points['surface'] = np.where(outlier, Kind.AIR, Kind.FACADE)
    progress(1.0)
    yield Cloud(START, START, points)
