# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of country from the air: Pirotti et al. 2018 (from images) and Kang et al. 2018 (scanned).

Each is one message, all of it of one instant (t = 0), so that a filter judges it as a whole.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Bytes, Floats, Rows
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.world.landscape import Landscape, Plants, TopView, build, hills
from lidar_outlier_lab.simulation.world.recording import START, Cloud
from lidar_outlier_lab.simulation.world.sensors import FIRST, TRUTH

Law = Callable[[np.random.Generator, float, float], float]

MATCHED = np.dtype([*FIRST, *TRUTH])
SCANNED = np.dtype([*FIRST, ('gps_time', '<f8'), ('line', '<u4'), *TRUTH])
CELL = 0.5  # metres between the heights of a landscape
BRIGHTNESS = {Kind.TERRAIN: 30.0, Kind.ROOF: 45.0, Kind.FOLIAGE: 20.0}

# Pirotti et al. 2018, "Test data" and "Results": a million good points, 31 to the square metre.
GOOD, OUTLIERS, DENSITY = 1_000_000, 2596, 31.0
SINGLES = (1.0, 200.0)  # metres from the nearest good point
CENTRES = (2.0, 200.0)  # metres from a cluster's centre down to the surface
MEMBERS = (2, 30)  # points of a cluster
SPREAD = (0.1, 0.5)  # standard deviation of their coordinates, metres
MATCHING = 0.03  # standard deviation of heights from images, metres; of plants more
ROUGH = 0.12


def uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a distance, every one as probable: half of them are beyond the middle."""
    return float(rng.uniform(low, high))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a distance, every magnitude as probable: half are within the geometric mean."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def photogrammetry(
    _name: str,
    seed: int,
    share: float | None,
    progress: Callable[[float], object],
    law: Law = uniform,
) -> Iterator[Cloud]:
    """Simulate Pirotti's cloud: a wood with a clearing, meadows, a few houses, points moved off.

    Half of the outliers are single points, at 1 to 200 m from the others, half of them below; half
    lie in clusters of 2 to 30, 2 to 200 m above. The paper calls these distances random; ``law`` is
    how they are drawn.
    """
    rng = np.random.default_rng([seed, OUTLIERS])
    total = GOOD + OUTLIERS
    outliers = OUTLIERS if share is None else round(share * total)
    if not 0 <= outliers <= total // 10:
        raise FilterError('the share', 'from 0 to 0.1', share)
    points = _match(total, rng)
    progress(0.5)
    _move_off(points, outliers, rng, law)
    progress(1.0)
    yield Cloud(START, START, points)


def look_down(  # noqa: PLR0913  what country is like
    total: int,
    step: float,
    margin: float,
    cell: float,
    steep: float,
    plants: Plants,
    rng: np.random.Generator,
) -> tuple[Floats, Floats, TopView]:
    """See a landscape from above, in a grid that is not quite even: x and y (N,), and a view."""
    rows = int(np.ceil(np.sqrt(total)))
    size = (rows * step + margin, rows * step + margin)
    land = build(hills(size, cell, steep, rng), cell, plants, rng)
    cells = np.divmod(np.arange(total), rows)
    x, y = (step * (part + rng.uniform(0.0, 1.0, total)) for part in cells)
    return x, y, land.view(x, y)


def _match(total: int, rng: np.random.Generator) -> Rows:
    plants = Plants(5, 1400, tall=(8.0, 24.0), wide=(1.6, 3.2), pointed=0.9, clearing=45.0)
    x, y, view = look_down(total, 1.0 / np.sqrt(DENSITY), CELL, CELL / 2.0, 0.06, plants, rng)
    rough = np.where(view.kind == Kind.FOLIAGE, ROUGH, MATCHING)
    height = view.height + rough * rng.standard_normal(total)
    return _points(MATCHED, np.stack([x, y, height]), view.kind, rng)


def _points(dtype: np.dtype[np.void], xyz: Floats, kind: Bytes, rng: np.random.Generator) -> Rows:
    """Make good points at (3, N) on surfaces of so many kinds."""
    points = np.zeros(xyz.shape[1], dtype)
    for axis, name in enumerate('xyz'):
        points[name] = xyz[axis]
    bright = np.zeros(256)
    bright[list(BRIGHTNESS)] = list(BRIGHTNESS.values())
    points['intensity'] = bright[kind] * np.exp(0.2 * rng.standard_normal(len(points)))
    points['surface'] = kind
    return points


def _move_off(points: Rows, outliers: int, rng: np.random.Generator, law: Law) -> None:
    """Choose points by lot and move them off the surface, alone or in clusters."""
    chosen = rng.permutation(len(points))[:outliers]
    xyz = np.stack([points[axis] for axis in 'xyz'], axis=1).astype(np.float64)
    stay = np.ones(len(points), np.bool_)
    stay[chosen] = False
    tree = cKDTree(xyz[stay])
    singles = outliers // 2
    moved = [_single(xyz[i], tree, rng, law) for i in chosen[:singles]]
    left = outliers - singles
    while left:
        size = min(int(rng.integers(MEMBERS[0], MEMBERS[1] + 1)), left)
        # None is left alone at the end.
        size -= 1 if left - size == 1 and size > MEMBERS[0] else 0
        moved += _cluster(xyz[chosen[len(moved)]], size, tree, rng, law)
        left -= size
    for name, values in zip('xyz', np.reshape(moved, (-1, 3)).T, strict=True):
        points[name][chosen] = values
    points['label'][chosen] = np.where(np.arange(outliers) < singles, Cause.SINGLE, Cause.CLUSTER)
    points['surface'][chosen] = Kind.AIR


def _single(position: Floats, tree: cKDTree, rng: np.random.Generator, law: Law) -> Floats:
    """Move a point up or down, until it is far enough from all that stay."""
    while True:
        off = law(rng, *SINGLES) * rng.choice([-1.0, 1.0])
        moved: Floats = position + np.array([0.0, 0.0, off])
        if tree.query(moved)[0] >= SINGLES[0]:
            return moved


def _cluster(
    position: Floats, size: int, tree: cKDTree, rng: np.random.Generator, law: Law
) -> list[Floats]:
    """Put some points around one that is above the surface, none of them near to it."""
    while True:
        centre = position + np.array([0.0, 0.0, law(rng, *CENTRES)])
        members = centre + rng.normal(0.0, rng.uniform(*SPREAD), (size, 3))
        if tree.query(members)[0].min() >= SINGLES[0]:
            return list(members)


@dataclass(frozen=True)
class Flight:
    """One of Kang's two areas, as far as the paper says; it gives shares, but no sizes.

    Attributes
    ----------
    lines, shots : scan lines and shots of each
    spacing : metres from line to line
    height : of the aircraft above the ground's middle, metres
    steep : of the hills: see :func:`.hills`
    outliers : gross errors

    """

    lines: int
    shots: int
    spacing: float
    height: float
    steep: float
    plants: Plants
    outliers: int


FLIGHTS = {
    'kang-urban': Flight(500, 1000, 1.2, 550.0, 0.01, Plants(420, 900), 250),
    'kang-mountain': Flight(
        1000, 1000, 1.1, 900.0, 0.3, Plants(12, 6000, tall=(5.0, 16.0), pointed=0.6), 240
    ),
}
FIELD_OF_VIEW = np.radians(20.0)  # to either side
LINE_TIME = 20_000_000  # nanoseconds
RANGING = 0.03  # standard deviation of a range, metres
LEAVES = (0.4, 1.5)  # share of the shots that go into a tree, and how deep on average, metres
HIGH, LOW = (3.0, 300.0), (3.0, 60.0)  # metres that gross errors are above and below
HIGH_SHARE = 0.6
FLOCK = 3  # high ones that come together, at most


def flight(
    name: str, seed: int, share: float | None, progress: Callable[[float], object]
) -> Iterator[Cloud]:
    """Simulate one of ``FLIGHTS``; ``share`` of its points are gross errors, None: the table's."""
    how = FLIGHTS[name]
    rng = np.random.default_rng([seed, how.outliers])
    total = how.lines * how.shots
    outliers = how.outliers if share is None else round(share * total)
    if not 0 <= outliers <= total // 10:
        raise FilterError('the share', 'from 0 to 0.1', share)
    origin, direction, distance, kind, _ = fly(how, rng)
    progress(0.8)
    distance += RANGING * rng.standard_normal(total)
    label = _miss(distance, direction[2], outliers, rng)
    points = _points(SCANNED, origin + distance * direction, kind, rng)
    points['label'] = label
    points['surface'][label != Cause.GOOD] = Kind.AIR
    shot = np.arange(total)
    points['line'] = shot // how.shots
    points['gps_time'] = START // SECOND + shot * (LINE_TIME / how.shots / SECOND)
    progress(1.0)
    yield Cloud(START, START, points)


class Flown(NamedTuple):
    """What the N shots of a flight meet: origins and directions (3, N), and the country itself."""

    origin: Floats
    direction: Floats
    distance: Floats
    kind: Bytes
    land: Landscape


def fly(how: Flight, rng: np.random.Generator, leaves: tuple[float, float] = LEAVES) -> Flown:
    """Build a country and scan it from the air, without noise."""
    total = how.lines * how.shots
    origin, direction, size = _beams(how)
    land = build(hills(size, CELL, how.steep, rng), CELL, how.plants, rng)
    origin[2] += land.ground.mean()
    into, deep = leaves
    depth = np.where(rng.random(total) < into, rng.exponential(deep, total), 0.0)
    distance, kind = land.cast(origin, direction, depth)
    return Flown(origin, direction, distance, kind, land)


def _beams(how: Flight) -> tuple[Floats, Floats, tuple[float, float]]:
    """Origins and directions (3, N) of shots, and how much country they need, metres."""
    reach = 1.3 * how.height * np.tan(FIELD_OF_VIEW)
    size = (how.lines * how.spacing + 20.0, 2.0 * reach)
    line, shot = np.divmod(np.arange(how.lines * how.shots), how.shots)
    angle = FIELD_OF_VIEW * (2.0 * (shot + 0.5) / how.shots - 1.0)
    x = 10.0 + how.spacing * (line + shot / how.shots)
    origin = np.stack([x, np.full(len(x), reach), np.full(len(x), how.height)])
    direction = np.stack([np.zeros(len(x)), np.sin(angle), -np.cos(angle)])
    return origin, direction, size


def _miss(distance: Floats, fall: Floats, outliers: int, rng: np.random.Generator) -> Bytes:
    """Let some shots end in the air, and some come back late from below the ground; give causes."""
    label = np.full(len(distance), Cause.GOOD, np.uint8)
    chosen = np.zeros(0, np.int64)
    while len(chosen) < outliers:
        first, count = rng.integers(len(distance) - FLOCK), rng.integers(1, FLOCK + 1)
        group = first + np.arange(min(int(count), outliers - len(chosen)))
        if np.isin(group, chosen).any():
            continue
        chosen = np.concatenate([chosen, group])
        is_high = rng.random() < HIGH_SHARE
        low, high = np.log(HIGH if is_high else LOW)
        off = np.exp(rng.uniform(low, high)) + rng.normal(0.0, 0.2, len(group))
        distance[group] += np.where(is_high, off, -off) / fall[group]
        label[group] = Cause.BIRD if is_high else Cause.REFLECTION
    return label
