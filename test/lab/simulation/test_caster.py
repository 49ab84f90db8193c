# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled ray caster against its naive twin, and what only it does: many rays, many things."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from naive import raycast as naive

from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_lab.simulation.world.caster import PANE, uniform
from lidar_outlier_lab.simulation.world.scene import Rays, Scene
from lidar_outlier_lab.simulation.world.surfaces import (
    Ball,
    Box,
    Building,
    Crown,
    Ground,
    Lid,
    Pole,
    Tube,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_lab.simulation.world.scene import Hits, Surface

    Vector = tuple[float, float, float]
    Naive = Callable[[Vector, Vector], naive.Hit]

RAYS = 3000


def aim(seed: int, target: Vector, spread: float, far: float) -> Rays:
    """Aim single rays from all around at positions near a target."""
    rng = np.random.default_rng(seed)
    goal = np.array(target)[:, None] + rng.normal(0.0, spread, (3, RAYS))
    out = rng.normal(size=(3, RAYS))
    origin = np.array(target)[:, None] + far * out / np.linalg.norm(out, axis=0)
    step = goal - origin
    direction = step / np.linalg.norm(step, axis=0)
    return Rays(origin[:, :, None], direction[:, :, None], np.zeros(RAYS))


def tube_of(surface: Tube) -> Naive:
    """Give the naive twin of a tube."""
    foot, top = np.array(surface.foot), np.array(surface.top)
    length = float(np.linalg.norm(top - foot))
    x, y, z = (top - foot) / length
    return lambda o, d: naive.tube(surface.foot, (x, y, z), surface.radius, length, o, d)


POLE, LEANING = Pole(1.0, -2.0, 0.3, 4.0), Tube((0.0, 0.0, 0.0), (1.0, 2.0, 2.0), 0.4, Kind.POLE)
LEAVES = Crown((1.0, 2.0, 3.0), (0.9, 0.7, 1.1), 11, cell=0.25, leaf=0.13, share=0.4)


@pytest.mark.parametrize(
    ('surface', 'twin', 'target', 'least'),
    [
        (
            Ground(-9.0, 4.0, 5.0, 0.3),
            lambda o, d: naive.ground(-9.0, 4.0, 5.0, 0.3, o, d),
            (0.0, 0.0, 0.0),
            0.3,
        ),
        (
            Box((-1.0, 0.0, 0.0), (2.0, 1.0, 3.0), Kind.CAR),
            lambda o, d: naive.box((-1.0, 0.0, 0.0), (2.0, 1.0, 3.0), o, d),
            (0.5, 0.5, 1.5),
            0.5,
        ),
        (POLE, tube_of(Tube((1.0, -2.0, 0.0), (1.0, -2.0, 4.0), 0.3, Kind.POLE)), (1, -2, 2), 0.1),
        (LEANING, tube_of(LEANING), (0.5, 1.0, 1.0), 0.15),
        (
            Ball((1.0, 2.0, 3.0), 0.8),
            lambda o, d: naive.ball((1.0, 2.0, 3.0), 0.8, o, d),
            (1.0, 2.0, 3.0),
            0.2,
        ),
        (
            Lid((1.0, 2.0, 0.1), 0.9, 0.05, 0.2),
            lambda o, d: naive.lid((1.0, 2.0, 0.1), 0.9, 0.05, 0.2, o, d),
            (1.0, 2.0, 0.1),
            0.1,
        ),
        (
            LEAVES,
            lambda o, d: naive.crown(
                LEAVES.centre, LEAVES.half, 0.25, 0.13, 0.4, LEAVES.seed, o, d
            ),
            LEAVES.centre,
            0.1,
        ),
    ],
    ids=['ground', 'box', 'pole', 'leaning tube', 'ball', 'lid', 'crown'],
)
def test_equal_to_naive(surface: Surface, twin: Naive, target: Vector, least: float) -> None:
    """Every ray meets a surface where its twin says, or misses it like it."""
    rays = aim(3, target, 0.9, 9.0)
    hits = Scene((surface,)).cast(rays)
    count = 300 if isinstance(surface, Crown) else RAYS
    met = 0
    for n in range(count):
        o, d = (tuple(part[:, n, 0].tolist()) for part in (rays.origin, rays.direction))
        expected = twin(o, d)
        if expected is None:
            assert hits.distance[n, 0] == np.inf
            assert hits.surface[n, 0] == -1
        else:
            met += 1
            assert (hits.distance[n, 0], hits.cosine[n, 0]) == pytest.approx(expected, abs=1e-9)
    assert least * count < met < count


def test_dice_equal_to_naive() -> None:
    """Cells get the same numbers, negative ones too, and these are uniform."""
    cells = [(i, j, k) for i in (-7, 0, 3) for j in (-1, 2) for k in range(-50, 50)]
    numbers = [uniform(*cell, 2**31 - 1, 4) for cell in cells]
    assert numbers == [naive.uniform(*cell, 2**31 - 1, 4) for cell in cells]
    assert np.mean(numbers) == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / len(numbers)))
    assert len(set(numbers)) == len(numbers)


def one(scene: Scene, origin: Vector, goal: Vector, t: float = 0.0) -> Hits:
    """Send one ray."""
    step = np.array(goal) - np.array(origin)
    direction = step / np.linalg.norm(step)
    start = np.array(origin, np.float64)
    return scene.cast(Rays(start[:, None, None], direction[:, None, None], np.array([t])))


def test_bundles_are_cast_as_their_rays() -> None:
    """Leaving out what a bundle cannot meet leaves out nothing that one of its rays meets."""
    rng = np.random.default_rng(5)
    things: list[Surface] = [Ground(-30.0, 30.0, 30.0)]
    for _ in range(60):
        x, y, z = rng.uniform(-8.0, 8.0, 3)
        things += [Ball((x, y, z), 0.2), Box((y, z, x), (y + 0.3, z + 0.3, x + 0.1), Kind.CAR)]
        things.append(Tube((z, x, y), (z + 1.0, x, y + 0.5), 0.02, Kind.WIRE))
        things.append(Ball((z, y, x), 0.1, (y, x, z)))
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
    for index in range(len(things)):
        single = Scene((things[index],)).cast(Rays(origin, direction, t, reach))
        assert (together.distance <= single.distance).all()
    assert len(np.unique(together.surface)) > 120


def test_parts_of_a_building() -> None:
    """Walls, reveals and panes say which way they face, and panes that they are panes."""
    house = Building((0.0, 5.0, 0.0), (12.0, 9.0, 3.2), open_every=0, all_around=True)
    scene = Scene((house,))
    for origin, goal, part in (
        ((3.0, 0.0, 1.7), (3.0, 5.0, 1.7), 1),  # the wall between two windows
        ((4.5, 0.0, 1.7), (4.5, 5.0, 1.7), 1 + PANE),
        ((0.05, 0.0, 1.7), (5.05, 5.0, 1.7), 0),  # the reveal at the window's side
        ((4.5, 0.0, 7.4), (4.5, 5.1, 1.0), 2),  # its sill
        ((-5.0, 6.5, 1.7), (0.0, 6.5, 1.7), 0 + PANE),
        ((-5.0, 7.9, 1.7), (0.0, 7.9, 1.7), 0),
        ((4.5, 6.0, 9.0), (4.5, 6.0, 3.2), 2),
    ):
        assert one(scene, origin, goal).part[0, 0] == part, (origin, goal)
    plain = Scene((Building((0.0, 5.0, 0.0), (12.0, 9.0, 3.2)),))
    assert one(plain, (-5.0, 6.5, 1.7), (0.0, 6.5, 1.7)).part[0, 0] == 0
