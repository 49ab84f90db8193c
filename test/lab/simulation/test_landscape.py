# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Landscapes: what is seen from above, and where rays from the air end."""

import numpy as np
import pytest

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab.simulation.world.landscape import Landscape, Plants, build, hills

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
