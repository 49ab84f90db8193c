# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled ray caster against its naive twin, and what only it does: many rays, many things."""

from typing import Any

import numpy as np
import pytest
from naive import raycast as naive

from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab.simulation.world import scene as surfaces
from lidar_outlier_lab.simulation.world.caster import PANE
from lidar_outlier_lab.simulation.world.scene import Rays, Scene, Surface

Vector = tuple[float, float, float]

RAYS = 3000
FOOT, TOP = (0.0, 0.0, 0.0), (1.0, 2.0, 2.0)
LOW, HIGH = (-1.0, 0.0, 0.0), (2.0, 1.0, 3.0)
CENTRE, HALF = (1.0, 2.0, 3.0), (0.9, 0.7, 1.1)


def aim(seed: int, target: Vector, spread: float, far: float) -> Rays:
    """Aim single rays from all around at positions near a target."""
    rng = np.random.default_rng(seed)
    goal = np.array(target)[:, None] + rng.normal(0.0, spread, (3, RAYS))
    out = rng.normal(size=(3, RAYS))
    origin = np.array(target)[:, None] + far * out / np.linalg.norm(out, axis=0)
    direction = (goal - origin) / np.linalg.norm(goal - origin, axis=0)
    return Rays(origin[:, :, None], direction[:, :, None], np.zeros(RAYS))


@pytest.mark.parametrize(
    ('surface', 'twin', 'measures', 'target', 'least'),
    [
        (
            surfaces.ground(-9.0, 4.0, 5.0, 0.3),
            naive.ground,
            (-9.0, 4.0, 5.0, 0.3),
            (0.0, 0.0, 0.0),
            0.3,
        ),
        (surfaces.box(LOW, HIGH, Kind.CAR), naive.box, (LOW, HIGH), (0.5, 0.5, 1.5), 0.5),
        (
            surfaces.pole(1.0, -2.0, 0.3, 4.0),
            naive.tube,
            ((1.0, -2.0, 0.0), (0.0, 0.0, 1.0), 0.3, 4.0),
            (1.0, -2.0, 2.0),
            0.1,
        ),
        (
            surfaces.tube(FOOT, TOP, 0.4, Kind.POLE),
            naive.tube,
            (FOOT, (1 / 3, 2 / 3, 2 / 3), 0.4, 3.0),
            (0.5, 1.0, 1.0),
            0.15,
        ),
        (surfaces.ball(CENTRE, 0.8), naive.ball, (CENTRE, 0.8), CENTRE, 0.2),
        (
            surfaces.lid((1.0, 2.0, 0.1), 0.9, 0.05, 0.2),
            naive.lid,
            ((1.0, 2.0, 0.1), 0.9, 0.05, 0.2),
            (1.0, 2.0, 0.1),
            0.1,
        ),
        (
            surfaces.crown(CENTRE, HALF, 11, 0.25, 0.13, 0.4),
            naive.crown,
            (CENTRE, HALF, 0.25, 0.13, 0.4, 11),
            CENTRE,
            0.1,
        ),
    ],
    ids=['ground', 'box', 'pole', 'leaning tube', 'ball', 'lid', 'crown'],
)
def test_equal_to_naive(
    surface: Surface, twin: Any, measures: tuple[Any, ...], target: Vector, least: float
) -> None:
    """Every ray meets a surface where its twin says, or misses it like it."""
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
