# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The elevation test: equal to the naive twin, and to nothing but the points."""

from dataclasses import replace

import numpy as np
import pytest
from naive import elevation as naive

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors import elevation
from lidar_outlier_filter.core.detectors.builtin import Elevation
from lidar_outlier_filter.core.detectors.elevation import detect
from lidar_outlier_filter.errors import FilterError

SIDES = ('both', 'low', 'high')


def hills(seed: int, count: int = 300) -> Floats:
    """Gentle terrain with gross errors: near ones above and below, and far ones."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, [40, 30, 0.1], (count, 3))
    xyz[:, 2] += 2 * np.sin(xyz[:, 0] / 7) + 0.05 * xyz[:, 1]
    xyz[::61, 2] += 3.0
    xyz[7::83, 2] -= 2.5
    xyz[20, 2], xyz[21, 2], xyz[22, 2] = 80.0, -45.0, 95.0
    return xyz


def assert_like_naive(xyz: Floats, parameters: Elevation, *, on_map: bool = True) -> Floats:
    """Compare with the naive twin, but for roundings."""
    score = detect(xyz, parameters, on_map=on_map)
    expected = np.array(
        naive.scores(
            xyz.tolist(),
            parameters.k,
            parameters.multiplier,
            parameters.sides,
            parameters.gap,
            elevation.SHARE,
            elevation.SIGMA_FLOOR_M,
            'map' if on_map else 'space',
        )
    )
    np.testing.assert_allclose(score, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(score > 1, expected > 1)
    return score


# Equal to the naive twin -----------------------------------------------------------------------


@pytest.mark.parametrize('sides', SIDES)
@pytest.mark.parametrize('seed', range(2))
def test_equals_naive(seed: int, sides: str) -> None:
    """With and without the histogram, few neighbours and many."""
    for parameters in (
        Elevation(sides=sides),
        Elevation(sides=sides, gap=0.0, k=7, multiplier=2.0),
        Elevation(sides=sides, k=1, gap=0.5),
    ):
        score = assert_like_naive(hills(seed), parameters)
        assert np.count_nonzero(score > 1) > 0


def flat(columns: int, rows: int) -> Floats:
    """Make a regular grid, seen from above, with uneven elevations."""
    x, y = np.meshgrid(np.arange(float(columns)), np.arange(float(rows)))
    z = np.random.default_rng(columns).normal(size=x.size)
    return np.stack([x.ravel(), y.ravel(), z], axis=1)


DEGENERATE = {
    'nothing': np.empty((0, 3)),
    'one point': np.ones((1, 3)),
    'two points': np.array([[0.0, 0, 0], [1, 1, 99]]),
    'all coincide': np.full((40, 3), 7.25),
    'one column': np.random.default_rng(1).normal(size=(90, 3)) * [0, 0, 1],
    'columns': np.repeat(flat(5, 4), 12, axis=0) + np.arange(240)[:, None] * [0, 0, 0.01],
    'columns of various heights': np.concatenate(
        [np.repeat(row[None], n, axis=0) for n, row in enumerate(flat(5, 4), 1)]
    )
    + np.arange(210)[:, None] * [0, 0, 0.003],
    'a grid': flat(14, 12),
    'a line': flat(100, 1),
    'a line with a column': np.concatenate([flat(60, 1), np.tile([[70.0, 0, 1]], (50, 1))]),
}


@pytest.mark.parametrize('k', [1, 4, 30])
@pytest.mark.parametrize('name', DEGENERATE)
def test_equals_naive_on_degenerate_clouds(name: str, k: int) -> None:
    """Ties count, and coincident points, however many there are."""
    for sides in SIDES:
        assert_like_naive(DEGENERATE[name], Elevation(k=k, sides=sides, gap=1.0))
    assert_like_naive(DEGENERATE[name], Elevation(k=k, gap=0.0), on_map=False)


# What it says ----------------------------------------------------------------------------------


def test_the_histogram_keeps_gross_errors_from_hiding_others() -> None:
    """A bird 500 m up makes σ so large that a low point stays, unless it is set apart before."""
    rng = np.random.default_rng(10)
    xyz = rng.uniform(0, [30, 30, 0.02], (1000, 3))
    xyz[100, 2], xyz[200, 2] = 500.0, -1.0
    assert np.flatnonzero(detect(xyz, Elevation(gap=0.0)) > 1).tolist() == [100]
    score = detect(xyz, Elevation())
    assert np.flatnonzero(score > 1).tolist() == [100, 200]
    assert score[100] == (500.0 - xyz[np.arange(1000) != 100, 2].max()) / 5.0


# Against the ground ------------------------------------------------------------------------------

GROUND = Elevation(against='ground', height=20.0, depth_counts=20.0, cell=2.0, widest=12.0)


def town(seed: int, count: int = 400) -> Floats:
    """Make a slope with a house of 8 m, a hole without points, and points too low and too high."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, [40, 30, 0.1], (count, 3))
    xyz[:, 2] += 0.1 * xyz[:, 0]
    house = (abs(xyz[:, 0] - 15) < 4) & (abs(xyz[:, 1] - 15) < 5)
    xyz[house, 2] += 8.0
    xyz = xyz[(abs(xyz[:, 0] - 30) > 3) | (abs(xyz[:, 1] - 8) > 4)]
    xyz[0], xyz[1], xyz[2] = [12, 4, -2.5], [5, 25, 60], [15, 15, -9]
    return xyz


@pytest.mark.parametrize('sides', SIDES)
@pytest.mark.parametrize('seed', range(3))
def test_against_the_ground_equals_naive(seed: int, sides: str) -> None:
    """Holes, houses and low points included; and clouds of one row of cells, or one cell."""
    full = town(seed)
    for xyz in (full, full[:60], full * [0.04, 1, 1], full[:1], full[[3, 3, 3]]):
        parameters = replace(GROUND, sides=sides)
        expected = naive.ground_scores(
            xyz.tolist(),
            *(parameters.height, parameters.depth_counts, sides),
            *(parameters.cell, parameters.widest, elevation.SLOPE),
        )
        np.testing.assert_allclose(detect(xyz, parameters), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('far', [1e5, -1e20])
def test_a_stray_point_far_off_on_the_map(far: float) -> None:
    """It is an outlier, and the others are judged as without it."""
    xyz = town(1)
    xyz[5, :2] = far
    score = detect(xyz, GROUND)
    assert np.isfinite(score).all()
    assert score[5] > 1000
    np.testing.assert_array_equal(np.delete(score, 5), detect(np.delete(xyz, 5, axis=0), GROUND))


def test_a_cloud_that_is_spread_too_widely_is_refused() -> None:
    """Two towns 100 km apart would take gigabytes."""
    xyz = np.concatenate([town(1), town(2) + np.array([1e5, 1e5, 0.0])])
    with pytest.raises(FilterError, match='large enough for at most 16 cells a point, got 2 m for'):
        detect(xyz, GROUND)
