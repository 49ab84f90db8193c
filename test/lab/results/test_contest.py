# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The contest: all get the same points, and are counted alike."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lidar_outlier_filter.evaluation.confusion import Confusion
from lidar_outlier_lab.results import contest, contest_tables
from lidar_outlier_lab.results.contest import Record, Standing, compete, score, standings
from lidar_outlier_lab.results.contest_tables import Target
from lidar_outlier_lab.results.contestants import (
    DEFAULT,
    Judgement,
    Ours,
    Peer,
)
from lidar_outlier_lab.results.samples import simulated

if TYPE_CHECKING:
    from lidar_outlier_lab.results.samples import Sample


def record(name: str, counts: tuple[int, int, int, int], seed: int = 1, **more: str) -> Record:
    """Make a record of two stretches, all in the first."""
    both = np.array([counts, (0, 0, 0, 0)])
    return Record(more.get('sample', 'leslar-b'), name, seed, both, 0.5, 1.0, 0.95)


def test_all_is_counted() -> None:
    """A record holds what the contestant said of the sample."""
    (sample,) = simulated('sotoodeh-hod', 3)
    height = Peer('by height', lambda xyz: Judgement(xyz[:, 2] > 1.0, xyz[:, 2]))
    blind = Peer('blind', lambda xyz: Judgement(np.zeros(len(xyz), np.bool_), None))
    one, other = score(height, sample), score(blind, sample)
    high = sample.clouds[0][:, 2] > 1.0
    found = np.count_nonzero(high & sample.data.bad)
    whole = Confusion(*one.counts.sum(axis=0).tolist())
    assert (one.sample, one.contestant, one.seed) == ('sotoodeh-hod', 'by height', 3)
    assert whole.found == found
    assert whole.lost == np.count_nonzero(high) - found
    assert whole.total == len(sample.data)
    assert len(one.counts) == sample.data.stretches
    assert 0 < one.auc < 1
    assert one.best >= whole.f1
    assert math.isnan(other.auc)


def test_each_sample_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A preset and seed are simulated once for all, and only those compete whom it suits."""
    made: list[tuple[str, int]] = []

    def make(preset: str, seed: int, progress: object) -> list[Sample]:
        made.append((preset, seed))
        assert callable(progress)
        progress(0.5)
        return simulated('sotoodeh-hod', seed)

    monkeypatch.setattr(contest, 'simulated', make)
    result: list[tuple[int, int, str]] = []
    everybody = [Ours('smoother', {'chain': ['alpha_beta_gamma']}), Ours('sor', {'chain': ['sor']})]
    records = compete(
        [('sotoodeh-hod', 1, everybody), ('sotoodeh-hod', 2, everybody)],
        lambda *what: result.append(what),
    )
    assert made == [('sotoodeh-hod', 1), ('sotoodeh-hod', 2)]
    assert [(one.contestant, one.seed) for one in records] == [('sor', 1), ('sor', 2)]
    assert all(done <= total for done, total, _ in result)


def test_targets_beside_others() -> None:
    """On streets the tuned others are to be beaten, and those without a score do not count."""
    target, standing = Target('', 0.5, 0.01, tuned=True), Standing((record('x', (90, 10, 0, 900)),))
    blind = Standing((replace(record('blind', (0, 0, 0, 1)), best=math.nan),))
    assert standing.whole.f1 == pytest.approx(180 / 190)
    for best, met in ((0.9, True), (0.95, False)):
        other = Standing((replace(record('y', (1, 1, 1, 1)), best=best),))
        assert target.f1([other, blind]) == best
        assert target.met(standing, [other, blind]) is met
        assert replace(target, tuned=False).met(standing, [other])
    both = [record(name, (90, 10, 0, 900), sample='street-64') for name in ('x', 'y')]
    text = contest_tables.targets(standings(both), 'x', ['y'])
    assert '| street-64 (rain) | 0.950 |' in text
    assert text.endswith('| **no** |')


def test_tables() -> None:
    """What did not compete is a dash; nothing rejected is an F1 of 0."""
    blind = record('x', (0, 10, 0, 90))
    other = Record('kang-urban', 'y', 1, np.array([[10, 0, 0, 90]]), math.nan, 1.0)
    found = standings([blind, other])
    text = contest_tables.overview(found, ['y', 'x', 'z'])
    assert '| x | **0.000** | – |' in text
    assert '| y | – | **1.000** |' in text
    assert '| z |' not in text
    assert '| x | 0.950 | – |' in text
    assert text.count('| y |') == 1
    assert '| y | 1 | 100.00 % | 100.00 % | 1.000 | – | 0.00 % | – | 1.0 |' in (
        contest_tables.details(found, ['y'])
    )


def test_where_others_are_better() -> None:
    """It is said where another leads, and where not even the best of ours keeps up."""
    records = [
        record(DEFAULT, (5, 5, 0, 90)),
        record('chain', (8, 2, 0, 90)),
        record('peer', (9, 1, 0, 90)),
    ]
    found = standings(records)
    worse = contest_tables.worse(found, DEFAULT, ['peer'])
    assert worse == '* leslar-b: default 0.667; peer 0.947'
    beaten = contest_tables.beaten(found, ['peer'])
    assert beaten == '* leslar-b: peer 0.947; ours at most 0.889'
    found = standings(records[:2])
    assert contest_tables.worse(found, DEFAULT, []) == 'Nowhere in this run.'
    assert contest_tables.beaten(found, ['peer']) == 'Nowhere in this run.'
