# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The chain: order, vote, bits and scores, and points that nobody can judge."""

from typing import Any

import numpy as np
import pytest
from helpers import scans
from helpers.detectors import BITS
from helpers.programs import Program

from lidar_outlier_filter.core.detectors import hierarchical
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import FARTHEST, LEAST_SIGMA_M, Points
from lidar_outlier_filter.core.verdict import ALL, EXTRA, Verdict
from lidar_outlier_filter.parameters.filter import FilterParameters

SPATIAL = ('quadric', 'lof', 'sor', 'hierarchical', 'elevation', 'boosted_trees')
EVERY = ('alpha_beta_gamma', *SPATIAL)
LATER = ('alpha_beta_gamma', *SPATIAL[1:])  # without quadric, whose sections change with the tree


def parameters(*chain: str, **values: object) -> FilterParameters:
    """Make parameters with a chain."""
    return FilterParameters().changed({'chain': chain} | values)


def road(seed: int = 0) -> Points:
    """Measure 40 lines of a road, 1 % of whose points hang above it."""
    return scans.road(seed, 40, 100, 0.01)[0]


def judge(points: Points, *chain: str, **values: object) -> Verdict:
    """Judge by a chain."""
    return Chain(parameters(*chain, **values)).judge(points)


@pytest.mark.parametrize('name', EVERY)
def test_one_detector(name: str) -> None:
    """Its bit is set where its score is above 1, and nowhere else; it finds something."""
    verdict = judge(road(), name)
    assert 20 < np.count_nonzero(verdict.rejected) < 400
    detectors = verdict.detectors & ALL
    np.testing.assert_array_equal(detectors, np.where(verdict.rejected, BITS[name], 0))
    np.testing.assert_array_equal(verdict.score > 1, verdict.rejected)
    np.testing.assert_array_equal(verdict.undecided != 0, np.isnan(verdict.score))


# Sections are those of the tree, which loses points but is not built anew: quadric comes before
# the other spatial ones.
@pytest.mark.parametrize('chain', [LATER[::-1], EVERY, ('sor', 'lof')])
def test_each_judges_what_the_earlier_ones_left(chain: tuple[str, ...]) -> None:
    """The chain is its detectors one after the other, each called anew on what is left."""
    points = road(1)
    verdict = judge(points, *chain)
    left = np.arange(len(points))
    detectors = np.zeros(len(points), np.uint16)
    scores = np.full(len(points), np.nan, np.float32)
    for name in chain:
        alone = judge(points.take(left), name)
        detectors[left] |= alone.detectors
        scores[left] = np.fmax(scores[left], alone.score)
        left = left[~alone.rejected]
    np.testing.assert_array_equal(verdict.detectors, detectors)
    np.testing.assert_array_equal(verdict.score, scores)
    assert len(set(verdict.detectors.tolist())) > 2


@pytest.mark.parametrize('vote', [1, 2, 3, 4])
def test_vote(vote: int) -> None:
    """Every detector sees all points; as many as the vote must agree."""
    points = road(2)
    verdict = judge(points, *EVERY, vote=vote)
    alone = [judge(points, name) for name in EVERY]
    count = np.sum([each.rejected for each in alone], axis=0)
    np.testing.assert_array_equal(verdict.rejected, count >= vote)
    np.testing.assert_array_equal(verdict.detectors, sum(each.detectors for each in alone))
    np.testing.assert_array_equal(verdict.undecided, sum(each.undecided for each in alone))
    expected = np.fmax.reduce([each.score for each in alone])
    np.testing.assert_array_equal(verdict.score, expected)
    assert 0 < np.count_nonzero(verdict.rejected) < np.count_nonzero(count) or vote == 1


@pytest.mark.parametrize('count', [0, 1, 2, 3, 11, 15])
def test_too_few_points(count: int) -> None:
    """Untestable points are kept, and noted for each detector that tried."""
    verdict = judge(road(3).take(slice(0, count)), *SPATIAL)
    assert len(verdict) == count
    assert not verdict.rejected.any()
    expected = BITS['lof'] | BITS['sor']
    assert (verdict.undecided & expected == expected).all()


@pytest.mark.parametrize('chain', [('hierarchical',), ('hierarchical', 'elevation')])
@pytest.mark.parametrize('vote', [0, 1])
def test_phases(chain: tuple[str, ...], vote: int) -> None:
    """A bit and the score say the phase that rejected a point, and the size of its cluster."""
    points = road(7)
    # Points float in rows, which phase 1 leaves connected.
    near = np.arange(0, 400) % 2 == 0
    points.xyz[:400, 2] += np.where(near, 0.25, 0.0)
    values = {'hierarchical.min_cluster': 30, 'hierarchical.global_confidence': 0.9999}
    verdict = judge(points, *chain, vote=vote, **values)
    settings = parameters('hierarchical', **values).of(Hierarchical)
    result = hierarchical.detect(points.xyz, settings)
    assert set(result.phase) == {0, 1, 2}
    second = result.phase == 2
    np.testing.assert_array_equal(verdict.detectors & EXTRA != 0, second)
    assert (verdict.detectors[second] & BITS['hierarchical'] != 0).all()
    if chain == ('hierarchical',):
        np.testing.assert_array_equal(np.round(30 / verdict.score), result.cluster)


def test_the_second_phase_has_no_vote() -> None:
    """It is a part of one detector."""
    verdict = Verdict.untested(3)
    verdict.detectors[:] = [BITS['hierarchical'] | EXTRA, BITS['lof'] | BITS['sor'], 0]
    verdict.settle(2)
    assert verdict.rejected.tolist() == [False, True, False]


@pytest.mark.parametrize(
    ('name', 'extra'),
    [
        ('quadric', {'quadric.window': 'patch', 'quadric.significance': 1e-3}),
        (
            'quadric',
            {'quadric.surfaces': 1, 'quadric.significance': 1e-3},
        ),
        ('lof', {'lof.statistic': 'lof2', 'lof.threshold': 0.5}),
        ('sor', {'sor.statistic': 'sor2', 'sor.limit': 0.1}),
        ('sor', {'sor.statistic': 'radius', 'sor.radius': 0.2}),
        ('sor', {'sor.statistic': 'radius', 'sor.radius': 0.01, 'sor.range_scaled': True}),
    ],
)
def test_every_form(name: str, extra: dict[str, Any]) -> None:
    """Each form of a detector is reached by its parameters, and finds the strays."""
    points, stray = scans.road(6, 20, 100, 0.01)
    verdict = judge(points, name, **extra)
    assert np.count_nonzero(verdict.rejected & stray) > 0.4 * np.count_nonzero(stray)
    assert np.count_nonzero(verdict.rejected & ~stray) < 0.2 * len(points)
    assert not np.array_equal(verdict.score, judge(points, name).score, equal_nan=True)


@pytest.mark.parametrize(
    ('score', 'is_rejected'),
    [
        (1.0, False),
        (np.nextafter(1.0, 2.0), True),
        (1 + 1e-12, True),
        (1e300, True),
        (-1e300, False),
    ],
)
def test_scores_beside_one(score: float, is_rejected: bool) -> None:  # noqa: FBT001  a parameter
    """Rounding to float32 turns no rejected point into a kept one, nor the reverse."""
    verdict = Verdict.untested(1)
    verdict.add(BITS['sor'], np.array([0]), Scores(np.array([score])))
    verdict.settle(1)
    assert bool(verdict.score[0] > 1) == bool(verdict.rejected[0]) == is_rejected
    assert (verdict.detectors[0] == BITS['sor']) == is_rejected


@pytest.mark.parametrize('name', EVERY)
def test_whatever_a_cloud_may_hold(name: str) -> None:
    """Nothing that is let in makes a detector raise or warn, however odd it is."""
    rng = np.random.default_rng(5)
    times = np.array([-(2**61), 0, 10**7, 2**61])
    for seed in range(12):
        count = int(rng.choice([1, 2, 30, 300]))
        odd = rng.choice([-1, 1], (count, 3)) * 10.0 ** rng.uniform(-30, 9, (count, 3))
        xyz = [odd, rng.choice([-FARTHEST, FARTHEST, 0, 1], (count, 3)), FARTHEST - odd % 9]
        t = np.sort(rng.choice(times, count)) if seed % 2 else np.arange(count) * 1000
        line = rng.choice([-(2**63), 0, 2**63 - 1], count)
        sigma = rng.choice([LEAST_SIGMA_M, 1.0, FARTHEST], count) if seed % 4 > 1 else None
        points = Points(xyz[seed % 3], t, line, np.ones(count, np.bool_), sigma)
        assert len(judge(points, name)) == count


def test_memory_is_kept_for_the_next_cloud() -> None:
    """Once there is a chain, what a large array has used is not asked of the system again."""
    script = (
        'from resource import RUSAGE_SELF, getrusage\n'
        'from lidar_outlier_filter.core.engine.chain import Chain\n'
        'from lidar_outlier_filter.parameters.filter import FilterParameters\n'
        'def faults(): return getrusage(RUSAGE_SELF).ru_minflt\n'
        'def use(): bytearray(40_000_000)\n'
        'Chain(FilterParameters()); use(); before = faults(); use(); print(faults() - before)\n'
    )
    with Program('-c', script) as program:
        assert int(program.wait_for('')) < 1000  # of 10 000 pages
        assert program.wait() == 0
