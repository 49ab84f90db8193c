# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the clouds of the papers are made of: chosen shots, clusters, range images, a surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors import hierarchical
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.results.papers import sotoodeh_hod
from lidar_outlier_lab.simulation.papers import surface_truth, tripod
from lidar_outlier_lab.simulation.papers.sotoodeh_clusters import FAR, NEAR, simulate
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive
from lidar_outlier_lab.simulation.world.drive import Block, Returns, about, exactly, gather, merge
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner

GOOD, SNOW, MIXED = Cause.GOOD, Cause.SNOW, Cause.MIXED


# Shots chosen so that a cloud has the outliers that it is to have ---------------------------------


def returns(shots: list[int], labels: list[Cause]) -> Returns:
    """Make points of shots, with x = shot."""
    points = np.zeros(len(shots), ProfileScanner().point)
    points['x'], points['label'] = shots, labels
    return Returns(np.array(shots, np.int64), points)


# Shots 0 to 9; 3 and 4 see the sky, 6 a silhouette. Five are disturbed, 2 and 4 most likely.
CLEAN = returns([0, 1, 2, 5, 6, 7, 8, 9], [GOOD, GOOD, GOOD, GOOD, MIXED, GOOD, GOOD, GOOD])
SPOILT = returns([2, 4, 5, 6, 9], [SNOW] * 5)
BLOCK = Block(CLEAN, SPOILT, np.array([0.1, 0.2, 0.5, 0.3, 0.9]))


def test_merge() -> None:
    """Disturbed shots take the place of what they had measured, in order."""
    shot, points = merge(CLEAN, SPOILT)
    assert shot.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert points['x'].tolist() == shot.tolist()
    assert points['label'].tolist() == [0, 0, SNOW, SNOW, SNOW, SNOW, 0, 0, SNOW]


@pytest.mark.parametrize(
    ('points', 'outliers', 'shots'),
    [
        (8, 1, []),  # the silhouette alone
        (8, 3, [2, 5]),  # 4 would be one point more, 6 is an outlier already
        (8, 4, [2, 5, 9]),
        (4, 1, [2]),
        (4, 2, [2, 5]),
    ],
)
def test_exactly(points: int, outliers: int, shots: list[int]) -> None:
    """The first points stay; by lot as many of the good ones as said become outliers."""
    shot, cloud = exactly(BLOCK, points, outliers)
    assert shot.tolist() == CLEAN.shot[:points].tolist()
    assert cloud['x'].tolist() == shot.tolist()
    assert shot[cloud['label'] == SNOW].tolist() == shots
    assert np.count_nonzero(cloud['label']) == outliers


@pytest.mark.parametrize(
    ('share', 'shots'),
    [
        (1 / 8, []),
        (3 / 9, [2, 4]),
        (0.31, [2, 4]),  # nearer than 2 of 8
        (4 / 9, [2, 4, 5, 6]),  # 6 changes no count, and 5 comes after it
        (5 / 9, [2, 4, 5, 6, 9]),
    ],
)
def test_about(share: float, shots: list[int]) -> None:
    """Shots at the sky make points that would not be; the share comes as near as it can."""
    shot, cloud = about(BLOCK, share)
    assert shot[cloud['label'] == SNOW].tolist() == shots


def test_shares_that_cannot_be_are_refused() -> None:
    """Below what the scene itself makes, or above all that were disturbed."""
    for points, outliers in ((8, 0), (8, 5), (4, 3)):
        with pytest.raises(FilterError, match=r'the share must be from .* here, got'):
            exactly(BLOCK, points, outliers)
    for share in (0.1, 0.6):
        with pytest.raises(FilterError, match=r'the share must be from 0.125000 to 0.555556 here'):
            about(BLOCK, share)


def test_a_drive_is_cast_until_there_are_points_enough() -> None:
    """The share done is said; a drive with too few points is refused."""
    drive = replace(demo_drive(), lines=100)
    done: list[float] = []
    some, whole = gather(drive, 15_000, done.append).clean, gather(drive).clean
    assert done[-1] == 1.0
    assert 15_000 <= len(some.shot) < 30_000 < len(whole.shot)
    np.testing.assert_array_equal(whole.points[: len(some.shot)], some.points)
    with pytest.raises(FilterError, match='the points of the drive must be at least 90000, got'):
        gather(drive, 90_000)


# Clusters of 656 points, and the steps on their picture -------------------------------------------


@pytest.mark.parametrize('seed', range(3))
def test_clusters(seed: int) -> None:
    """656 points, 84 of them outliers, single ones where they should be; a seed is a scene."""
    xyz, outlier = simulate(seed)
    assert (xyz.shape, int(outlier.sum())) == ((656, 3), 84)
    gap = np.linalg.norm(xyz[outlier][:, None] - xyz[~outlier], axis=2).min(axis=1)
    assert gap[:36].min() > FAR[0]
    assert NEAR[0] < gap[36:40].min()
    assert gap[36:40].max() < NEAR[1]
    np.testing.assert_array_equal(xyz, simulate(seed)[0])
    assert not np.array_equal(xyz, simulate(seed + 1)[0])


def test_course() -> None:
    """Each step is made of the one before, and the last one is the result."""
    (xyz, _), parameters = simulate(0), Hierarchical()
    *edges, phase = sotoodeh_hod.course(xyz, parameters)
    assert len(edges[0]) == len(xyz) - 1
    tree, pruned_tree, graph, pruned_graph = (
        {(min(p, q), max(p, q)) for p, q in ends.tolist()} for ends in edges
    )
    assert pruned_tree < tree
    assert pruned_graph < graph
    rough = np.flatnonzero(phase != 1)
    # A minimum spanning tree is part of the Gabriel graph.
    assert {edge for edge in pruned_tree if edge[0] in rough} < graph
    assert {p for edge in graph for p in edge} == set(rough.tolist())
    clean = hierarchical.detect(xyz, parameters)
    np.testing.assert_array_equal(phase, clean.phase)


# Scans from a tripod, and distances from a surface model ------------------------------------------


def test_pixels_are_directions() -> None:
    """Row 0 points up, the middle column ahead; every shot in a room has a point."""
    room = tripod.room(1, rows=60, columns=360)
    assert len(room.points) == 60 * 360
    from_scanner = room.xyz - [-1.2, 0.0, 1.3]
    elevation = room.image(np.arcsin(from_scanner[:, 2] / np.linalg.norm(from_scanner, axis=1)))
    np.testing.assert_allclose(elevation[0], np.radians(30), atol=0.01)
    np.testing.assert_allclose(elevation[-1], np.radians(-30), atol=0.01)
    azimuth = room.image(np.arctan2(from_scanner[:, 1], from_scanner[:, 0]))
    assert abs(azimuth[30, 180]) < 0.03
    assert azimuth[30, 90] == pytest.approx(np.pi / 2, abs=0.03)


def test_a_street_from_three_positions() -> None:
    """Flakes are in every scan; the same seed gives the same."""
    scans, again = (tripod.facades(3, rows=40, columns=120) for _ in range(2))
    assert len(scans) == 3
    for one, other in zip(scans, again, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        assert Cause.SNOW in one.points['label']


def to_triangle(p: Floats, corners: Floats) -> float:
    """Measure the distance from a point to a triangle, by its plane and edges."""
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    foot = p - (p - a) @ normal / (normal @ normal) * normal
    edges = [(a, b), (b, c), (c, a)]
    if all(np.cross(v - u, foot - u) @ normal >= 0 for u, v in edges):
        return float(np.linalg.norm(p - foot))
    along = [np.clip((p - u) @ (v - u) / ((v - u) @ (v - u)), 0, 1) for u, v in edges]
    return min(
        float(np.linalg.norm(p - u - t * (v - u))) for (u, v), t in zip(edges, along, strict=True)
    )


def test_distances_from_a_surface() -> None:
    """They are those to the nearest triangle, too large by the step of the samples at most."""
    rng = np.random.default_rng(1)
    height = rng.uniform(0, 3, (4, 5))
    triangles = []
    for i, j in np.ndindex(3, 4):
        cells = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
        p, q, r, s = (np.array([a, b, height[a, b]], float) for a, b in cells)
        triangles += [np.array([p, q, r]), np.array([p, r, s])]
    points = rng.uniform([0, 0, -2], [3, 4, 6], (60, 3))
    expected = np.array([min(to_triangle(p, one) for one in triangles) for p in points])
    found = surface_truth.distances(points, height, 1.0)
    assert (found >= expected - 1e-12).all()
    assert (found <= np.hypot(expected, surface_truth.FINE / np.sqrt(2)) + 1e-12).all()
