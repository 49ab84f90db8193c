# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The contest: all get the same points, each judges what it can, and all are counted alike."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.labelled import BAD, rows

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.evaluation.confusion import Confusion
from lidar_outlier_filter.tuning.training import Training
from lidar_outlier_lab.results import contest
from lidar_outlier_lab.results.contest import Record, Standing, Target, score, standings
from lidar_outlier_lab.results.contestants import Judgement, ours, peer
from lidar_outlier_lab.results.samples import Sample, simulated
from lidar_outlier_lab.simulation import presets
from lidar_outlier_lab.simulation.world.recording import FRAME, START, Cloud

# Samples ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(('frame', 'sizes'), [('lidar', [1, 1]), (FRAME, [2])])
def test_a_recording_is_streamed(
    monkeypatch: pytest.MonkeyPatch, frame: str, sizes: list[int]
) -> None:
    """Clouds of one topic are one sample; in the map's frame, other filters get them together."""
    clouds = [Cloud(START + i * 10**8, START, rows(), frame=frame) for i in range(2)]
    monkeypatch.setattr(presets, 'make', lambda *_given, **_more: iter(clouds))
    (sample,) = simulated('street-16', 7)
    assert (sample.name, sample.seed, len(sample.data)) == ('street-16', 7, 2 * len(BAD))
    assert sample.data.streamed
    assert sample.timed
    np.testing.assert_array_equal(sample.data.bad, np.tile(BAD, 2))
    np.testing.assert_array_equal(sample.data.good, ~sample.data.bad)
    assert [len(xyz) for xyz in sample.clouds] == [size * len(BAD) for size in sizes]
    assert (np.diff(sample.data.stretch) >= 0).all()


# Contestants --------------------------------------------------------------------------------------


def plane(*, sweeps: int = 1, timed: bool = True, own: bool = False) -> Sample:
    """Make a bumpy plane of 300 points, a few above it, in so many sweeps."""
    rng, number = np.random.default_rng(1), np.arange(300)
    xyz = rng.uniform(0.0, 5.0, (300, 3)) * (1, 1, 0.01)
    bad = number % 50 == 0
    xyz[bad, 2] += 3.0
    whole = Points(xyz, number * 1000 * timed, np.zeros(300, np.int64), np.ones(300, np.bool_))
    clouds = tuple(whole.take(part) for part in np.array_split(number, sweeps))
    data = Training(clouds, bad, ~bad, number * 20 // 300, 20, streamed=sweeps > 1)
    return Sample('plane', 3, data, bad.astype(np.int64), timed, own)


def blind(xyz: Floats) -> Judgement:
    """Reject nothing."""
    return Judgement(np.zeros(len(xyz), np.bool_), xyz[:, 2])


def test_who_suits_what() -> None:
    """No smoother without lines, no limit by range without an origin, none on another's preset."""
    smoother, near = ours('', {'chain': ['alpha_beta_gamma']}), ours('', needs_origin=True)
    assert [smoother.suits(plane(timed=timed)) for timed in (True, False)] == [True, False]
    assert [near.suits(plane(own=own)) for own in (True, False)] == [True, False]
    assert [ours('', only=(one,)).suits(plane()) for one in ('plane', 'street')] == [True, False]
    assert [peer('', blind, most).suits(plane()) for most in (300, 299)] == [True, False]
    assert peer('', blind, 299).suits(plane(sweeps=2, own=True))


def test_peers_see_sweeps_one_by_one() -> None:
    """In the sensor's frame a peer gets each sweep; in the map's, all together."""
    seen: list[int] = []

    def judge(xyz: Floats) -> Judgement:
        seen.append(len(xyz))
        return blind(xyz)

    result = peer('', judge).judge(plane(sweeps=3, own=True))
    assert result.score is not None
    assert len(result.score) == len(result.rejected) == 300
    peer('', judge).judge(plane(sweeps=3))
    assert seen == [100, 100, 100, 300]


# Counts and tables --------------------------------------------------------------------------------


def record(name: str, counts: tuple[int, int, int, int], sample: str = 'leslar-b') -> Record:
    """Make a record of two stretches, all in the first."""
    return Record(sample, name, 1, np.array([counts, (0, 0, 0, 0)]), 0.5, 1.0, 0.95)


def test_all_is_counted() -> None:
    """A record holds the contestant's verdict on the sample."""
    (sample,) = simulated('sotoodeh-hod', 3)
    one = score(peer('by height', lambda xyz: Judgement(xyz[:, 2] > 1.0, xyz[:, 2])), sample)
    none = peer('none', lambda xyz: Judgement(np.zeros(len(xyz), np.bool_), None))
    high = sample.clouds[0][:, 2] > 1.0
    whole = Confusion(*one.counts.sum(axis=0).tolist())
    assert (one.sample, one.contestant, one.seed) == ('sotoodeh-hod', 'by height', 3)
    assert whole.found == np.count_nonzero(high & sample.data.bad)
    assert whole.lost == np.count_nonzero(high & ~sample.data.bad)
    assert whole.total == len(sample.data)
    assert len(one.counts) == sample.data.stretches
    assert 0 < one.auc < 1
    assert one.best >= whole.f1
    assert math.isnan(score(none, sample).auc)


def test_targets_beside_others() -> None:
    """On streets the tuned others are to be beaten, and those without a score do not count."""
    target, standing = Target('', 0.5, 0.01, tuned=True), Standing((record('x', (90, 10, 0, 900)),))
    unknown = Standing((replace(record('blind', (0, 0, 0, 1)), best=math.nan),))
    assert standing.whole.f1 == pytest.approx(180 / 190)
    for best, met in ((0.9, True), (0.95, False)):
        other = Standing((replace(record('y', (1, 1, 1, 1)), best=best),))
        assert target.f1([other, unknown]) == best
        assert target.met(standing, [other, unknown]) is met
        assert target._replace(tuned=False).met(standing, [other])
    both = [record(name, (90, 10, 0, 900), 'street-64') for name in ('x', 'y')]
    text = contest.targets(standings(both), 'x', ['y'])
    assert '| street-64 (rain) | 0.950 |' in text
    assert text.endswith('| **no** |')


def test_where_others_are_better() -> None:
    """It is said where another leads the best of ours."""
    found = standings([record('mine', (8, 2, 0, 90)), record('peer', (9, 1, 0, 90))])
    beaten = '* leslar-b: mine 0.889; peer 0.947'
    assert contest.leader(found, ['mine'], ['peer']) == beaten
    assert contest.leader(found, ['peer'], ['mine']) == 'Nowhere in this run.'


def test_tables() -> None:
    """What did not compete is a dash, or left out; nothing rejected is an F1 of 0."""
    other = Record('kang-urban', 'y', 1, np.array([[10, 0, 0, 90]]), math.nan, 1.0)
    found = standings([record('x', (0, 10, 0, 90)), other])
    text = contest.sheet(found, ['y', 'x', 'z'], 'F1', contest._f1, is_best_bold=True)
    assert text.splitlines()[0] == '| F1 | leslar-b | kang-urban |'
    assert text.splitlines()[2:] == ['| y | – | **1.000** |', '| x | **0.000** | – |']
    row = '| y | 1 | 100.00 % | 100.00 % | 1.000 | – | 0.00 % | – | 1.0 |'
    assert row in contest.details(found, ['y'])
