# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The fast tests of the distance to the neighbours are their naive twins, and do what they say."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.shapes import CLOUDS
from naive import sor as naive
from numpy.testing import assert_allclose

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors import sor
from lidar_outlier_filter.core.detectors.builtin import Sor
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.parameters.filter import FilterParameters

Cloud = Callable[[np.random.Generator], Floats]


def detect(xyz: Floats, range_m: Floats | None = None, **changed: Any) -> Floats:
    """Score a cloud."""
    parameters = Sor(**changed)
    return sor.detect(Neighbourhood(xyz, parameters.list_length), parameters, range_m)


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize('k', [1, 3, 20])
@pytest.mark.parametrize('cloud', CLOUDS)
def test_against_loops(cloud: Cloud, k: int, seed: int) -> None:
    """Scores are those of the textbook, whatever ties or coincides; those of 0 are exactly 0."""
    xyz = cloud(np.random.default_rng(seed))
    points = xyz.tolist()
    scores = detect(xyz, k=k, multiplier=1.5)
    assert_allclose(scores, naive.sor(points, k, 1.5), rtol=1e-11)
    scores = detect(xyz, statistic='sor2', k=k, limit=0.2)
    assert_allclose(scores, naive.sor2(points, k, 0.2), rtol=1e-11, atol=1e-13)
    scores = detect(xyz, statistic='radius', min_neighbors=k, radius=0.7)
    assert_allclose(scores, naive.radius(points, k, 0.7), rtol=1e-13)


@pytest.mark.parametrize('cloud', CLOUDS)
def test_limits_by_range_against_loops(cloud: Cloud) -> None:
    """Each point has its own limit; a range of 0 leaves none for sor and sor2."""
    rng = np.random.default_rng(2)
    xyz = cloud(rng)
    points = xyz.tolist()
    range_m = rng.choice([0.0, 1.0, 30.0, 200.0], len(xyz))
    growth = (0.05 * range_m).tolist()
    scores = detect(xyz, range_m, k=6, multiplier=1.0, range_scaled=True)
    assert_allclose(scores, naive.sor(points, 6, 1.0, growth), rtol=1e-11)
    scores = detect(xyz, range_m, statistic='sor2', k=6, limit=0.3, range_scaled=True)
    expected = np.array(naive.sor2(points, 6, 0.3, growth))
    by_rounding = ~np.isfinite(expected)  # how far from the median a tie with it is
    assert (np.isinf(scores) == by_rounding)[range_m > 0].all()
    assert_allclose(scores[range_m > 0], expected[range_m > 0], rtol=1e-11, atol=1e-12)
    scores = detect(xyz, range_m, statistic='radius', min_neighbors=4, range_scaled=True)
    assert_allclose(scores, naive.radius(points, 4, 0.5, growth), rtol=1e-13)


@pytest.mark.parametrize('count', [0, 1, 4, 5, 6, 7])
def test_few_points(count: int) -> None:
    """With fewer than k others no mean is known; no radius holds others that are not there."""
    xyz = np.random.default_rng(count).normal(size=(count, 3))
    points = xyz.tolist()
    scores = detect(xyz, k=5, multiplier=2.0)
    assert_allclose(scores, naive.sor(points, 5, 2.0), rtol=1e-12)
    assert np.isnan(scores).all() == (count < 6)
    scores = detect(xyz, statistic='sor2', k=5, limit=0.1)
    assert_allclose(scores, naive.sor2(points, 5, 0.1), rtol=1e-12, atol=1e-14)
    scores = detect(xyz, statistic='radius', min_neighbors=5, radius=2.0)
    assert_allclose(scores, naive.radius(points, 5, 2.0), rtol=1e-12)
    assert np.isinf(scores).all() == (count < 6)


def test_exactly_at_the_radius() -> None:
    """A neighbour at exactly the radius is within it; the next number below leaves it out."""
    xyz = np.argwhere(np.ones((5, 5, 5))).astype(np.float64)  # a cube of points, 1 m apart
    assert (detect(xyz, statistic='radius', min_neighbors=3, radius=1.0) == 1).all()
    smaller = float(np.nextafter(1, 0))
    assert (detect(xyz, statistic='radius', min_neighbors=3, radius=smaller) > 1).all()


@pytest.mark.parametrize('pairs', range(1, 80, 13))
def test_equal_distances_are_all_kept(pairs: int) -> None:
    """Nothing stands out where all mean distances are the same number: not even by rounding."""
    xyz = np.zeros((2 * pairs, 3))
    xyz[1::2, 0] = 0.1
    xyz[:, 1] = np.repeat(np.arange(pairs), 2)
    assert (detect(xyz, k=1, multiplier=0.0) <= 1).all()


def test_ranges_are_needed() -> None:
    """Limits that grow with the range need the range of every point."""
    xyz = np.random.default_rng(12).normal(size=(4, 3))
    with pytest.raises(FilterError, match=r'^the ranges of the points must be given '):
        detect(xyz, range_scaled=True, k=2)


@pytest.mark.parametrize(('statistic', 'length'), [('sor', 9), ('sor2', 9), ('radius', 4)])
def test_neighbours_that_a_statistic_asks_for(statistic: str, length: int) -> None:
    """A mean is of k neighbours; within a radius there need be min_neighbors."""
    given = {'sor.statistic': statistic, 'sor.k': 9, 'sor.min_neighbors': 4}
    parameters = FilterParameters().changed(given)
    assert DETECTORS['sor'].neighbours(parameters) == length
