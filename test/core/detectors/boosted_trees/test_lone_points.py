# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Lone points of whole clouds are found where every hundredth point is one."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.detectors.boosted_trees.features import SURVEY_REASON_NAMES
from lidar_outlier_filter.core.detectors.boosted_trees.lone_points import part
from lidar_outlier_filter.core.detectors.boosted_trees.methods import contributions
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import K
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.filter import FilterParameters

SURVEY = {'boosted_trees.sensor': 'survey'}


def town_map(spacing: float, side: float = 25.0, seed: int = 3) -> Floats:
    """Make a map of ground, walls, crowns and a wire, metres; the wire comes last."""
    rng = np.random.default_rng(seed)

    def face(width: float, height: float) -> Floats:
        some: Floats = rng.uniform((0, 0), (width, height), (int(width * height / spacing**2), 2))
        return some

    def crown(x: float, y: float) -> Floats:
        some = rng.uniform(-1.0, 1.0, (int(25 / spacing**2), 3))
        inside: Floats = 1.5 * some[(some**2).sum(axis=1) < 1] + np.array([x, y, 5.0])
        return inside

    ground = np.insert(face(side, side), 2, 0.0, axis=1)
    walls = [np.insert(face(8.0, 6.0), 1, y, axis=1) for y in (6.0, 14.0)]
    crowns = [crown(x, y) for x, y in rng.uniform(2.0, side - 2.0, (4, 2)).tolist()]
    wire = np.arange(0.0, side, 1.2 * spacing)[:, None] * [1, 0, 0] + (0.0, 20.0, 9.0)
    parts = [ground, *walls, *crowns, wire]
    xyz: Floats = np.concatenate(parts) + rng.normal(0, 0.01, (sum(map(len, parts)), 3))
    return xyz


def with_lone(good: Floats, share: float, off: float = 1.5, seed: int = 4) -> tuple[Floats, Bools]:
    """Add lone points, so far off every other; return which they are."""
    rng, tree = np.random.default_rng(seed), cKDTree(good)
    count = round(share / (1 - share) * len(good))
    some = rng.uniform(good.min(axis=0), good.max(axis=0), (20 * count, 3))
    lone = some[tree.query(some)[0] > off][:count]
    assert len(lone) == count
    return np.concatenate([good, lone]), np.arange(len(good) + count) >= len(good)


@pytest.mark.parametrize('spacing', [0.1, 0.15, 0.2])
@pytest.mark.parametrize('share', [0.001, 0.005, 0.01, 0.02])
def test_lone_points_are_found_however_many(share: float, spacing: float) -> None:
    """Up to every fiftieth point is lone; surfaces, crowns and wires lose next to nothing."""
    xyz, is_lone = with_lone(town_map(spacing), share)
    outlier = detect_outliers(xyz).outlier
    assert outlier[is_lone].mean() > 0.95
    assert (
        outlier[~is_lone].mean() < 0.002
    )  # the trees lose up to 0.0036 of it where none is taken out


def test_sparse_surfaces_and_wires_are_kept() -> None:
    """Ground that thins out with distance, and a wire as sparse as lone points, are kept."""
    rng = np.random.default_rng(5)
    radius, angle = np.exp(rng.uniform(0.0, np.log(60.0), 30_000)), rng.uniform(0, 7, 30_000)
    ground = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.01 * radius], axis=1)
    wire = np.arange(-30.0, 30.0, 0.8)[:, None] * [1, 0, 0] + (0.0, 4.0, 8.0)
    xyz = np.concatenate([ground, wire])
    assert np.count_nonzero(of_part(xyz)) < 10


def of_part(xyz: Floats) -> Bools:
    """Return which points of a cloud without copies are lone."""
    hood = Neighbourhood(xyz, K)
    found = part(hood, hood.order, measure_floor(xyz, np.arange(len(xyz))))
    is_lone = np.zeros(len(xyz), np.bool_)
    is_lone[found.lone] = True
    assert (found.isolation > 1).all()
    assert sorted([*found.rest, *found.lone]) == [*range(len(xyz))]
    np.testing.assert_array_equal(found.hood.xyz, xyz[found.rest])
    return is_lone


def test_against_loops() -> None:
    """In a square that holds all, a lone point has no dense point within five typical distances."""
    rng = np.random.default_rng(6)
    xyz = np.concatenate([rng.uniform(0, 1, (700, 3)) * (4, 4, 0.02), rng.uniform(0, 4, (60, 3))])
    distance = np.sort(np.sqrt(((xyz[:, None] - xyz) ** 2).sum(axis=2)), axis=1)
    radius = distance[:, K]
    around = measure_floor(xyz, np.arange(len(xyz)))
    reach = 5.0 * max(around.typical, float(np.sort(radius)[(len(xyz) - 1) // 2]))
    expected = []
    for p in range(len(xyz)):
        away = np.sqrt(((xyz - xyz[p]) ** 2).sum(axis=1))
        together = xyz[np.argsort(away, kind='stable')[: K + 1]]
        expected.append(radius[p] > reach and not (on_line(together) or on_ground(together)))
    has_company = ~np.array(expected)
    for p in np.flatnonzero(~has_company).tolist():
        away = np.sqrt(((xyz - xyz[p]) ** 2).sum(axis=1))
        expected[p] = not (has_company & (away <= reach)).any()
    assert 10 < sum(expected) < 60
    np.testing.assert_array_equal(of_part(xyz), expected)


def on_line(together: Floats) -> bool:
    """Return whether points lie on a line."""
    squares = np.linalg.eigvalsh(np.cov(together.T))
    return bool(np.sqrt(squares[1] / squares[2]) < 0.15)


def on_ground(together: Floats) -> bool:
    """Return whether points lie on a level plane."""
    squares, axes = np.linalg.eigh(np.cov(together.T))
    return bool(np.sqrt(squares[0] / squares[1]) < 0.07 and abs(axes[2, 0]) > 0.8)


def test_ground_below_a_crown_is_kept() -> None:
    """Of fifty returns in a forest one is of the ground, 15 m below all others."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, 100, (2, 40_000))
    ground = rng.random(40_000) < 0.02
    crown = 15 + 2 * np.sin(x / 4) * np.cos(y / 5) - rng.exponential(1.0, 40_000)
    height = np.where(ground, rng.normal(0, 0.05, 40_000), crown) + 0.02 * x
    assert detect_outliers(np.stack([x, y, height], axis=1)).outlier[ground].mean() < 0.02


def test_reasons_and_contributions() -> None:
    """How far apart a lone point is, is what adds to its log-odds, copies of it too."""
    xyz, is_lone = with_lone(town_map(0.25), 0.01)
    xyz, is_lone = np.append(xyz, xyz[-9:], axis=0), np.append(is_lone, is_lone[-9:])
    zeros, parameters = np.zeros(len(xyz), np.int64), FilterParameters().changed({'scores': True})
    points = Points(xyz, zeros, zeros, np.ones(len(xyz), np.bool_))
    added = contributions(DetectorInput(points, parameters, whole=True), parameters, is_lone)
    most = added.added[added.names.index('rare')]
    assert (most == added.added.max(axis=0)).mean() > 0.9
    found = detect_outliers(xyz, parameters={**SURVEY, 'scores': True})
    number = {name: key for key, name in SURVEY_REASON_NAMES.items()}['rare']
    assert (found.reason[is_lone] == number).mean() > 0.9


def test_streams_are_judged_by_trees_alone() -> None:
    """In a block of a stream, far points are sparse: none is taken out."""
    xyz, is_lone = with_lone(town_map(0.15), 0.02)
    zeros, parameters = np.zeros(len(xyz), np.int64), FilterParameters().changed(SURVEY)
    points = Points(xyz, zeros, zeros, np.ones(len(xyz), np.bool_))
    every = is_lone | True
    odds = [
        contributions(DetectorInput(points, parameters, whole=whole), parameters, every).added
        for whole in (False, True)
    ]
    assert (np.count_nonzero(odds[0], axis=0) > 1).all()
    assert (np.count_nonzero(odds[1], axis=0) == 1).sum() > 0.8 * is_lone.sum()
