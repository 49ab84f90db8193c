# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The method is chosen by what a cloud shows, and points that no method can judge are untested."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import Drive, road, sweep

from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.filter import FilterParameters


def unsteady() -> Points:
    """Return lines whose times say little of the mirror's angle: they have no scan pattern."""
    points = road(3, lines=24)[0]
    t = points.t + 60_000 * (np.arange(len(points)) % 3)
    return replace(points, t=t)


def shapeless() -> Points:
    """Return a cloud without times and lines."""
    points = road(3, lines=24)[0]
    zeros = np.zeros(len(points), np.int64)
    return replace(points, t=zeros, line=zeros)


@pytest.mark.parametrize(
    ('points', 'whole', 'expected'),
    [
        (sweep(5, 0.1, columns=200), False, Method.PATTERN),
        (Drive(11, 0.1).points, False, Method.PATTERN),
        (unsteady(), False, Method.NEIGHBOURS),
        (unsteady(), True, Method.NEIGHBOURS),
        (shapeless(), True, Method.NEIGHBOURS),
        (shapeless(), False, Method.UNTESTED),
        (unsteady().take(np.arange(40)), False, Method.UNTESTED),
        (unsteady().take(np.arange(40)), True, Method.NEIGHBOURS),
    ],
)
def test_method(points: Points, whole: bool, expected: Method) -> None:  # noqa: FBT001
    """It is counted by its name; without one, all points are undecided and none is rejected."""
    chain = Chain(FilterParameters(), whole=whole)
    verdict = chain.judge(points)
    assert chain.methods == {expected.value: 1}
    is_untested = expected is Method.UNTESTED
    assert np.isnan(verdict.score).all() == is_untested
    assert (verdict.undecided == (64 if is_untested else 0)).all()
    assert not (verdict.rejected & np.isnan(verdict.score)).any()


def test_sensor_names_the_method() -> None:
    """Whatever the cloud shows, and whichever other sensors the same input was judged for."""
    seen = DetectorInput(sweep(5, 0.1, columns=200), FilterParameters(), whole=True)
    sensors = {name: {'boosted_trees.sensor': name} for name in ('auto', 'profile', 'survey')}
    methods = [choose(seen, FilterParameters().changed(one))[0] for one in sensors.values()]
    assert methods == [Method.PATTERN, Method.UNMET, Method.NEIGHBOURS]


@pytest.mark.parametrize(
    ('sensor', 'has_rings', 'expected'),
    [
        ('auto', False, Method.NEIGHBOURS),
        ('auto', True, Method.PATTERN),
        ('free', False, Method.PATTERN),
    ],
)
def test_a_whole_cloud_without_lines(sensor: str, expected: Method, *, has_rings: bool) -> None:
    """Recovered rings are lines; a scanner without rings needs none."""
    points = sweep(5, 0.1, columns=900)
    zeros = np.zeros(len(points), np.int64)
    bare = replace(points, t=zeros, line=zeros, ring=points.line if has_rings else None)
    parameters = FilterParameters().changed({'boosted_trees.sensor': sensor})
    assert choose(DetectorInput(bare, parameters, whole=True), parameters)[0] is expected


@pytest.mark.parametrize(
    ('returns', 'expected'),
    [(1, Method.PATTERN), (2, Method.PATTERN), (8, Method.PATTERN), (64, Method.PATTERN)],
)
def test_rows_of_a_range_image(returns: int, expected: Method) -> None:
    """The returns of a packet may come in any order, with one time; the verdicts stay the same."""
    points = sweep(4, 0.0, columns=900)
    shot = np.unique(points.t, return_inverse=True)[1]
    mixed = np.random.default_rng(1).permutation(len(points))
    rows = replace(points, t=shot // (8 * returns) * 100_000).take(mixed)
    chain = Chain(FilterParameters())
    rejected = chain.judge(rows).rejected
    assert chain.methods == {expected.value: 1}
    if expected is Method.PATTERN:
        sorted_ones = Chain(FilterParameters()).judge(points).rejected
        assert (rejected == sorted_ones[mixed]).mean() > 0.999
        assert rejected.sum() > 200


@pytest.mark.parametrize('threads', [1, 3])
@pytest.mark.parametrize('method', ['spinning', 'profile', 'survey'])
def test_order_and_threads_do_not_matter(method: str, threads: int) -> None:
    """Points in any order get the same scores, bit for bit, whatever the number of threads."""
    points = Drive(9, 0.2).points if method == 'profile' else sweep(2, 0.2)
    values = {'boosted_trees.sensor': method}
    one, many = (FilterParameters().changed({**values, 'threads': n}) for n in (1, threads))
    order = np.random.default_rng(3).permutation(len(points))
    score = Chain(one, whole=True).judge(points).score
    again = Chain(many, whole=True).judge(points.take(order)).score
    assert again.tobytes() == score[order].tobytes()
