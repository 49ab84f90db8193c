# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Why trees say what they say: what the features add is what they say."""

import numpy as np
import pytest
from helpers.profile_drives import Drive
from helpers.sweeps import sweep
from naive import scan_pattern as naive

from lidar_outlier_filter.core.detectors.boosted_trees.explain.pattern_reasons import (
    REASONS,
    Reasons,
    contribute,
    explain,
)
from lidar_outlier_filter.core.detectors.boosted_trees.models import load
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import find_either, judge
from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.errors import FilterError


def test_contributions_are_those_of_loops() -> None:
    """Of random trees, with ties at limits, with NaN, and a feature asked about twice."""
    rng = np.random.default_rng(1)
    trees = Trees(
        rng.integers(0, 4, (30, 7)).astype(np.int32),
        rng.integers(-2, 3, (30, 7)).astype(np.float32),
        rng.standard_normal((30, 8)).astype(np.float32),
        np.float32(0.5),
    )
    values = rng.integers(-3, 4, (4, 60)).astype(np.float32)
    values[2, :5] = np.nan
    wanted = rng.random(60) < 0.8
    added = np.zeros_like(values)
    contribute(trees, values, wanted, added)
    expected = np.zeros_like(values, np.float64)
    for k in np.flatnonzero(wanted):
        for f, t, v in zip(trees.feature, trees.limit, trees.value, strict=True):
            point = values[:, k].tolist()
            for number, change in naive.additions(
                f.tolist(), t.tolist(), v.tolist(), point
            ).items():
                expected[number, k] += change
    assert added == pytest.approx(expected, abs=1e-4)
    assert not added[:, ~wanted].any()


def test_additions_and_average_are_the_log_odds() -> None:
    """They add up for points of either pass, in the order given; the score says the same."""
    points = sweep(3, 0.1, columns=200)
    order = np.random.default_rng(4).permutation(len(points))
    points = points.take(order)
    reasons = explain(points)
    assert reasons.added.shape == (len(REASONS), len(points))
    whole = reasons.average + reasons.added.sum(axis=0)
    assert whole == pytest.approx(reasons.odds, abs=2e-3)
    assert len({*reasons.average.tolist()}) == 2  # the trees of both passes
    pattern = find_pattern(points)
    assert pattern is not None
    assert np.array_equal(judge(pattern, 1.0) > 1, reasons.odds > np.float32(load().threshold))


def test_reasons_of_some() -> None:
    """Those that are wanted have the reasons that they have among all; others have none."""
    points = sweep(3, 0.1, columns=200)
    wanted = np.random.default_rng(6).random(len(points)) < 0.1
    every, some = explain(points), explain(points, wanted=wanted)
    assert np.array_equal(some.added[:, wanted], every.added[:, wanted])
    assert not some.added[:, ~wanted].any()
    assert np.array_equal(some.odds, every.odds)


def test_reasons_of_a_profile_scanner() -> None:
    """Its trees have more features; they add up, too."""
    points = Drive(10, 0.02, lines=20, shots=400, strays=0.01).points
    reasons = explain(points, sensor='profile')
    assert reasons.added.shape == (len(reasons.names), len(points))
    whole = reasons.average + reasons.added.sum(axis=0)
    assert whole == pytest.approx(reasons.odds, abs=2e-3)
    found = find_either(points, 'profile')
    assert found is not None
    score = judge(found.pattern, 1.0, profile=True)
    assert np.array_equal(score > 1, reasons.odds > np.float32(reasons.threshold))
    assert 0 < np.count_nonzero(score > 1) < len(points)


def test_reason_of_strays() -> None:
    """A name for each point; first results are no reason of points that were seen once."""
    points = sweep(4, 0.0, columns=300)
    reasons = explain(points)
    assert {*reasons.strongest} <= {*REASONS}
    once = reasons.average == reasons.average[np.argmin(reasons.odds)]
    first = REASONS.index('first')
    assert not reasons.added[first:, once].any()
    assert reasons.added[first:, ~once].any()


def test_strongest_is_one_that_was_asked() -> None:
    """Not one that adds nothing, where all others take away; nothing of points not explained."""
    nothing = np.zeros(3, np.float32)
    added = np.array([[0, 0, 0], [-1, 2, 0], [-2, 1, 0]], np.float32)
    reasons = Reasons(nothing, nothing, added, ('step', 'leap', 'along'), 0.0)
    assert reasons.strongest == ['leap', 'leap', '']


def test_points_without_a_pattern() -> None:
    """They have no reasons."""
    with pytest.raises(FilterError, match='scan pattern'):
        explain(sweep(4, 0.0).take(slice(0, 9)))
