# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a sample of the health of a topic has, by hand, and the warning about losses."""

import math
import re
from collections import Counter
from itertools import pairwise
from xml.etree import ElementTree as ET

import pytest
from helpers import ROOT
from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.parameters.node import HealthLimits
from lidar_outlier_filter.pipeline.statistics import CountsByReason, Statistics
from lidar_outlier_filter.ros.health import (
    DEGRADED,
    DROPPED,
    ERROR,
    LOSS_PERIOD,
    LOST,
    OK,
    PROFILES,
    UNFILTERED,
    WARN,
    WITHOUT_POSE,
    Backlog,
    Health,
)

NOTHING = Backlog(0, 0.0, 0)
MAX_DELAY = 1.0


def take_sample(
    health: Health, limits: HealthLimits | None = None, seconds: float = 2.0
) -> tuple[int, str, dict[str, str], dict[str, float]]:
    """Take a sample, with nothing pending."""
    report = health.sample(seconds, limits or HealthLimits(), MAX_DELAY, NOTHING)
    return report.level, report.message, report.values, report.plotted


def test_counts_since_the_last_sample() -> None:
    """Rates, shares and times are those since the last sample; counts are those since the start."""
    health = Health()
    for points in (100, 300):
        health.received()
        health.read(points)
    for delay in (0.1, 0.3, 0.2, 0.4):
        health.published(delay, 10 * delay)
    counts = Statistics(messages=2, points=400, invalid=1, untested=20, outliers=8)
    counts.rejected, counts.undecided = Counter(a=5, b=4), Counter(b=6)
    counts.refusals, counts.bypassed = CountsByReason({'the fields': 2}), Counter(disabled=1)
    counts.poses, counts.methods = CountsByReason({'a pose': 3}), Counter(trees=7)
    counts.lines = '149.98 turns/s, from time and geometry'
    health.spent(0.05)
    health.counted(counts)
    level, _, values, plotted = take_sample(health, HealthLimits(unfiltered_warn=1.0))
    assert level == OK
    expected = {
        'clouds/s': '1.0',
        'points/s': '200',
        'delay since received, p50, ms': '300.0',
        'delay since received, max, ms': '400.0',
        'delay since stamp, p50, ms': '3000.0',
        'processing time, p95, ms': '50.0',
        'scan lines': '149.98 turns/s, from time and geometry',
        'blocks judged by trees': '7',
        'rejected by a': '5',
        'rejected by b': '4',
        'undecided by b': '6',
        'refused for the fields': '2',
        'refused poses for a pose': '3',
        'unfiltered for disabled': '1',
    }
    assert values.items() >= expected.items()
    assert plotted['rejected_share'] == 8 / 400
    assert plotted['untested_share'] == 20 / 400
    assert plotted['refused'] == 2
    # The counts are copies: what they were copied from goes on.
    counts.points += 600
    counts.outliers += 300
    counts.refusals['the fields'] += 1
    health.spent(0.01)
    health.counted(counts)
    health.received()
    health.read(600)
    _, _, values, plotted = take_sample(health, seconds=0.5)
    assert (values['clouds/s'], values['points/s']) == ('2.0', '1200')
    assert plotted['rejected_share'] == 300 / 600
    assert (plotted['refused'], values['refused']) == (1, '3')
    assert plotted['delay_max'] == 0
    assert plotted['processing_p95'] == 0.01


@pytest.mark.parametrize(
    ('delays', 'level'),
    [([0.9] * 20, OK), ([0.91] * 20, WARN), ([1.5] * 20, WARN), ([1.51] * 20, ERROR), ([], OK)],
)
def test_delay(delays: list[float], level: int) -> None:
    """The 95th percentile counts, against max_delay; the limits themselves are still allowed."""
    health = Health()
    health.received()
    for delay in delays:
        health.published(delay, 0)
    assert take_sample(health)[0] == level


def test_errors_of_detectors() -> None:
    """One in a thousand clouds is an error at once, and only where it was raised."""
    health = Health()
    for _ in range(1000):
        health.received()
    health.counted(Statistics(bypassed=Counter(failure=1), failures=1))
    assert take_sample(health)[0] == ERROR
    health.received()
    assert take_sample(health)[0] == OK


@pytest.mark.parametrize('middleware', PROFILES)
def test_the_advice_is_for_the_middleware(middleware: str) -> None:
    """It names a file of the package by a path that exists, another one for each middleware."""
    path = ROOT / 'config' / PROFILES[middleware]
    health = Health(middleware)
    health.missed(LOST, 1)
    advice = f'; for large clouds all nodes need {path}'
    assert advice in take_sample(health)[1]
    assert ET.parse(path).getroot() is not None  # noqa: S314  our own


def test_what_is_not_filtered() -> None:
    """Refused, lost, dropped and passed clouds are complained of, by how many there should be."""
    health = Health()
    for _ in range(6):
        health.received()
    health.missed(LOST, 2)
    health.missed(DROPPED)
    health.published(0.1, 0.1)
    health.counted(Statistics(bypassed=Counter(overload=1, disabled=5)))
    level, message, values, plotted = take_sample(health)
    assert level == WARN
    assert message == (
        'clouds not filtered fully: 4 (2 lost in transit, 1 dropped, 1 passed unfiltered); '
        'received in the same time: 6; '
        f'for large clouds all nodes need {ROOT}/config/fastdds_large_clouds.xml'
    )
    assert [plotted[name] for name in ('lost', 'dropped', 'bypassed')] == [2, 1, 1]
    assert (values['lost'], values['dropped']) == ('2', '1')
    health.received()
    assert take_sample(health)[:2] == (OK, 'clouds are filtered in time')
    for _ in range(2):
        health.received()
    health.missed(DROPPED)
    health.published(0.1, 0.1)
    said = 'clouds not filtered fully: 1 (1 dropped); received in the same time: 2'
    assert take_sample(health)[1] == said
    health.received()
    health.missed(DROPPED, 2)
    assert take_sample(health)[0] == ERROR


# Limits that complain of nothing.
PATIENT = HealthLimits(
    delay_warn=1000.0,
    silence_warn=1000.0,
    unfiltered_warn=1.0,
)


@pytest.mark.parametrize('oldest', [0.0, 0.9 * MAX_DELAY, 1.1 * MAX_DELAY, 100 * MAX_DELAY])
def test_who_waits_longer_than_max_delay_is_not_well(oldest: float) -> None:
    """Whatever the limits are: by the age of pending clouds, not of published ones."""
    health = Health()
    health.received()
    health.published(0.01, 0.01)
    found = health.sample(1.0, PATIENT, MAX_DELAY, Backlog(0, 0.0, 1, oldest=oldest))
    assert (found.level == OK) is (oldest <= MAX_DELAY)
    assert ('no output for' in found.message) is (oldest > MAX_DELAY)


def test_who_drops_everything_is_not_well() -> None:
    """As soon as that lasts longer than max_delay; an output ends it."""
    health = Health()
    for number in range(4):
        health.received()
        health.missed(DROPPED)
        found = health.sample(0.4 * MAX_DELAY, PATIENT, MAX_DELAY, NOTHING)
        assert (found.level == OK) is (number < 2)
    health.published(0.01, 0.01)
    health.missed(DROPPED)
    assert health.sample(0.4 * MAX_DELAY, PATIENT, MAX_DELAY, NOTHING).level == OK


@pytest.mark.parametrize(
    ('name', 'text', 'levels'),
    [
        ('outliers', 'rejected', {50: OK, 51: WARN, 90: WARN, 91: ERROR}),
        ('untested', 'untested', {90: OK, 91: WARN, 100: WARN}),
    ],
)
def test_shares_of_points(name: str, text: str, levels: dict[int, int]) -> None:
    """Too many rejected, or too many untested."""
    for count, level in levels.items():
        health = Health()
        health.received()
        counts = Statistics(points=100)
        setattr(counts, name, count)
        health.counted(counts)
        found, message = take_sample(health)[:2]
        assert found == level
        assert level == OK or message == f'{count:.1f} % of the points are {text}'


@pytest.mark.parametrize(
    ('detector', 'share', 'limit', 'level'),
    [
        ('boosted_trees', 4, 0.0, OK),
        ('boosted_trees', 6, 0.0, WARN),
        ('boosted_trees', 49, 0.0, WARN),
        ('boosted_trees', 91, 0.0, ERROR),
        ('lof', 14, 0.0, OK),
        ('lof', 16, 0.0, WARN),
        ('hierarchical', 49, 0.0, OK),
        ('mask', 20, 0.0, OK),
        ('of_a_stranger', 49, 0.0, OK),
        ('boosted_trees', 49, 0.5, OK),
        ('boosted_trees', 51, 0.5, WARN),
    ],
)
def test_more_rejected_than_is_usual(detector: str, share: int, limit: float, level: int) -> None:
    """Each detector has its share, unless a limit of all is set; those of before do not count."""
    health = Health()
    health.received()
    before = Statistics(points=1000, outliers=900)
    before.rejected[detector] = 900
    health.counted(before)
    take_sample(health)
    counts = Statistics(points=1100, outliers=900 + share)
    counts.rejected[detector] = 900 + share
    health.counted(counts)
    found = health.sample(1.0, HealthLimits(rejected_warn=limit), MAX_DELAY, NOTHING)
    assert found.level == level
    if level == WARN and not limit:
        usual = {'boosted_trees': 5, 'lof': 15}[detector]
        said = f'{detector} rejects {share:.1f} % of the points, usually at most {usual} %'
        assert found.message.startswith(said)


def test_silence() -> None:
    """Without clouds a warning, then an error; with the next cloud all is well."""
    health = Health()
    found = [take_sample(health, seconds=1.0)[0] for _ in range(12)]
    assert found == [OK] * 2 + [WARN] * 8 + [ERROR] * 2
    health.received()
    assert take_sample(health)[:2] == (OK, 'clouds are filtered in time')
    report = health.sample(5.0, HealthLimits(), MAX_DELAY, Backlog(0, 0.0, 0, 2))
    said = 'no cloud for 5 s, publishers: 2 (for large clouds all nodes need '
    assert report.message.startswith(said)


SEEN = st.tuples(
    st.floats(0, 2 * LOSS_PERIOD),
    st.sampled_from([DROPPED, LOST]),
    st.integers(0, 3),
)


@given(st.lists(SEEN))
def test_bounded_and_complete(seen: list[tuple[float, str, int]]) -> None:
    """Warnings are apart by the period at least, and their sum is all that was lost."""
    health, lost, said = Health(), Counter[str](), Counter[str]()
    time, times, lossy = 0.0, list[float](), list[float]()
    for seconds, what, count in [*seen, (math.inf, DROPPED, 0)]:
        lost[what] += count
        health.missed(what, count)
        time += seconds
        lossy += [time] * bool(count)
        if text := health.loss_warning('drop_oldest', seconds):
            times.append(time)
            assert ('for large clouds all nodes need' in text) == (LOST in text)
            said += Counter({what: int(count) for count, what in _counts(text)})
    assert said == +lost
    assert times[:1] == lossy[:1]  # the first at once
    gaps = [after - before for before, after in pairwise(times)]
    assert all(gap >= LOSS_PERIOD or math.isclose(gap, LOSS_PERIOD) for gap in gaps)


def _counts(text: str) -> list[tuple[str, str]]:
    return re.findall(r'(\d+) (dropped|lost in transit)', text)


def test_what_counts() -> None:
    """All that was not filtered in full; not clouds that the user lets pass, nor refused ones."""
    health = Health()
    health.missed(LOST, 1)
    health.missed(DROPPED, 2)
    passed = Counter(overload=3, failure=4, disabled=100)
    refused = CountsByReason({'point_step': 100})
    health.counted(Statistics(bypassed=passed, degraded=5, without_pose=6, refusals=refused))
    assert health.losses() == {
        LOST: 1,
        DROPPED: 2,
        UNFILTERED: 7,
        DEGRADED: 5,
        WITHOUT_POSE: 6,
    }
