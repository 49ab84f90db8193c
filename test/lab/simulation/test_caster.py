# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The ray caster against its naive twin, and with many rays and things; and rays from the air."""

from typing import Any

import numpy as np
import pytest
from naive import raycast as naive

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab._kernels import PANE
from lidar_outlier_lab.simulation.world import scene as surfaces
from lidar_outlier_lab.simulation.world.landscape import Landscape, Plants, build, hills
from lidar_outlier_lab.simulation.world.scene import Rays, Scene, Surface

Vector = tuple[float, float, float]

RAYS = 3000
FOOT, TOP = (0.0, 0.0, 0.0), (1.0, 2.0, 2.0)
LOW, HIGH = (-1.0, 0.0, 0.0), (2.0, 1.0, 3.0)
CENTRE, HALF = (1.0, 2.0, 3.0), (0.9, 0.7, 1.1)
ROAD, LID = (-9.0, 4.0, 5.0, 0.3), ((1.0, 2.0, 0.1), 0.9, 0.05, 0.2)
POLE = ((1.0, -2.0, 0.0), (0.0, 0.0, 1.0), 0.3, 4.0)
TUBE, CROWN = (FOOT, (1 / 3, 2 / 3, 2 / 3), 0.4, 3.0), (CENTRE, HALF, 0.25, 0.13, 0.4, 11)
# A surface, its twin and that one's measures, where rays are aimed, and the share that meets it.
TWINS: dict[str, tuple[Surface, Any, tuple[Any, ...], Vector, float]] = {
    'ground': (surfaces.ground(*ROAD), naive.ground, ROAD, FOOT, 0.3),
    'box': (surfaces.box(LOW, HIGH, Kind.CAR), naive.box, (LOW, HIGH), (0.5, 0.5, 1.5), 0.5),
    'pole': (surfaces.pole(1.0, -2.0, 0.3, 4.0), naive.tube, POLE, (1.0, -2.0, 2.0), 0.1),
    'tube': (surfaces.tube(FOOT, TOP, 0.4, Kind.POLE), naive.tube, TUBE, (0.5, 1.0, 1.0), 0.15),
    'ball': (surfaces.ball(CENTRE, 0.8), naive.ball, (CENTRE, 0.8), CENTRE, 0.2),
    'lid': (surfaces.lid(*LID), naive.lid, LID, LID[0], 0.1),
    'crown': (surfaces.crown(CENTRE, HALF, 11, 0.25, 0.13, 0.4), naive.crown, CROWN, CENTRE, 0.1),
}


def aim(seed: int, target: Vector, spread: float, far: float) -> Rays:
    """Aim single rays from all around at positions near a target."""
    rng = np.random.default_rng(seed)
    goal = np.array(target)[:, None] + rng.normal(0.0, spread, (3, RAYS))
    out = rng.normal(size=(3, RAYS))
    origin = np.array(target)[:, None] + far * out / np.linalg.norm(out, axis=0)
    direction = (goal - origin) / np.linalg.norm(goal - origin, axis=0)
    return Rays(origin[:, :, None], direction[:, :, None], np.zeros(RAYS))


@pytest.mark.parametrize('name', TWINS)
def test_equal_to_naive(name: str) -> None:
    """Every ray meets a surface where its twin says, or misses it like it."""
    surface, twin, measures, target, least = TWINS[name]
    rays = aim(3, target, 0.9, 9.0)
    hits = Scene((surface,)).cast(rays)
    count = 300 if surface.kind == Kind.FOLIAGE else RAYS
    for n in range(count):
        o, d = (tuple(part[:, n, 0].tolist()) for part in (rays.origin, rays.direction))
        expected = twin(*measures, o, d)
        assert (hits.surface[n, 0] == -1) == (expected is None)
        if expected is not None:
            assert (hits.distance[n, 0], hits.cosine[n, 0]) == pytest.approx(expected, abs=1e-9)
    assert least * count < np.isfinite(hits.distance[:count]).sum() < count


def test_bundles_are_cast_as_their_rays() -> None:
    """Leaving out what a bundle cannot meet leaves out nothing that one of its rays meets."""
    rng = np.random.default_rng(5)
    things = [surfaces.ground(-30.0, 30.0, 30.0)]
    for _ in range(60):
        x, y, z = rng.uniform(-8.0, 8.0, 3)
        things += [
            surfaces.ball((x, y, z), 0.2),
            surfaces.box((y, z, x), (y + 0.3, z + 0.3, x + 0.1), Kind.CAR),
            surfaces.tube((z, x, y), (z + 1.0, x, y + 0.5), 0.02, Kind.WIRE),
            surfaces.ball((z, y, x), 0.1, (y, x, z)),
        ]
    scene, reach = Scene(tuple(things)), 0.3
    middle = aim(6, (0.0, 0.0, 0.0), 4.0, 12.0)
    off = rng.uniform(-reach / 40, reach / 40, (3, RAYS, 7))
    off[:, :, 0] = 0.0
    direction = middle.direction + off
    direction /= np.linalg.norm(direction, axis=0)
    origin = np.broadcast_to(middle.origin, direction.shape)
    t = rng.uniform(0.0, 1.0, RAYS)
    together = scene.cast(Rays(origin, direction, t, reach))
    for k in range(7):
        alone = scene.cast(Rays(origin[:, :, k : k + 1], direction[:, :, k : k + 1], t, reach))
        np.testing.assert_array_equal(together.distance[:, k], alone.distance[:, 0])
        np.testing.assert_array_equal(together.surface[:, k], alone.surface[:, 0])
    for thing in things:
        single = Scene((thing,)).cast(Rays(origin, direction, t, reach))
        assert (together.distance <= single.distance).all()
    assert len(np.unique(together.surface)) > 120


@pytest.mark.parametrize(
    ('origin', 'goal', 'part'),
    [
        ((3.0, 0.0, 1.7), (3.0, 5.0, 1.7), 1),  # the wall between two windows
        ((4.5, 0.0, 1.7), (4.5, 5.0, 1.7), 1 + PANE),
        ((0.05, 0.0, 1.7), (5.05, 5.0, 1.7), 0),  # the reveal at the window's side
        ((4.5, 0.0, 7.4), (4.5, 5.1, 1.0), 2),  # its sill
        ((-5.0, 6.5, 1.7), (0.0, 6.5, 1.7), 0 + PANE),
        ((-5.0, 7.9, 1.7), (0.0, 7.9, 1.7), 0),
        ((4.5, 6.0, 9.0), (4.5, 6.0, 3.2), 2),
    ],
)
@pytest.mark.parametrize('all_around', [True, False])
def test_parts_of_a_building(origin: Vector, goal: Vector, part: int, *, all_around: bool) -> None:
    """Walls, reveals and panes say which way they face, and panes that they are panes."""
    house = surfaces.building(
        (0.0, 5.0, 0.0), (12.0, 9.0, 3.2), open_every=0, all_around=all_around
    )
    start, step = np.array(origin), np.array(goal) - np.array(origin)
    direction = (step / np.linalg.norm(step))[:, None, None]
    hits = Scene((house,)).cast(Rays(start[:, None, None], direction, np.zeros(1)))
    across = part == 0 + PANE and not all_around  # a plain wall there
    assert hits.part[0, 0] == (0 if across else part)


# From the air -----------------------------------------------------------------------------------

STEP = 0.002  # metres that the slow twin goes at a time


def slope() -> Landscape:
    """Lay a plain that rises by 0.1 a metre along x, and put a flat house and a tree on it."""
    ground = np.repeat(0.05 * np.arange(81.0)[:, None], 81, axis=1)
    top, owner = ground.copy(), np.zeros((81, 81), np.int64)
    top[20:41, 20:41], owner[20:41, 20:41] = 8.0, 1
    top[60:71, 60:71], owner[60:71, 60:71] = 9.0, -1
    return Landscape(ground, top, owner, 0.5)


def slow(land: Landscape, origin: Floats, direction: Floats) -> float:
    """Follow a ray in tiny steps until it is below what is seen from above there."""
    distance = np.arange(0.0, 60.0, STEP)
    x, y, z = origin[:, None] + distance * direction[:, None]
    below = z <= land.view(x, y).height
    return float(distance[np.argmax(below)])


@pytest.mark.parametrize('is_built', [False, True])
def test_rays_end_where_small_steps_do(*, is_built: bool) -> None:
    """Leading rays over squares, and halving the last step, finds what tiny steps find."""
    rng = np.random.default_rng(4)
    land = slope()
    if is_built:
        ground = hills((40.0, 40.0), 0.5, 0.2, rng)
        land = build(ground, 0.5, Plants(3, 12, tall=(4.0, 9.0)), rng)
    origin = np.stack([*rng.uniform(5.0, 35.0, (2, 60)), np.full(60, 30.0)])
    direction = np.stack([*rng.uniform(-0.25, 0.25, (2, 60)), np.full(60, -1.0)])
    direction /= np.linalg.norm(direction, axis=0)
    distance, kind = land.cast(origin, direction, np.zeros(60))
    expected = [slow(land, *ray) for ray in zip(origin.T, direction.T, strict=True)]
    off = np.abs(distance - expected)
    # The edge of a wall that is met within a single long step may be jumped over.
    assert np.count_nonzero(off > 2 * STEP) <= 2
    assert {Kind.TERRAIN, Kind.ROOF, Kind.FOLIAGE} == set(kind.tolist())


def test_build() -> None:
    """Houses stand apart, trees not on houses; nothing is below the ground."""
    rng = np.random.default_rng(2)
    land = build(hills((150.0, 120.0), 0.5, 0.3, rng), 0.5, Plants(40, 300, clearing=20.0), rng)
    assert land.size == (150.0, 120.0)
    assert (land.top >= land.ground).all()
    assert (land.top[land.owner == 0] == land.ground[land.owner == 0]).all()
    assert 10 < len(np.unique(land.owner[land.owner > 0])) <= 40
    assert 100 < len(np.unique(land.owner[land.owner < 0])) <= 300
    for house in np.unique(land.owner[land.owner > 0]):
        columns, rows = np.nonzero(land.owner == house)
        area = (np.ptp(columns) + 1) * (np.ptp(rows) + 1)
        assert len(columns) == area  # whole: no other house and no tree took a part
    x, y = 0.5 * np.arange(301)[:, None] - 75.0, 0.5 * np.arange(241)[None, :] - 60.0
    assert (land.owner[np.hypot(x, y) < 20.0 - 3.5] >= 0).all()
