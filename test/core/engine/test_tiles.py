# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points in tiles, against plain loops over all points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from lidar_outlier_filter.core.engine.tiles import Tiles

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIDES = (0.7, 3.0, 1e6)


def cloud(seed: int = 0) -> NDArray[np.float64]:
    """Scatter points around the origin, on a grid, some at one place and some very far."""
    rng = np.random.default_rng(seed)
    xyz = np.round(rng.normal(0, 2, (300, 3)), 1)
    xyz[:20] = xyz[20]
    xyz[30] = [1e7, -1e7, 5]
    xyz[31:34] = [50, 60, 70]
    return xyz


def some(seed: int = 1) -> NDArray[np.bool_]:
    """Choose most of the points."""
    return np.random.default_rng(seed).random(300) < 0.8


@pytest.mark.parametrize('side', SIDES)
def test_every_valid_point_is_in_its_tile(side: float) -> None:
    """Each valid point is once in the tile that covers it; tiles keep the order given."""
    xyz, valid = cloud(), some()
    tiles = Tiles(xyz, valid, side, np.empty)
    assert sorted(tiles.order.tolist()) == np.flatnonzero(valid).tolist()
    np.testing.assert_array_equal(tiles.xyz, xyz[tiles.order])
    seen = set()
    for tile in range(len(tiles)):
        part = tiles.part(tile)
        index, points = tiles.order[part], tiles.xyz[part]
        assert len(index) > 0
        assert index.tolist() == sorted(index.tolist())
        keys = {(np.floor(x / side), np.floor(y / side)) for x, y, _ in points.tolist()}
        (key,) = keys
        assert key not in seen
        seen.add(key)
        np.testing.assert_array_equal(tiles.corner[tile], np.array(key) * side)
        np.testing.assert_array_equal(tiles.low[tile], points.min(axis=0))
        np.testing.assert_array_equal(tiles.high[tile], points.max(axis=0))


def test_tiles_are_aligned_absolutely() -> None:
    """What else is in the cloud changes no tile: not its corner, not its points."""
    xyz = cloud()
    everything = np.ones(300, np.bool_)
    one, other = (
        Tiles(points, everything[: len(points)], 3.0, np.empty) for points in (xyz, xyz[40:])
    )
    corners = {tuple(corner) for corner in other.corner.tolist()}
    assert corners <= {tuple(corner) for corner in one.corner.tolist()}
    assert (one.corner == np.round(one.corner / 3) * 3).all()


def test_the_copy_is_put_where_it_is_told() -> None:
    """The copy of the coordinates goes into the array that is given for it."""
    given = np.full((300, 3), np.nan)
    shapes = []

    def allocate(shape: tuple[int, ...]) -> NDArray[np.float64]:
        shapes.append(shape)
        return given

    tiles = Tiles(cloud(), np.ones(300, np.bool_), 3.0, allocate)
    assert shapes == [(300, 3)]
    assert tiles.xyz is given
    assert not np.isnan(given).any()


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('halo', [0.0, 0.5, 10.0])
def test_around(side: float, halo: float) -> None:
    """A tile with its halo is all points that are left in the box, edges included, as given."""
    xyz = cloud()
    tiles = Tiles(xyz, np.ones(300, np.bool_), side, np.empty)
    left = some()
    for tile in range(len(tiles)):
        indices, box = tiles.around(tile, halo, left)
        np.testing.assert_array_equal(box[0], tiles.corner[tile] - halo)
        np.testing.assert_array_equal(box[1], tiles.corner[tile] + side + halo)
        expected = [
            index
            for index, (x, y, _) in enumerate(tiles.xyz.tolist())
            if left[index]
            and (
                index in range(len(xyz))[tiles.part(tile)]
                or (box[0][0] <= x <= box[1][0] and box[0][1] <= y <= box[1][1])
            )
        ]
        assert indices.tolist() == sorted(expected, key=tiles.order.__getitem__)


@pytest.mark.parametrize('axis', [0, 1])
@pytest.mark.parametrize('side', [0.1, 0.7, 1 / 3, 1.1])
def test_points_that_round_past_the_edge(side: float, axis: int) -> None:
    """A point that division puts into a tile is found there, though it is beyond its edge."""
    edges = side * np.arange(-3000, 3000)
    x = np.concatenate([np.nextafter(edges, -np.inf), edges, np.nextafter(edges, np.inf)])
    tile = np.floor(x / side)
    beyond = x[(x < tile * side) | (x > tile * side + side)]
    assert len(beyond) > 10
    xyz = np.zeros((len(beyond), 3))
    xyz[:, axis] = beyond
    tiles = Tiles(xyz, np.ones(len(xyz), np.bool_), side, np.empty)
    everything = np.ones(len(xyz), np.bool_)
    for number in range(len(tiles)):
        indices, _ = tiles.around(number, 0.0, everything)
        part = tiles.part(number)
        assert set(range(part.start, part.stop)) <= set(indices.tolist())


def radius(xyz: NDArray[np.float64], index: int, k: int, left: NDArray[np.bool_]) -> float:
    """Distance to the k-th nearest other place with points; inf if there are fewer."""
    own = xyz[index].tolist()
    places = {tuple(point) for point in xyz[left].tolist()} - {tuple(own)}
    distances = sorted(float(np.linalg.norm(np.subtract(point, own))) for point in places)
    return distances[k - 1] if len(distances) >= k else np.inf


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('hops', [1, 2])
@pytest.mark.parametrize('k', [1, 4, 290])
def test_closure(side: float, hops: int, k: int) -> None:
    """Every step leads to all points as near as the k-th nearest place, wherever they are."""
    tiles = Tiles(cloud(), np.ones(300, np.bool_), side, np.empty)
    left, xyz = some(), tiles.xyz
    given = [np.flatnonzero(tiles.order == index)[0] for index in (30, 31, 100, 200)]
    start = np.array([index for index in given if left[index]])
    known = np.full(300, np.nan)
    found = tiles.closure(start, k, hops, left, known)
    expected = set(start.tolist())
    for _ in range(hops):
        for index in sorted(expected):
            reach = radius(xyz, index, k, left) * (1 + 1e-12)
            near = np.linalg.norm(xyz - xyz[index], axis=1) <= reach
            expected |= set(np.flatnonzero(near & left).tolist())
    assert set(found.tolist()) == expected
    assert found.tolist() == sorted(found.tolist(), key=tiles.order.__getitem__)
    for index in start.tolist():
        assert known[index] == pytest.approx(radius(xyz, index, k, left), rel=1e-12)


def test_known_radii_are_taken() -> None:
    """A radius that is known is not searched again."""
    tiles = Tiles(cloud(), np.ones(300, np.bool_), 3.0, np.empty)
    known, start = np.zeros(300), np.flatnonzero(tiles.order == 0)
    found = tiles.closure(start, 5, 3, np.ones(300, np.bool_), known)
    assert sorted(tiles.order[found].tolist()) == list(range(21))  # those at the same place


@pytest.mark.parametrize('pairs', [1, 50])
def test_few_pairs_at_once(monkeypatch: pytest.MonkeyPatch, pairs: int) -> None:
    """How many queries are answered at once changes nothing."""
    tiles = Tiles(cloud(), np.ones(300, np.bool_), 3.0, np.empty)
    left, start = some(), np.arange(0, 300, 30)
    start = start[left[start]]
    expected = tiles.closure(start, 3, 2, left, np.full(300, np.nan))
    monkeypatch.setattr('lidar_outlier_filter.core.engine.tiles.PAIRS', pairs)
    monkeypatch.setattr('lidar_outlier_filter.core.engine.tiles.CHUNK', 17)
    again = Tiles(cloud(), np.ones(300, np.bool_), 3.0, np.empty)
    np.testing.assert_array_equal(again.order, tiles.order)
    np.testing.assert_array_equal(again.xyz, tiles.xyz)
    found = again.closure(start, 3, 2, left, np.full(300, np.nan))
    np.testing.assert_array_equal(found, expected)
