# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The neighbours found in a tree are those of the naive twin, ties and coincident points too."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from time import thread_time
from timeit import repeat

import numpy as np
import pytest
from helpers import shapes
from helpers.shapes import Rng, Shape, grid, line, lone_stack, one_place, scattered, sheet, stacks
from naive import neighbours as naive
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats, Index
from lidar_outlier_filter.core.neighbours import neighbourhood as neighbours
from lidar_outlier_filter.core.neighbours.neighbourhood import Nearest, Neighbourhood
from lidar_outlier_filter.core.neighbours.tree_build import LEAF, SUBTREE
from lidar_outlier_filter.errors import FilterError

Lists = tuple[NDArray[np.int64], NDArray[np.bool_]]

SMALL = 150  # points of the clouds for the naive twin
LARGE = 100_000  # more than one thread sorts alone

# Clouds of n points ------------------------------------------------------------------------------


def flat(rng: Rng, n: int) -> Floats:
    """Take positions with integer coordinates in a plane, some twice: nearly all have ties."""
    return np.append(rng.integers(0, round(n**0.5) + 1, (n, 2)), np.full((n, 1), 7.0), axis=1)


def shell(rng: Rng, n: int) -> Floats:
    """Put one in the middle, all others exactly equally far: 1, 2, 3 in any order and sign."""
    xyz: Floats = rng.permuted(np.tile([1.0, 2.0, 3.0], (n, 1)), axis=1) * rng.choice(
        [-1, 1], (n, 3)
    )
    xyz[n // 3] = 0
    return xyz


def outlier(rng: Rng, n: int) -> Floats:
    """Gather points, but for one that is a billion metres off."""
    xyz = rng.normal(size=(n, 3))
    xyz[n // 2] = [1e9, -1e9, 3]
    return xyz


def uneven(rng: Rng, n: int) -> Floats:
    """Scatter points at 1e-20 to 1e20 metres."""
    return rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-20, 20, (n, 1))


def halving(_: Rng, n: int) -> Floats:
    """Put each point half as far as the one before, as long as squares are not 0."""
    xyz = np.zeros((n, 3))
    xyz[:, 0] = 2.0 ** -(np.arange(n) % 500)
    return xyz


def tiny(rng: Rng, n: int) -> Floats:
    """Scatter points so near zero that no product of two coordinates is a number but 0."""
    return rng.normal(size=(n, 3)) * 1e-310


def vanishing(rng: Rng, n: int) -> Floats:
    """Scatter points at 1e-170 to 1e-140 metres: squares of some distances underflow."""
    return rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-170, -140, (n, 1))


def finest(rng: Rng, n: int) -> Floats:
    """Take four numbers with no others between them: of two there is no middle."""
    xyz = np.ones((n, 3))
    xyz += rng.integers(0, 4, (n, 3)) * 2.0**-52
    return xyz


def rows(rng: Rng, n: int) -> Floats:
    """Scan lines: dense along them, sparse across."""
    xyz: Floats = np.stack(
        [np.arange(n) // 50 * 1.0, np.arange(n) % 50 * 0.01, np.zeros(n)], axis=1
    )
    xyz += rng.normal(0, 0.002, (n, 3))
    return xyz


CLOUDS: list[Shape] = [
    *(scattered, sheet, grid, flat, line, one_place, stacks, shapes.doubled, lone_stack),
    *(shell, outlier, uneven, halving, tiny, vanishing, finest, rows),
]
every_cloud = pytest.mark.parametrize('cloud', CLOUDS)

# Results, turned back to the order given ----------------------------------------------------------


def lists(neighbourhood: Neighbourhood, k: int) -> Lists:
    """Return the neighbours of each point as given, by their indices as given."""
    index, tied = neighbourhood.nearest(k)
    order = neighbourhood.order
    given = np.empty_like(order)
    given[order] = np.arange(len(order))
    return order[index][given], tied[given]


def naive_lists(xyz: Floats, k: int) -> Lists:
    """Return those of the naive twin."""
    cloud = xyz.tolist()
    found = [naive.nearest(cloud, p, k) for p in range(len(cloud))]
    index = np.array([index for index, _ in found], np.int64).reshape(len(cloud), k)
    return index, np.array([tied for _, tied in found])


def counted(xyz: Floats) -> Floats:
    """Return coordinates as they count, which is in multiples of 2**-510 m."""
    return np.ldexp(np.rint(np.ldexp(xyz, 510)), -510)


def assert_same_lists(one: Lists, other: Lists) -> None:
    """Compare two results, to the last tie."""
    assert_array_equal(one[0], other[0])
    assert_array_equal(one[1], other[1])


def assert_exact(xyz: Floats, neighbourhood: Neighbourhood, k: int, some: int = 300) -> None:
    """Compare some rows of a large cloud with distances to all points, which numpy computes."""
    index, tied = lists(neighbourhood, k)
    for p in np.random.default_rng(0).choice(len(xyz), some, replace=False):
        dx, dy, dz = (xyz - xyz[p]).T
        squared = (dx * dx + dy * dy) + dz * dz
        squared[p] = np.inf
        near = np.flatnonzero(squared <= np.partition(squared, k)[k])
        order = near[np.argsort(squared[near], kind='stable')]
        assert_array_equal(index[p], order[:k])
        assert tied[p] == (squared[order[k]] == squared[order[k - 1]])


def assert_sound(neighbourhood: Neighbourhood) -> None:
    """Check what is promised of order, coordinates and nodes."""
    low, high, first, last, child = neighbourhood.tree
    xyz, count = neighbourhood.xyz, len(neighbourhood)
    assert_array_equal(np.sort(neighbourhood.order), np.arange(count))
    assert (first[0], last[0]) == (0, count)
    for node, one in enumerate(child):
        points = xyz[first[node] : last[node]]
        assert_array_equal(low[node], points.min(axis=0))
        assert_array_equal(high[node], points.max(axis=0))
        if one < 0:
            assert len(points) <= LEAF or np.all(low[node] == high[node])
        else:
            assert one > node
            assert len(points) > LEAF
            parts = [first[one], last[one], first[one + 1], last[one + 1]]
            assert parts == [first[node], parts[1], parts[1], last[node]]
            assert first[node] < parts[1] < last[node]
        if one < 0 and len(points) > LEAF:
            assert np.all(np.diff(neighbourhood.order[first[node] : last[node]]) > 0)
    # Every node but the root is a child, once.
    children = child[child >= 0]
    expected = np.arange(1, len(child))
    assert_array_equal(np.sort(np.concatenate([children, children + 1])), expected)


# Nearest ------------------------------------------------------------------------------------------


CASES = [(SMALL, k, k) for k in (1, 7, 20, 60, SMALL - 1)]
CASES += [(SMALL, k, 30) for k in (1, 2, 5, 12, 29)]  # whether the k-th ties is another question
CASES += [(count, min(20, count - 1), 20) for count in (2, 3, 24, 25, 26, 49, 50)]


@every_cloud
@pytest.mark.parametrize(('count', 'k', 'most'), CASES)
def test_equals_the_naive_twin(cloud: Shape, count: int, k: int, most: int) -> None:
    """The same neighbours in the same order, and the same ties, also around the size of a leaf."""
    xyz = cloud(np.random.default_rng(k), count)
    neighbourhood = Neighbourhood(xyz, most)
    assert_same_lists(lists(neighbourhood, k), naive_lists(xyz, k))
    assert_sound(neighbourhood)


HARD: list[Shape] = [scattered, sheet, grid, flat, stacks, lone_stack, outlier, uneven, rows]


@pytest.mark.parametrize(
    ('cloud', 'count', 'k'),
    [*((one, LARGE, 20) for one in HARD), (rows, 20_000, 60), (rows, 20_000, 500)],
)
def test_large_clouds(cloud: Shape, count: int, k: int) -> None:
    """Some points of many, with levels that all threads cut together; lists too long to count."""
    xyz = cloud(np.random.default_rng(5), count)
    assert_exact(xyz, Neighbourhood(xyz, k), k, 300 if count == LARGE else 30)


@pytest.mark.parametrize('positions', ['different', 'few'])
def test_all_equally_far(positions: str) -> None:
    """The middle of a sphere has more ties than a search holds; its neighbours are the first."""
    rng = np.random.default_rng(7)
    xyz = shell(rng, 20_000)
    if positions == 'different':
        square = np.arange(-100, 101) ** 2
        sphere = np.argwhere(square[:, None, None] + square[:, None] + square == 9974) - 100.0
        xyz = rng.permutation(np.append(sphere, np.zeros((1, 3)), axis=0))
    middle = int(np.flatnonzero(np.all(xyz == 0, axis=1))[0])
    index, tied = lists(Neighbourhood(xyz, 20), 20)
    others = [i for i in range(len(xyz)) if i != middle]
    assert index[middle].tolist() == others[:20]
    assert tied[middle]
    assert len(xyz) > 1000


def test_any_number_of_threads() -> None:
    """Bit for bit the same tree and lists."""
    xyz = np.concatenate(
        [cloud(np.random.default_rng(11), LARGE // 2) for cloud in (rows, lone_stack, grid)]
    )
    assert len(xyz) > 2 * SUBTREE
    one = Neighbourhood(xyz, 8, 1)
    for threads in (0, 2, 5):
        other = Neighbourhood(xyz, 8, threads)
        for a, b in zip(
            (*one.tree, *one.nearest(8)), (*other.tree, *other.nearest(8)), strict=True
        ):
            assert_array_equal(a, b)
        assert_array_equal(one.order, other.order)


def test_layout_of_memory_does_not_matter() -> None:
    """Columns, float32 and every other row of something; nothing is sorted in place."""
    xyz = sheet(np.random.default_rng(12), 2000).astype(np.float32)
    before = xyz.copy()
    expected = lists(Neighbourhood(xyz.astype(np.float64), 9), 9)
    wide = np.zeros((4000, 6))
    wide[::2, ::2] = xyz
    assert_same_lists(lists(Neighbourhood(np.asfortranarray(wide[::2, ::2]), 9), 9), expected)
    assert_same_lists(lists(Neighbourhood(wide[::2, ::2], 9), 9), expected)
    assert_same_lists(lists(Neighbourhood(xyz, 9), 9), expected)  # type: ignore[arg-type]
    assert_array_equal(xyz, before)


def test_several_threads_ask_at_once() -> None:
    """Whoever comes first builds, and all get the same."""
    xyz = scattered(np.random.default_rng(14), 20_000)
    expected = lists(Neighbourhood(xyz, 10), 10)
    neighbourhood = Neighbourhood(xyz, 10)
    with ThreadPoolExecutor(4) as callers:
        for result in callers.map(lambda _: lists(neighbourhood, 10), range(8)):
            assert_same_lists(result, expected)


# The tree -----------------------------------------------------------------------------------------


@pytest.mark.parametrize('count', [0, 1])
def test_clouds_without_neighbours(count: int) -> None:
    """None or one point: a tree of one leaf, and nobody near."""
    xyz = np.ones((count, 3))
    neighbourhood = Neighbourhood(xyz, 4)
    assert len(neighbourhood) == count
    assert_array_equal(neighbourhood.order, np.arange(count))
    assert_array_equal(neighbourhood.xyz, xyz)
    tree = neighbourhood.tree
    assert (tree.first.tolist(), tree.last.tolist(), tree.child.tolist()) == ([0], [count], [-1])
    which = np.arange(count)
    offsets, index = neighbourhood.within(which, np.full(count, np.inf))
    assert_array_equal(offsets, np.zeros(count + 1))
    assert len(index) == 0
    with pytest.raises(FilterError, match='the number of neighbours must be'):
        neighbourhood.nearest(1)
    assert len(neighbourhood.without(np.ones(count, np.bool_)).order) == 0


@every_cloud
@pytest.mark.parametrize('k', [1, 20, 60])
def test_some_lists_are_those_of_all(cloud: Shape, k: int) -> None:
    """Points in any order, some more than once, get the lists that they have among all."""
    rng = np.random.default_rng(k)
    xyz = cloud(rng, 20 * SMALL)
    neighbourhood = Neighbourhood(xyz, k)
    for count in (0, 1, 40, 3000):
        which = rng.integers(0, len(xyz), count)
        for these in (which, np.sort(which)):
            expected = neighbourhood.nearest(k).index[these]
            assert_array_equal(Neighbourhood(xyz, 1).nearest_of(these, k), expected)


# Within -------------------------------------------------------------------------------------------


@every_cloud
def test_within_equals_the_naive_twin(cloud: Shape) -> None:
    """Limits that are exactly the distance of another, which is in; some are less than 0."""
    rng = np.random.default_rng(18)
    xyz = cloud(rng, SMALL)
    neighbourhood = Neighbourhood(xyz, 20)
    which = rng.integers(0, SMALL, 200)
    points = neighbourhood.xyz.tolist()
    limits = np.array([naive.by_distance(points, p)[rng.integers(0, 80)][0] for p in which])
    limits[::10] = [-1, 0] * 10
    offsets, index = neighbourhood.within(which, limits)
    assert offsets.dtype.name == 'int64'
    assert index.dtype.name == 'int32'
    assert offsets[0] == 0
    assert offsets[-1] == len(index)
    for i, (p, limit) in enumerate(zip(which, limits, strict=True)):
        assert index[offsets[i] : offsets[i + 1]].tolist() == naive.within(points, p, limit)


# Without ------------------------------------------------------------------------------------------


@every_cloud
@pytest.mark.parametrize('share', [0.0, 0.004, 0.05, 0.3, 0.9])
@pytest.mark.parametrize('searched', [False, True])
def test_without_equals_a_new_neighbourhood(
    cloud: Shape,
    share: float,
    searched: bool,  # noqa: FBT001
) -> None:
    """Several removals one after the other; lists that were searched before, and not."""
    rng = np.random.default_rng(21)
    xyz = cloud(rng, 1500)
    neighbourhood = Neighbourhood(xyz, 12)
    if searched:
        neighbourhood.nearest(12)
    for _ in range(4):
        rejected = rng.uniform(size=len(xyz)) < share
        xyz, neighbourhood = xyz[~rejected], neighbourhood.without(rejected)
        assert len(neighbourhood) == len(xyz)
        assert_sound(neighbourhood) if len(xyz) > 0 else None
        assert_array_equal(neighbourhood.xyz, counted(xyz)[neighbourhood.order])
        k = min(12, len(xyz) - 1)
        if k < 1:
            break
        assert_same_lists(lists(neighbourhood, k), lists(Neighbourhood(xyz, 12), k))


def test_without_where_hardly_any_are_left() -> None:
    """One point less at a time, until there are fewer than neighbours were asked for."""
    xyz = scattered(np.random.default_rng(22), 16)
    neighbourhood = Neighbourhood(xyz, 12)
    for _ in range(14):
        neighbourhood.nearest(min(12, len(xyz) - 1))
        rejected = np.arange(len(xyz)) == len(xyz) // 2
        xyz, neighbourhood = xyz[~rejected], neighbourhood.without(rejected)
        k = min(12, len(xyz) - 1)
        assert_same_lists(lists(neighbourhood, k), lists(Neighbourhood(xyz, 12), k))


def test_without_keeps_what_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of lists on a grid of its own far away, none is searched again."""
    rng = np.random.default_rng(23)
    near, far = scattered(rng, 500), scattered(rng, 500) + 1000
    neighbourhood = Neighbourhood(np.concatenate([near, far]), 10)
    neighbourhood.nearest(10)
    rows: list[Index] = []
    search = Neighbourhood._search

    def watched(self: Neighbourhood, nearest: Nearest, row: Index) -> None:
        rows.append(row)
        search(self, nearest, row)

    monkeypatch.setattr(Neighbourhood, '_search', watched)
    rejected = np.arange(1000) == 7
    left = neighbourhood.without(rejected)
    left.nearest(10)
    assert len(rows) == 1
    searched = left.order[rows[0] >= 0]
    index, _ = lists(neighbourhood, 10)
    held = np.flatnonzero((index == 7).any(axis=1))
    assert_array_equal(np.sort(searched), held - (held > 7))
    assert 0 < len(held) < 40


# Refused ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('xyz', 'message'),
    [
        (np.zeros(3), r'points must be \(N, 3\)'),
        (np.zeros((5, 2)), r'points must be \(N, 3\)'),
        (np.array([[0, 0, 0], [1, np.nan, 0]]), 'coordinates must be finite and at most'),
        (np.array([[0, 0, 0], [1, np.inf, 0]]), 'coordinates must be finite and at most'),
        (np.array([[0, 0, 0], [1, 0, -2e150]]), r'got -2e\+150'),
    ],
)
def test_wrong_points_are_refused(xyz: Floats, message: str) -> None:
    """Wrong shapes, missing returns, and coordinates whose squares overflow."""
    with pytest.raises(FilterError, match=message):
        Neighbourhood(xyz, 1)


@pytest.mark.parametrize('k', [0, 5, 6, -1])
def test_wrong_numbers_of_neighbours_are_refused(k: int) -> None:
    """None, more than were asked for at first, more than there are others."""
    neighbourhood = Neighbourhood(np.eye(3).repeat(2, axis=0), 4)
    with pytest.raises(FilterError, match=f'must be 1 to 4, got {k}'):
        neighbourhood.nearest(k)


def test_largest_coordinates() -> None:
    """Just what is allowed: differences and squares stay finite."""
    large = neighbours.LARGEST_M
    xyz = np.array([[large, large, large], [-large, -large, -large], [0, 0, 0]])
    assert lists(Neighbourhood(xyz, 2), 2)[0].tolist() == [[2, 1], [2, 0], [0, 1]]


# Time and memory ----------------------------------------------------------------------------------


@pytest.mark.timeout(60)
@pytest.mark.parametrize('cloud', [one_place, stacks, lone_stack, halving, uneven, outlier, line])
def test_nothing_takes_quadratic_time(cloud: Shape) -> None:
    """200 000 points that are hard to separate: after some lopsided cuts the median is taken."""
    neighbourhood = Neighbourhood(cloud(np.random.default_rng(25), 200_000), 20)
    assert neighbourhood.nearest(20).index.shape == (200_000, 20)
    level = np.zeros(len(neighbourhood.tree.child), np.int64)
    for node, child in enumerate(neighbourhood.tree.child.tolist()):  # parents come first
        if child >= 0:
            level[child : child + 2] = level[node] + 1
    assert level.max() < 60


@pytest.mark.timeout(60)
@pytest.mark.parametrize('size', [1e-310, 1e-200, 1e-161, 1e-155])
def test_distances_that_underflow_take_no_longer(size: float) -> None:
    """20 000 points so near each other; a search through all pairs takes 1000 × as long."""
    xyz = scattered(np.random.default_rng(27), 20_000)
    searches = [partial(_search, factor * xyz) for factor in (1.0, size)]
    times = [min(repeat(one, timer=thread_time, number=1, repeat=3)) for one in searches]
    assert times[1] < 10 * times[0]


def _search(xyz: Floats) -> None:
    Neighbourhood(xyz, 20, 1).nearest(20)


@pytest.mark.slow
def test_memory() -> None:
    """At its peak, building and searching need at most 200 bytes a point for 20 neighbours."""
    program = """
import numpy as np
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

def peak():  # bytes, ever
    with open('/proc/self/status') as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith('VmHWM'))

def search(xyz):
    return Neighbourhood(xyz, 20, 2).nearest(20)

search(np.random.default_rng(0).normal(size=(5000, 3)))
xyz = np.random.default_rng(1).uniform(0, 100, (1_000_000, 3)) * [1, 1, 0.001]
before = peak()
search(xyz)
print((peak() - before) / len(xyz))
"""
    result = subprocess.run([sys.executable, '-c', program], check=True, capture_output=True)
    assert 80 < float(result.stdout) < 200
