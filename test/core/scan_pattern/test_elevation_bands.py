# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Bands of elevation: as high as their points are apart, and in whatever order points come."""

from itertools import pairwise
from statistics import median

import numpy as np
import pytest

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.boosted_trees.methods import find_either
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.recovered_rings import HEIGHTS, in_bands

FREE = {'boosted_trees.sensor': 'free'}


def scattered(count: int, seed: int = 1, stray: float = 0.0) -> Floats:
    """Look into a hall, in directions without any order; some beams end before they reach it."""
    rng = np.random.default_rng(seed)
    azimuth, up = rng.uniform(-0.5, 0.5, count), rng.uniform(-0.3, 0.3, count)
    direction = np.column_stack(
        [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)]
    )
    distance = 12.0 / direction[:, 0] + 0.01 * rng.standard_normal(count)
    few = np.arange(count) < stray * count
    return direction * np.where(few, rng.uniform(2.0, 10.0, count), distance)[:, None]


def points_of(xyz: Floats) -> Points:
    """Give points times, and one line."""
    count = len(xyz)
    return Points(xyz, np.arange(count), np.zeros(count, np.int64), np.ones(count, np.bool_))


def apart(xyz: Floats, height: float) -> float:
    """Return the median angle between neighbours in bands of a height, by plain loops."""
    bands: dict[int, list[tuple[float, float]]] = {}
    for x, y, z in xyz.tolist():
        up = np.arctan2(z, np.hypot(x, y))
        bands.setdefault(int(np.floor(up / height)), []).append((np.arctan2(y, x), np.cos(up)))
    steps = []
    for one in bands.values():
        one.sort()
        steps += [(b[0] - a[0]) * a[1] for a, b in pairwise(one)]
    return median(steps) if steps else np.inf


@pytest.mark.parametrize('count', [300, 2000, 9000])
def test_height(count: int) -> None:
    """Bands are the lowest whose points are no farther apart than the bands are high."""
    xyz = scattered(count)
    lines = in_bands(points_of(xyz)).line
    up = np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1]))
    (chosen,) = (k for k, h in enumerate(HEIGHTS) if np.array_equal(np.floor(up / h), lines))
    assert apart(xyz, HEIGHTS[chosen]) <= HEIGHTS[chosen]
    assert apart(xyz, HEIGHTS[chosen - 1]) > HEIGHTS[chosen - 1]


def test_strays_are_found() -> None:
    """What hangs before a wall is rejected, of the wall nothing; lines and times do not count."""
    xyz = scattered(6000, stray=0.05)
    whole = detect_outliers(xyz, parameters=FREE)
    assert whole.outlier[:300].mean() > 0.9
    assert whole.outlier[300:].mean() < 0.001
    rng = np.random.default_rng(5)
    t, line = rng.permutation(6000), rng.integers(0, 4, 6000)
    said = detect_outliers(xyz, t=t, line=line, parameters=FREE)
    np.testing.assert_array_equal(said.score, whole.score)


def test_few_points() -> None:
    """A handful of points has no bands, and is judged by neighbours."""
    assert find_either(points_of(scattered(10)), 'free') is None
    assert not detect_outliers(scattered(10), parameters=FREE).outlier.any()


def test_a_point_at_the_sensor_changes_no_band() -> None:
    """What is so near that its square is 0 has no say in how high bands are."""
    xyz = scattered(2000)
    expected = in_bands(points_of(xyz)).line
    found = in_bands(points_of(np.concatenate([xyz, [[1e-200, 0.0, 0.0]]]))).line
    assert len(np.unique(expected)) > 10
    np.testing.assert_array_equal(found[:-1], expected)


def test_returns_at_the_sensor_have_no_elevation() -> None:
    """Where squares of distances are 0 there is no direction, and no warning."""
    xyz = scattered(3000) * 1e-170
    assert not detect_outliers(xyz, parameters=FREE).outlier.any()
