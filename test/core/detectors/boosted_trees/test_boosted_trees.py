# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The weighed features are their naive twin, and do what they say."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.roads import arm, points_of, road, sweep
from naive import boosted_trees as naive
from numpy.testing import assert_allclose, assert_array_equal

from lidar_outlier_filter.core.detectors.boosted_trees.parameters import (
    BoostedTrees,
    SpinningWeights,
    Weights,
)
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import detector as boosted_trees
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import groups, lines
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points.scan_lines import find_lines
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats
    from lidar_outlier_filter.core.points.points import Points


def detect(points: Points, threads: int = 0, **changed: Any) -> Floats:
    """Score a cloud; parameters by their flat names, with __ for the dot."""
    values = {name.replace('__', '.'): value for name, value in changed.items()}
    hood = Neighbourhood(points.xyz, boosted_trees.neighbours(), threads)
    return boosted_trees.detect(hood, points, FilterParameters().changed(values))


def naively(points: Points, **changed: Any) -> list[float]:
    """Score a cloud by loops."""
    values = {name.replace('__', '.'): value for name, value in changed.items()}
    parameters = FilterParameters().changed(values)
    weights = {
        True: asdict(parameters.of(SpinningWeights)),
        False: asdict(parameters.of(Weights)),
    }
    columns = (points.xyz, points.t, points.line, points.range)
    scan = naive.Scan(*(column.tolist() for column in columns))
    boosted_trees = parameters.of(BoostedTrees)
    return naive.detect(
        scan, weights, parameters.gap_factor, boosted_trees.sensor, boosted_trees.threshold
    )


@pytest.mark.parametrize('sensor', ['auto', 'profile', 'spinning'])
@pytest.mark.parametrize('seed', [0, pytest.param(1, marks=pytest.mark.slow)])
def test_against_loops(seed: int, sensor: str) -> None:
    """Scores are those of the twin, for lines in turn, interleaved, shuffled and with gaps."""
    rng = np.random.default_rng(seed)
    for points, _ in (road(seed, 14, 30), sweep(seed, 6, 60)):
        some = points.take(rng.permutation(len(points))[: len(points) * 9 // 10])
        assert_allclose(
            detect(some, boosted_trees__sensor=sensor),
            naively(some, boosted_trees__sensor=sensor),
            rtol=1e-7,
        )


def test_uneven_times_against_loops() -> None:
    """Steps and predictions are those of the twin where shots do not follow each other evenly."""
    rng = np.random.default_rng(6)
    t = np.cumsum(rng.integers(800, 1200, 120)) + 10_000 * (np.arange(120) // 50)
    points = points_of(rng.normal(size=(120, 3)), t, np.arange(120) // 60)
    found = find_lines(points, 1.5)
    step, along = np.empty(120), np.empty(120)
    wanted = np.ones(120, np.bool_)
    lines.follow(0, 120, wanted, points.xyz, points.t, found.before, found.after, step, along)
    columns = (points.xyz, points.t, points.line, points.range)
    scan = naive.Scan(*(column.tolist() for column in columns))
    expected = naive.follow(scan, naive.segments(scan, 1.5))
    assert_allclose((step, along), expected, rtol=1e-12)


@pytest.mark.parametrize('beside', [pytest.param(False, marks=pytest.mark.slow), True])
def test_slanted_groups_against_loops(*, beside: bool) -> None:
    """The arm of a barrier is found as a group, by the twin too, and only where it is asked for."""
    points, slanted = arm(3, beside=beside)
    score = detect(points)
    assert_allclose(score, naively(points), rtol=1e-7)
    assert (score[slanted] > 1).mean() > 0.9
    without = detect(points, boosted_trees_profile__slanted=False)
    assert (without[slanted] > 1).mean() < 0.5


@pytest.mark.parametrize('count', [22, 23, 24, 25, 2999, 3000, 3001])
def test_sizes_of_slanted_groups(count: int) -> None:
    """A group of 24 points is one, and one of 3000; what has fewer or more is none."""
    rank = np.arange(count)
    along = 7.0 * (rank // 2) / count
    xyz = np.column_stack([0.01 * (rank % 2), 0.8 * along, 0.6 * along])
    # Beside it, a group that is too small, and one that is large enough.
    other = xyz[:30] + np.array([5.0, 0.0, 0.0])
    places = np.vstack([xyz, other[:5], other])
    line = np.concatenate([rank // 2, rank[:5] // 2, rank[:30] // 2])
    root = np.repeat([0, count, count + 5], [count, 5, len(other)])
    found = groups._of_groups(places, line, root)
    assert np.isnan(found[count : count + 5]).all()
    expected = 24 <= count <= 3000
    np.testing.assert_array_equal(np.isnan(found[:count]), not expected)
    np.testing.assert_array_equal(np.isnan(found[count + 5 :]), len(other) < 24)


@pytest.mark.parametrize('make', [road, sweep])
def test_finds_strays(make: Any) -> None:
    """Most strays are found, and hardly any good point is lost."""
    points, stray = make(0)
    rejected = detect(points) > 1
    assert rejected[stray].mean() > 0.7
    assert rejected[~stray].mean() < 0.005


@pytest.mark.slow
def test_one_threshold_for_either_sensor() -> None:
    """A part of the threshold is a multiple of the scores, of groups too; the twin agrees."""
    slanted, turning = arm(3)[0], sweep(1, 6, 60)[0]
    once: dict[str, Any] = {'boosted_trees_profile__passes': 1, 'boosted_trees_spinning__passes': 1}
    for points in (slanted, turning):
        score = detect(points, **once)
        assert_allclose(2 * detect(points, **once, boosted_trees__threshold=2.0), score)
    for points in (road(7, 14, 30)[0], turning, slanted):
        assert_allclose(
            detect(points, boosted_trees__threshold=0.7),
            naively(points, boosted_trees__threshold=0.7),
            rtol=1e-7,
        )


def test_sensor_shows_in_the_lines() -> None:
    """Lines in turn are a profile scanner's, those at once a spinning sensor's."""
    for make, sensor in ((road, 'profile'), (sweep, 'spinning')):
        points, _ = make(5)
        assert_array_equal(detect(points), detect(points, boosted_trees__sensor=sensor))


def test_second_pass_hears_of_bereft_points_only() -> None:
    """Scores change only where one of the 20 neighbours was rejected, and more are found."""
    points, _ = road(6, strays=0.2)
    first, both = (
        detect(points, boosted_trees_profile__passes=n, boosted_trees_profile__slanted=False)
        for n in (1, 2)
    )
    gone = first > 1
    assert_array_equal(both[gone], first[gone])
    apart = np.linalg.norm(points.xyz[:, None] - points.xyz, axis=2)
    np.fill_diagonal(apart, np.inf)
    bereft = gone[np.argsort(apart, axis=1)[:, :20]].any(axis=1)
    changed = both != first
    assert not (changed & ~bereft).any()
    assert changed[bereft & ~gone].mean() > 0.5
    assert (both > 1).sum() > gone.sum()


@pytest.mark.parametrize('count', [0, 1, 20, 21])
def test_too_few_points(count: int) -> None:
    """With 20 others there is a score; with fewer none."""
    points = road(0)[0].take(slice(0, count))
    assert_array_equal(np.isnan(detect(points)), count < 21)


def test_coincident_points() -> None:
    """A stack of points is no reason to fail, and none to reject."""
    points, _ = road(1, strays=0.0)
    xyz = points.xyz.copy()
    xyz[100:150] = xyz[100]
    stacked = points_of(xyz, points.t, points.line)
    score = detect(stacked)
    assert np.isfinite(score).all()
    flat = points_of(np.zeros((60, 3)), np.arange(60), np.zeros(60))
    assert_array_equal(detect(flat) > 1, False)  # noqa: FBT003


def test_points_on_a_line() -> None:
    """Where all neighbours lie on a line, what is off it is rejected, and they are not."""
    x = np.arange(200) * 0.05
    xyz = np.stack([x, 0.5 * x, np.zeros(200)], axis=1)
    xyz[100, 2] = 0.5
    points = points_of(xyz, np.arange(200) * 1000, np.arange(200) // 50)
    score = detect(points, boosted_trees_profile__slanted=False)
    assert np.argmax(score) == 100
    assert np.count_nonzero(score > 0.8 * score[100]) == 1


def test_any_number_of_threads() -> None:
    """The answer is the same to the last bit."""
    points, _ = road(2, lines=200)
    assert_array_equal(detect(points, 1), detect(points, 3))


def test_moves_and_turns_do_not_matter() -> None:
    """A profile scanner's cloud may lie anywhere, and be turned about the vertical."""
    points, _ = road(4)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    moved = points_of(points.xyz @ turn.T + [64.0, -128.0, 16.0], points.t, points.line)
    assert_allclose(detect(moved), detect(points), rtol=1e-6)


def test_company() -> None:
    """A dense cloud above the road is followed from its rim to its end, and that by its company."""
    points, _ = road(5, lines=30, shots=60, strays=0.0)
    rng = np.random.default_rng(5)
    cloud = (np.abs(np.arange(len(points)) % 60 - 25) < 10) & (np.abs(points.line - 15) < 10)
    cloud &= rng.random(len(points)) < 0.35
    xyz = points.xyz.copy()
    xyz[cloud] += rng.normal((0, 0, 0.9), (0.2, 0.2, 0.25), (np.count_nonzero(cloud), 3))
    points = points_of(xyz, points.t, points.line)
    assert_array_equal(detect(points) > 1, cloud)
    assert (detect(points, boosted_trees_profile__company=0.0)[cloud] > 1).mean() < 0.9
