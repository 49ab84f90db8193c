# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds larger than memory get the verdicts of clouds in memory, bit for bit."""

from dataclasses import fields
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import DTypeLike, NDArray

from lidar_outlier_filter.core.annotations import Allocate, Floats
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.chain import Chain, tiles
from lidar_outlier_filter.core.engine.whole_cloud import judge_whole
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters

COUNT = 1500
RADIUS = {'sor.statistic': 'radius', 'sor.radius': 0.02}
CHAINS: dict[str, dict[str, Any]] = {
    'sor': {'chain': ['sor']},
    'DROR': {'chain': ['sor'], 'sor.range_scaled': True, **RADIUS},
    'lof': {'chain': ['lof'], 'lof.min_pts': 8},
    'one after the other': {'chain': ['lof', 'alpha_beta_gamma', 'sor'], 'lof.min_pts': 8},
    'vote': {'chain': ['sor', 'lof', 'alpha_beta_gamma'], 'vote': 2, 'sor.multiplier': 0.5},
    'trees': {'chain': ['sor', 'boosted_trees'], 'boosted_trees.sensor': 'survey'},
}


@pytest.fixture
def allocate(tmp_path: Path) -> Allocate:
    """Make arrays in files."""
    number = count()

    def in_file(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        return np.asarray(np.memmap(tmp_path / f'{next(number)}', dtype, 'w+', shape=shape))

    return in_file


def cloud(name: str, chosen: int = COUNT) -> Points:
    """Make a rough surface with points far away, alone and in groups; tied and stacked ones."""
    rng = np.random.default_rng(7)
    xyz = rng.random((COUNT, 3)) * [25, 15, 0.5]
    xyz[:40, 2] += rng.normal(0, 60, 40)
    xyz[40:46] = rng.normal(0, 1e4, (6, 3))
    xyz[50:70] = 70 + rng.random((20, 3))
    if name == 'stacked':
        xyz = np.round(xyz, 1)
        for begin in range(100, 1000, 300):
            xyz[begin : begin + 60] = xyz[begin]
    t = rng.permutation(COUNT) * 1000
    every = Points(xyz, t, t // 200_000, rng.random(COUNT) > 0.02)
    return every.take(rng.permutation(COUNT)[:chosen])


def assert_same(one: Verdict, other: Verdict) -> None:
    """Compare two verdicts bit for bit."""
    for field in fields(Verdict):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


@pytest.mark.parametrize('chosen', [0, 9, COUNT])
@pytest.mark.parametrize('name', ['rough', 'stacked'])
@pytest.mark.parametrize('chain', CHAINS)
def test_same_as_in_memory(name: str, chain: str, chosen: int, allocate: Allocate) -> None:
    """Whatever the cloud and the chain."""
    points, parameters = cloud(name, chosen), FilterParameters().changed(CHAINS[chain])
    expected = judge_whole(points, parameters)
    assert chosen < COUNT or expected.rejected.any()
    assert_same(judge_whole(points, parameters, tile=9.0, allocate=allocate), expected)


def test_coordinates_and_lists_are_in_files(allocate: Allocate, tmp_path: Path) -> None:
    """What is held for each point and neighbour lies in files: most of the bytes of a cloud."""
    judge_whole(
        cloud('rough'), FilterParameters().changed(CHAINS['lof']), tile=9.0, allocate=allocate
    )
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) > COUNT * (3 * 24 + 4 * 8) * 0.9


def test_quadric_is_given_each_tile_with_its_halo(allocate: Allocate) -> None:
    """Sections are those of a tile with a tenth around it: of the tiles, and of nothing else."""
    points = cloud('rough')
    x, y = points.xyz[:, 0], points.xyz[:, 1]
    points.xyz[:, 2] += np.where(np.arange(COUNT) % 50 == 9, 0.0, 0.1 * x)
    parameters = FilterParameters().changed({'chain': ['quadric'], 'quadric.section': 16})
    verdict = judge_whole(points, parameters, tile=10.0, allocate=allocate)
    rejected = 0
    for i in range(3):
        for j in range(2):
            own = points.valid & (x // 10 == i) & (y // 10 == j)
            near = (x >= 10 * i - 1) & (x <= 10 * i + 11) & (y >= 10 * j - 1) & (y <= 10 * j + 11)
            seen = np.flatnonzero(points.valid & near)
            result = Chain(parameters).judge(points.take(seen))
            assert_same(verdict.take(own), result.take(own[seen]))
            rejected += int(result.rejected[own[seen]].sum())
    assert rejected > 10


@pytest.mark.parametrize('side', [0.1, 0.7, 1 / 3, 11.0])
def test_every_point_is_in_one_tile(side: float) -> None:
    """Also one that division puts into a tile, though it is beyond its edge."""
    edges = side * np.arange(-300, 300)
    x = np.concatenate([np.nextafter(edges, -np.inf), edges, np.nextafter(edges, np.inf)])
    xyz: Floats = np.stack([x, np.roll(x, 7), 0 * x], axis=1)
    own = [indices[is_own] for indices, is_own in tiles(xyz, side)]
    assert sorted(np.concatenate(own).tolist()) == list(range(len(xyz)))
    for indices in own:
        assert len(np.unique(np.floor(xyz[indices, :2] / side), axis=0)) == 1


def test_too_many_points_in_a_tile(allocate: Allocate) -> None:
    """A tile that holds more than may be held is refused."""
    parameters = FilterParameters().changed({'chain': ['quadric'], 'max_points': 1000})
    with pytest.raises(CloudError, match=r'tile with its halo must be at most max_points = 1000'):
        judge_whole(cloud('rough'), parameters, tile=100.0, allocate=allocate)


@pytest.mark.parametrize('name', ['hierarchical', 'elevation'])
def test_what_needs_memory_is_refused(name: str, allocate: Allocate) -> None:
    """A detector that needs all points in memory is refused before anything is done."""
    assert DETECTORS[name].large == 'no'
    parameters = FilterParameters().changed({'chain': ['sor', name]})
    with pytest.raises(ParameterError, match=f'chain must be without {name} where there are tiles'):
        judge_whole(cloud('rough'), parameters, tile=10.0, allocate=allocate)
