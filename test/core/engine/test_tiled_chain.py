# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A cloud in tiles gets the verdict of the cloud in one piece, bit for bit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lidar_outlier_filter.core.engine import tiled_chain as tiled
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.tiled_chain import TiledChain
from lidar_outlier_filter.core.engine.tiles import Tiles
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.points import choose_coordinates, load
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

COUNT = 1500
CHAINS: dict[str, dict[str, Any]] = {
    'sor': {},
    'sor2': {'chain': ['sor'], 'sor.statistic': 'sor2', 'sor.limit': 0.3},
    'radius': {'chain': ['sor'], 'sor.statistic': 'radius', 'sor.radius': 1.5},
    'DSOR': {'chain': ['sor'], 'sor.range_scaled': True, 'sor.multiplier': 0.1},
    'lof': {'chain': ['lof'], 'lof.min_pts': 8},
    'lof2': {'chain': ['lof'], 'lof.statistic': 'lof2', 'lof.threshold': 0.5},
    'smoother': {'chain': ['alpha_beta_gamma'], 'alpha_beta_gamma.significance': 0.01},
    'one after the other': {'chain': ['lof', 'alpha_beta_gamma', 'sor'], 'lof.min_pts': 8},
    'vote': {'chain': ['sor', 'lof', 'alpha_beta_gamma'], 'vote': 2, 'sor.multiplier': 0.5},
}
CHAINS['sor']['chain'] = ['sor']


def surface(rng: np.random.Generator) -> NDArray[np.float64]:
    """Make a rough surface with points far above, below and beside it, alone and in groups."""
    xyz = rng.random((COUNT, 3)) * [25, 15, 0.5]
    xyz[:40, 2] += rng.normal(0, 60, 40)
    xyz[40:46] = rng.normal(0, 1e4, (6, 3))
    xyz[46] = 1e7
    xyz[50:70] = 70 + rng.random((20, 3))
    return xyz


def grid(rng: np.random.Generator) -> NDArray[np.float64]:
    """Put it on a grid, so that there are ties and coincident points."""
    return np.round(surface(rng), 1)


def stacked(rng: np.random.Generator) -> NDArray[np.float64]:
    """More points at one place than any neighbourhood has."""
    xyz = grid(rng)
    for begin in range(100, 1000, 300):
        xyz[begin : begin + 60] = xyz[begin]
    return xyz


def utm(rng: np.random.Generator) -> NDArray[np.float64]:
    """Large coordinates in whole centimetres, as in LAS."""
    xyz: NDArray[np.float64] = np.round(surface(rng) + np.array([5e5, 4.2e6, 300]), 2)
    return xyz


def line(rng: np.random.Generator) -> NDArray[np.float64]:
    """Make a straight line with an even step."""
    x = rng.permutation(COUNT) / 8
    return np.stack((x, -x, 0 * x), axis=1)


CLOUDS = {cloud.__name__: cloud for cloud in (surface, grid, stacked, utm, line)}


def points(name: str) -> Points:
    """Make one of the clouds, with time, lines, and some points that are none."""
    rng = np.random.default_rng(7)
    xyz = CLOUDS[name](rng)
    t = rng.permutation(COUNT) * 1000
    return Points(xyz, t, t // 200_000, rng.random(COUNT) > 0.02)


def whole(cloud: Points, parameters: FilterParameters) -> Verdict:
    """Judge a cloud in one piece."""
    where = np.flatnonzero(cloud.valid)
    verdict = Verdict.untested(len(cloud))
    verdict.put(where, Chain(parameters).judge(cloud.take(where)))
    return verdict


def assert_same(one: Verdict, other: Verdict) -> None:
    """Compare two verdicts bit for bit."""
    for name in ('score', 'detectors', 'undecided', 'rejected'):
        assert getattr(one, name).dtype == getattr(other, name).dtype
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize('side', [pytest.param(4.0, marks=pytest.mark.slow), 11.0])
@pytest.mark.parametrize('name', CLOUDS)
@pytest.mark.parametrize('chain', CHAINS)
def test_same_as_in_one_piece(name: str, chain: str, side: float) -> None:
    """Whatever the cloud, the chain and the side of the tiles."""
    cloud = points(name)
    parameters = FilterParameters().changed(CHAINS[chain])
    expected = whole(cloud, parameters)
    assert np.isfinite(expected.score).any()
    assert_same(TiledChain(cloud, parameters, side).judge(), expected)


@pytest.mark.parametrize('count', [1, 2, 5, 8, 9, 20, 21, 22])
@pytest.mark.parametrize('chain', ['sor', 'lof', 'radius', 'one after the other'])
def test_few_points(count: int, chain: str) -> None:
    """With fewer points than neighbours, and just as many, in tiles of one point."""
    cloud = points('surface').take(slice(60, 60 + count))
    parameters = FilterParameters().changed(CHAINS[chain])
    assert_same(TiledChain(cloud, parameters, 0.3).judge(), whole(cloud, parameters))


def test_all_at_one_place() -> None:
    """A cloud of a single place."""
    cloud = points('surface')
    cloud.xyz[:] = [1, 2, 3]
    for chain in ('sor', 'lof', 'radius'):
        parameters = FilterParameters().changed(CHAINS[chain])
        assert_same(TiledChain(cloud, parameters, 2.0).judge(), whole(cloud, parameters))


def test_nothing_left() -> None:
    """Detectors that come after all has been rejected have nothing to say."""
    cloud = points('surface')
    values = {'chain': ['sor', 'lof', 'alpha_beta_gamma', 'quadric'], 'sor.statistic': 'radius'}
    parameters = FilterParameters().changed({**values, 'sor.radius': 1e-6})
    expected = whole(cloud, parameters)
    assert expected.rejected[cloud.valid].all()
    assert_same(TiledChain(cloud, parameters, 5.0).judge(), expected)


def test_no_valid_point() -> None:
    """A cloud of points that are none is untested."""
    cloud = points('surface')
    cloud.valid[:] = False
    verdict = TiledChain(cloud, FilterParameters().changed(CHAINS['sor']), 5.0).judge()
    assert_same(verdict, Verdict.untested(COUNT))


@pytest.mark.slow
def test_the_way_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor do the width of the halo, or how much is done at once."""
    cloud = points('grid')
    parameters = FilterParameters().changed(CHAINS['one after the other'])
    expected = whole(cloud, parameters)
    monkeypatch.setattr(tiled, 'LINES_AT_ONCE', 300)
    monkeypatch.setattr(tiled, 'FAR_AT_ONCE', 7)
    for halo in (0.0, 0.01, 2.0):
        monkeypatch.setattr(tiled, 'HALO', halo)
        monkeypatch.setattr(tiled, 'MOST', 0.5)
        assert_same(TiledChain(cloud, parameters, 9.0).judge(), expected)


def test_threads_do_not_matter() -> None:
    """One thread gives the answer of many."""
    cloud = points('stacked')
    one, many = (
        TiledChain(
            cloud, FilterParameters().changed({**CHAINS['lof'], 'threads': threads}), 9.0
        ).judge()
        for threads in (1, 3)
    )
    assert_same(one, many)


def test_most_points_are_measured_in_their_tile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only points far from others are looked after one by one: the halo grows to what it takes."""
    cloud = points('surface')
    far: list[int] = []
    measure = TiledChain._measure_far

    def count(self: TiledChain, how: Any, indices: Any, *given: Any) -> None:
        far.append(len(indices))
        measure(self, how, indices, *given)

    monkeypatch.setattr(TiledChain, '_measure_far', count)
    for chain in ('sor', 'lof'):
        TiledChain(cloud, FilterParameters().changed(CHAINS[chain]), 20.0).judge()
    assert 0 < min(far) <= max(far) < 100


def test_a_far_point_needs_few_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A point that is alone in its tile is measured among its neighbours, not among all."""
    sizes = []
    closure = Tiles.closure

    def count(self: Tiles, *given: Any) -> NDArray[np.int64]:
        found = closure(self, *given)
        sizes.append(len(found))
        return found

    monkeypatch.setattr(Tiles, 'closure', count)
    cloud = points('surface').take(np.array([46, *range(100, 1100)]))
    cloud.valid[:] = True
    for chain in ('sor', 'lof'):
        TiledChain(cloud, FilterParameters().changed(CHAINS[chain]), 50.0).judge()
    assert len(sizes) == 2
    assert sizes[0] == 21
    assert 9 < sizes[1] < 100


@pytest.mark.slow
def test_quadric_is_given_each_tile_with_its_halo() -> None:
    """Sections are those of a tile with a tenth around it: of the tiles, and of nothing else."""
    cloud = points('surface')
    cloud.xyz[:, 2] += np.where(np.arange(COUNT) % 50 == 9, 0.0, 0.1 * cloud.xyz[:, 0])
    parameters = FilterParameters().changed({'chain': ['quadric'], 'quadric.section': 16})
    verdict = TiledChain(cloud, parameters, 10.0).judge()
    x, y = cloud.xyz[:, 0], cloud.xyz[:, 1]
    rejected = 0
    for i in range(4):
        for j in range(3):
            own = cloud.valid & (x // 10 == i) & (y // 10 == j)
            near = (x >= 10 * i - 1) & (x <= 10 * i + 11) & (y >= 10 * j - 1) & (y <= 10 * j + 11)
            seen = np.flatnonzero(cloud.valid & near)
            result = Chain(parameters).judge(cloud.take(seen))
            assert_same(verdict.take(own), result.take(own[seen]))
            rejected += int(result.rejected[own[seen]].sum())
    assert rejected > 10


def test_too_many_points_in_a_tile() -> None:
    """A tile that holds more than may be held is refused."""
    parameters = FilterParameters().changed({**CHAINS['sor'], 'max_points': 1000})
    with pytest.raises(CloudError, match=r'tile with its halo must be at most max_points = 1000'):
        TiledChain(points('surface'), parameters, 100.0).judge()
    TiledChain(points('surface'), parameters, 10.0).judge()


@pytest.mark.parametrize('name', ['hierarchical', 'elevation'])
def test_what_needs_all_points_at_once_is_refused(name: str) -> None:
    """A detector that cannot be cut into tiles says so, before anything is done."""
    parameters = FilterParameters().changed({'chain': ['sor', name]})
    with pytest.raises(ParameterError, match=f'chain must be without {name} where there are tiles'):
        TiledChain(points('surface'), parameters, 10.0)


def test_progress() -> None:
    """Progress is called in points, all detectors together, and ends at the end."""
    seen: list[tuple[int, int]] = []
    cloud = points('surface')
    parameters = FilterParameters().changed(CHAINS['one after the other'])
    TiledChain(cloud, parameters, 10.0, progress=lambda *done: seen.append(done)).judge()
    total = 3 * int(cloud.valid.sum())
    assert {total for _, total in seen} == {total}
    done = [done for done, _ in seen]
    assert done == sorted(done)
    assert done[-1] <= total
    assert len(done) > 10


@pytest.mark.slow
@pytest.mark.parametrize('chain', ['sor', 'lof', 'one after the other'])
@pytest.mark.parametrize(
    'name', ['autzen_trim.laz', 'test_semis_2021_0382_6565_LA93_IGN69_cropped.laz']
)
def test_real_clouds(recordings: Path, name: str, chain: str) -> None:
    """Airborne clouds, trees and noise and all."""
    file = open_cloud(recordings / 'clouds' / name)
    parameters = FilterParameters().changed(CHAINS[chain])
    cloud = load(file, choose_coordinates(file, ()), parameters, timed=True).points
    assert_same(TiledChain(cloud, parameters, 150.0).judge(), whole(cloud, parameters))
