# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The fast local outlier factor is its naive twin, and does what is promised of it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.shapes import CLOUDS
from naive import lof as naive
from numpy.testing import assert_allclose, assert_array_equal

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors import lof
from lidar_outlier_filter.core.detectors.builtin import Lof
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

Cloud = Callable[[np.random.Generator], Floats]


def detect(xyz: Floats, **changed: Any) -> Floats:
    """Score a cloud."""
    parameters = Lof(**changed)
    return lof.detect(Neighbourhood(xyz, parameters.min_pts), parameters)


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize(
    ('k', 'statistic'), [(1, 'lof'), (2, 'lof'), (7, 'lof'), (20, 'lof'), (10, 'lof2')]
)
@pytest.mark.parametrize('cloud', CLOUDS)
def test_against_loops(cloud: Cloud, k: int, statistic: str, seed: int) -> None:
    """Factors and scores are those of the textbook, and finite, whatever ties or coincides."""
    xyz = cloud(np.random.default_rng(seed))
    scores = detect(xyz, min_pts=k, threshold=0.8, statistic=statistic)
    assert np.isfinite(scores).all()
    expected = naive.scores(xyz.tolist(), k, 0.8, statistic)
    assert_allclose(scores, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize('statistic', ['lof', 'lof2'])
@pytest.mark.parametrize('count', [0, 1, 4, 5, 6, 7])
def test_few_points(count: int, statistic: str) -> None:
    """Points with fewer than min_pts others stay untested; with just as many they are tested."""
    xyz = np.random.default_rng(count).normal(size=(count, 3))
    scores = detect(xyz, min_pts=5, threshold=1.2, statistic=statistic)
    assert_allclose(scores, naive.scores(xyz.tolist(), 5, 1.2, statistic), rtol=1e-12, atol=1e-14)
    assert np.isnan(scores).all() == (count < 6)


@pytest.mark.parametrize('twins', [2, 80])
def test_what_is_far_off_does_not_change_a_bit(twins: int) -> None:
    """Factors depend on the points around alone, not on how the search sorts them all.

    Neighbours that tie come in the order of the search, and must not be added up in it; where all
    points are there twice, each 16 nearest break up a pair.
    """
    rng = np.random.default_rng(16)
    xyz = np.repeat(rng.uniform(0, 10, (3000, 3)), rng.choice([2, twins], 3000), axis=0)
    xyz = rng.permutation(xyz)
    piece = xyz[:, 0] < 7
    close = xyz[piece, 0] < 3
    neighbourhood, alone = Neighbourhood(xyz, 16), Neighbourhood(xyz[piece], 16)
    factors = lof.detect(neighbourhood, Lof(min_pts=16))[piece]
    assert_array_equal(lof.detect(alone, Lof(min_pts=16))[close], factors[close])


def sheet_and_outlier(rng: np.random.Generator) -> Floats:
    """Lay out a noisy grid of 30 × 30 points and one point above it."""
    across, along = np.meshgrid(np.arange(30.0), np.arange(30.0))
    flat = np.stack([across.ravel(), along.ravel(), np.zeros(900)], axis=1)
    return np.concatenate([flat + rng.normal(0, 0.05, flat.shape), [[15.0, 15.0, 9.0]]])


@pytest.mark.parametrize('stack', [21, 25, 100, 1000])
def test_good_points_beside_a_stack_are_kept(stack: int) -> None:
    """Nothing but the outlier is rejected because some good point is there many times."""
    xyz = sheet_and_outlier(np.random.default_rng(12))
    many = np.concatenate([xyz, np.repeat(xyz[465:466], stack - 1, axis=0)])
    rejected = detect(xyz) > 1
    assert rejected[-1]
    assert_array_equal(detect(many)[: len(xyz)] > 1, rejected)
