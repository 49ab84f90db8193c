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
from lidar_outlier_lab.results.contest_section import entries, written
from lidar_outlier_lab.results.contest_tables import Target
from lidar_outlier_lab.results.contestants import (
    DEFAULT,
    OURS,
    RULES,
    Judgement,
    Ours,
    Peer,
    peers,
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


def test_standings() -> None:
    """Seeds are added up; the interval is that of seeds, and of one seed that of its stretches."""
    found = standings([record('x', (8, 2, 0, 90), 1), record('x', (10, 0, 5, 85), 2)])
    standing = found['leslar-b']['x']
    assert standing.whole == Confusion(18, 2, 5, 175)
    assert standing.worst == pytest.approx(20 / 25)
    low, high = standing.interval()
    assert low == pytest.approx(20 / 25)
    assert high == pytest.approx(16 / 18)
    assert Standing((record('x', (0, 10, 0, 90)),)).worst == 0.0


def test_who_judges_what() -> None:
    """Everybody the first seeds; default, rules and peers all of them, where there is a target."""
    listed = entries(['leslar-c', 'kang-urban'], [5, 6, 7], 2)
    assert [entry[:2] for entry in listed] == [
        ('leslar-c', 5),
        ('leslar-c', 6),
        ('leslar-c', 7),
        ('kang-urban', 5),
        ('kang-urban', 6),
    ]
    names = [{one.name for one in entry[2]} for entry in listed]
    others = {one.name for one in peers()}
    assert names[0] == names[1] == names[3] == {one.name for one in OURS} | others
    assert names[2] == {DEFAULT, *RULES} | others


def test_like_is_compared_with_like() -> None:
    """The default is shown on all seeds; beside others on those only that they have judged too."""
    records = [record(DEFAULT, (10, 0, 0, 90), 5), record('`sor`', (9, 1, 0, 90), 5)]
    records.append(record(DEFAULT, (0, 10, 0, 90), 6))
    texts = written(records, [5, 6], 1)
    assert '| default | 0.667 |' in texts['default']
    assert '| default | **1.000** |' in texts['contest']
    assert '| `sor` | 0.947 |' in texts['contest']


def test_targets() -> None:
    """A target is met if F1 and losses are; the table says so."""
    target = Target('', 0.9, 0.01)
    assert target.met(Standing((record('x', (90, 10, 10, 990)),)))
    assert not target.met(Standing((record('x', (89, 11, 9, 990)),)))
    assert not target.met(Standing((record('x', (100, 0, 11, 989)),)))
    good = contest_tables.targets(standings([record('x', (100, 0, 0, 900))]), 'x')
    bad = contest_tables.targets(standings([record('x', (50, 50, 0, 900))]), 'x')
    assert good.endswith('| yes |')
    assert bad.endswith('| **no** |')
    assert contest_tables.targets({}, 'x') == ''


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


def test_beside() -> None:
    """Others stand beside the whole on the presets with targets."""
    found = standings([record(DEFAULT, (9, 1, 0, 90)), record('other', (8, 2, 9, 81))])
    first, best, lost = contest_tables.beside(found, [DEFAULT, 'other', 'none']).split('\n\n')
    assert first.startswith('| F1 | leslar-b |')
    assert '| default | 0.947 |' in first
    assert '| other | 0.593 |' in first
    assert '| other | 0.950 |' in best
    assert '| other | 10.00 % |' in lost
    assert '| none | – |' in lost
