# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hierarchical outlier detection: equal to the naive twin, and to nothing but the points."""

import numpy as np
import pytest
from helpers.shapes import ball, circle_with_axis, exponential
from naive import hierarchical as naive
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_filter.core.detectors.hierarchical import ClusterOutcome, detect, gabriel_graph
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

RNG = np.random.default_rng(5)
LINE = np.stack([np.arange(60.0), np.zeros(60), np.zeros(60)], axis=1)


def scene(seed: int, scale: float = 1.0) -> Floats:
    """Two surfaces of different density, two clusters of outliers, and single ones."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform(0, [4, 4, 0.02], (110, 3))
    wall = rng.uniform(0, [0.01, 2, 1.5], (70, 3)) + np.array([4.5, 1.0, 0.2])
    near = rng.normal([1, 1, 0.8], 0.05, (6, 3))
    far = rng.normal([9, 9, 3], 0.1, (7, 3))
    single = rng.uniform(-6, 8, (12, 3))
    return scale * np.concatenate([ground, wall, near, far, single])


def street(seed: int, count: int) -> Floats:
    """Make a road between two facades, 8 mm noise, and a few points in the air."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, count / 500, count)
    side = rng.integers(-1, 2, count)
    across, up = rng.uniform(-3, 3, count), rng.uniform(0, 6, count)
    wall = np.abs(side) * up
    cloud = np.stack([x, np.where(side == 0, across, 4.0 * side), wall], axis=1)
    cloud += rng.normal(0, 0.008, cloud.shape)
    air = np.arange(count) % 97 == 0
    cloud[air] = rng.uniform([0, -4, 0.2], [count / 500, 4, 6], (np.count_nonzero(air), 3))
    return cloud


def grid(*steps: int) -> Floats:
    """Put points on a grid of so many positions along each axis."""
    axes = np.meshgrid(*(np.arange(float(n)) for n in steps), indexing='ij')
    return np.stack([axis.ravel() for axis in axes], axis=1)


def settings(min_cluster: int, confidence: float = 0.99, local: float = 0.95) -> Hierarchical:
    """Set all there is to set."""
    return Hierarchical(confidence, local, min_cluster)


def assert_like_naive(xyz: Floats, parameters: Hierarchical) -> ClusterOutcome:
    """Compare with the naive twin."""
    outcome = detect(xyz, parameters)
    expected = naive.detect(
        xyz.tolist(),
        parameters.global_confidence,
        parameters.local_confidence,
        parameters.min_cluster,
    )
    np.testing.assert_array_equal(outcome.phase, expected.phase)
    np.testing.assert_array_equal(outcome.cluster, expected.cluster)
    np.testing.assert_array_equal(outcome.score, expected.score)
    np.testing.assert_array_equal(outcome.score > 1, outcome.phase > 0)
    return outcome


# Equal to the naive twin -----------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(4))
def test_equals_naive(seed: int) -> None:
    """On surfaces with outliers, and with intervals so narrow that both phases reject many."""
    xyz = scene(seed)
    outcome = assert_like_naive(xyz, settings(12))
    assert set(outcome.phase.tolist()) >= {0, 1}
    outcome = assert_like_naive(xyz, settings(8, 0.6, 0.4))
    assert set(outcome.phase.tolist()) == {0, 1, 2}


DEGENERATE = {
    'nothing': np.empty((0, 3)),
    'one point': np.ones((1, 3)),
    'two points': LINE[:2],
    'three points': LINE[:3],
    'four points': np.eye(4, 3),
    'all coincide': np.full((40, 3), 7.25),
    'two positions': np.repeat(LINE[:2], 20, axis=0),
    'negative zero': np.array([[0.0, 0.0, 0.0], [-0.0, 0.0, -0.0], [1.0, 0.0, 0.0]]),
    'a line': LINE,
    'a line with a hole': LINE[np.r_[:25, 35:60]],
    'a line across': np.random.default_rng(1).normal(size=(80, 1)) * [1.0, 2.0, -0.5],
    'a plane': np.random.default_rng(2).normal(size=(120, 3)) * [1.0, 1.0, 0.0],
    'a slanting plane': np.random.default_rng(3).normal(size=(120, 2)) @ [[1, 2, 3.0], [3, -1, 2]],
    'a square grid': grid(12, 12, 1),
    'a cubic grid': grid(5, 5, 5),
    'a grid with holes': grid(6, 6, 6)[np.random.default_rng(4).random(216) < 0.5],
    'a circle': np.stack([np.cos(np.arange(50)), np.sin(np.arange(50)), np.zeros(50)], axis=1),
    'a sphere and its centre': np.append(ball(RNG, 100), np.zeros((1, 3)), axis=0),
    'two crossing lines': np.concatenate([LINE - LINE[30], LINE[:, [1, 0, 2]] - [0, 30, -1.0]]),
}


@pytest.mark.parametrize('least', [1, 2, 5, 30])
@pytest.mark.parametrize('name', DEGENERATE)
def test_equals_naive_on_degenerate_clouds(name: str, least: int) -> None:
    """What Qhull would refuse or drop has a result."""
    assert_like_naive(DEGENERATE[name], settings(least))


# The graphs ------------------------------------------------------------------------------------


def given(neighbourhood: Neighbourhood, ends: NDArray[np.int32]) -> set[tuple[int, int]]:
    """Edges by the indices of the points as given, each once."""
    pairs = np.sort(neighbourhood.order[ends], axis=1)
    edges = {(int(p), int(q)) for p, q in pairs}
    assert len(edges) == len(ends)
    return edges


GRAPHS = {
    **DEGENERATE,
    # Houses see each other, so that edges are long and short.
    'a street': np.round(street(0, 250), 3),
    'a street, far off': np.round(street(1, 250), 3) + 5e6,
    # Points hide each other badly.
    'an axis': circle_with_axis(RNG, 600),
    'an exponential line': exponential(RNG, 600),
}


@pytest.mark.parametrize('name', sorted(GRAPHS.keys() - {'nothing'}))
def test_gabriel_graph_equals_naive(name: str) -> None:
    """Edge for edge, points on the ball included."""
    xyz = np.unique(GRAPHS[name], axis=0)
    neighbourhood = Neighbourhood(xyz, 1)
    graph = gabriel_graph(neighbourhood)
    assert given(neighbourhood, graph.ends) == set(naive.gabriel_graph(list(map(tuple, xyz))))


@pytest.mark.parametrize('offset', [0.0, 3e6])
def test_points_on_the_ball_but_for_rounding(offset: float) -> None:
    """A lone point on the ball is inside exactly if its own angle, as computed, is obtuse.

    Others crowd behind both ends of the diameter, so that it has a box of its own.
    """
    rng = np.random.default_rng(8)
    inside = 0
    for _ in range(200):
        along, to_third = rng.normal(size=(2, 3))
        along /= np.linalg.norm(along)
        to_third /= np.linalg.norm(to_third)
        crowd = rng.uniform(-0.05, 0.05, (60, 3))
        crowd += np.where(np.arange(60) < 30, 1.2, -1.2)[:, None] * along
        ends = np.array([along, -along, to_third])
        xyz = 0.7 * (np.concatenate([ends, crowd]) + rng.uniform(0, 5, 3)) + offset
        (a, b, c), (d, e, f) = xyz[0] - xyz[2], xyz[1] - xyz[2]
        obtuse = bool((a * d + b * e) + c * f < 0)
        inside += obtuse
        neighbourhood = Neighbourhood(xyz, 1)
        edges = given(neighbourhood, gabriel_graph(neighbourhood).ends)
        assert ((0, 1) in edges) == (not obtuse)
    assert 50 < inside < 150


# What it says ----------------------------------------------------------------------------------


@pytest.mark.parametrize('step', [0.1, 1 / 3, 1e-3])
def test_roundings_cut_nothing(step: float) -> None:
    """Points in equal steps, whose lengths differ by rounding, are one cluster in both phases."""
    line = np.zeros((500, 3), np.float32)
    line[:, 0] = 100 + step * np.arange(500)
    for xyz in (line.astype(np.float64), step * grid(20, 25, 1) + [1e5, 1e6, 0]):
        if step == 1e-3:  # float32 has no such steps at 100 m: some are 4 % longer
            xyz = step * grid(500, 1, 1)  # noqa: PLW2901
        assert detect(xyz, Hierarchical()).cluster.tolist() == [500] * 500
