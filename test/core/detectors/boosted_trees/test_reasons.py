# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Contributions of features add up to the log-odds, and the strongest one is published."""

import numpy as np
import pytest
from helpers.scans import Drive, pattern_of, points_of, sweep
from naive import scan_pattern as naive
from numpy.typing import NDArray

from lidar_outlier_filter.core.detectors.boosted_trees import features
from lidar_outlier_filter.core.detectors.boosted_trees import neighbour_trees as survey
from lidar_outlier_filter.core.detectors.boosted_trees.methods import (
    Method,
    contributions,
    find_either,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    first_pass,
    measure,
    prepare_all,
    second_pass,
    strongest_of_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    FEATURE_NAMES,
    MIN_LOG_ODDS,
    PATTERN_MODEL,
    PROFILE_MODEL,
    SURVEY_MODEL,
    TreeModel,
    Trees,
    contribute,
    load,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import reasons
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.neighbours.floor import measure_floor
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.placed_pattern import spread
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.points import MAX_CODES

SNOW, ARMS = sweep(5, 0.2, 1.4, columns=200), Drive(12, 0.1, lines=20, shots=400, strays=0.03)
CLOUDS = {'spinning': SNOW, 'profile': ARMS.points}


def judged(points: Points, **changed: object) -> Verdict:
    """Judge a cloud, with reasons unless they are switched off."""
    values = {name.replace('__', '.'): value for name, value in changed.items()}
    parameters = {'chain': ['boosted_trees'], 'scores': True, **values}
    return Chain(FilterParameters().changed(parameters)).judge(points)


def passes(points: Points, sensor: str) -> tuple[NDArray[np.float32], NDArray[np.str_]]:
    """Return the log-odds of each point, and its strongest feature by contributions in both passes.

    Of the points in the order given.
    """
    pattern = find_either(points, sensor)
    assert pattern is not None
    some, name = prepare_all(pattern), pattern.model
    model, names = load(name), np.array(FEATURE_NAMES[name][1])
    first = first_pass(some, model.first)
    values = measure(some, first)
    once, twice = contribute(model.first, values), contribute(model.again, values)
    likely = np.isin(names, features.LIKELY)
    once[likely], twice[likely] = -np.inf, -np.inf
    found, again = names[once.argmax(axis=0)], names[twice.argmax(axis=0)]
    known = (first.score > np.float32(model.doubtful)) & (again != 'first')
    odds, strongest = np.empty(len(points), np.float32), np.empty(len(points), names.dtype)
    spread(some.pattern, second_pass(some, first, model), odds)
    spread(some.pattern, np.where(known, again, found), strongest)
    return odds, strongest


def names_of(found: Verdict) -> list[str]:
    """Name the reasons of all points; those that are not rejected have none."""
    assert np.array_equal(found.reason > 0, found.rejected)
    return [features.REASON_NAMES.get(number, '') for number in found.reason.tolist()]


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
    expected = np.zeros_like(values, np.float64)
    for k in range(60):
        for f, t, v in zip(trees.feature, trees.limit, trees.value, strict=True):
            point = values[:, k].tolist()
            for number, change in naive.additions(
                f.tolist(), t.tolist(), v.tolist(), point
            ).items():
                expected[number, k] += change
    assert contribute(trees, values) == pytest.approx(expected, abs=1e-4)


def assert_adds_up(added: NDArray[np.float32], odds: NDArray[np.floating], name: str) -> None:
    """Compare what is left of the log-odds with the averages of the passes; each judges some."""
    left = odds - added.sum(axis=0, dtype=np.float64)
    averages = [
        float(trees.start + trees.value.mean(axis=1, dtype=np.float64).sum())
        for trees in (load(name).first, load(name).again)
    ]
    near = np.abs(left[:, None] - averages) < 2e-3
    assert near.any(axis=1).all()
    assert near.any(axis=0).all()


@pytest.mark.parametrize('sensor', CLOUDS)
def test_contributions_add_up(sensor: str) -> None:
    """With the average they are the log-odds, of points of either pass; so are those of some."""
    points = CLOUDS[sensor].take(slice(0, None, 2))
    points = points.take(np.random.default_rng(4).integers(0, len(points), len(points)))  # copies
    parameters, every = FilterParameters(), np.ones(len(points), np.bool_)
    seen, selected = DetectorInput(points, parameters, 20), np.arange(len(points)) % 7 == 0
    found = contributions(seen, parameters, every)
    assert found.method == Method.PATTERN.value
    assert found.added.shape == (len(found.names), len(points))
    odds, _ = passes(points, sensor)
    assert_adds_up(found.added, odds, PROFILE_MODEL if sensor == 'profile' else PATTERN_MODEL)
    some = contributions(seen, parameters, selected)
    assert np.array_equal(some.added, found.added[:, selected])


@pytest.mark.parametrize('threads', [1, 3])
@pytest.mark.parametrize('sensor', CLOUDS)
def test_published_reason(sensor: str, threads: int) -> None:
    """It is the feature with the largest contribution; of the first pass if that is its result."""
    points = CLOUDS[sensor]
    points = points.take(np.random.default_rng(threads).permutation(len(points)))
    found = judged(points, threads=threads)
    expected = np.where(found.rejected, passes(points, sensor)[1], '')
    pairs = [*zip(names_of(found), expected.tolist(), strict=True)]
    assert {name for name, other in pairs if name != other} <= {*features.CAUSES}
    assert found.rejected.sum() > 30
    assert 'first' not in names_of(found)
    assert sensor == 'spinning' or {*names_of(found)} & {*features.PROFILE}


@pytest.mark.parametrize(
    ('asked', 'asked_again', 'expected'),
    [
        (['near3'], ['near3'], 'near3'),  # whatever is asked takes away
        (['near3'], ['first'], 'near3'),
        (['range'], ['range'], ''),
        (['range', 'leap'], ['range', 'beside'], 'beside'),
    ],
)
def test_only_what_trees_ask(asked: list[str], asked_again: list[str], expected: str) -> None:
    """A feature that no tree asks about is no reason, even where all others speak against it."""
    some = prepare(pattern_of(sweep(5, 0.2, columns=200)))

    def ask(names: list[str]) -> Trees:
        """Ask always the same, what no value is above: the least value is right."""
        every = [*features.WINDOW, *features.SECOND_PASS]
        feature = np.repeat([[every.index(name)] for name in names], 7, axis=1).astype(np.int32)
        value = np.tile(np.arange(-8, 0, dtype=np.float32), (len(names), 1))
        limit = np.full(feature.shape, np.inf, np.float32)
        return Trees(feature, limit, value, np.float32(0))

    model = TreeModel(ask(asked), ask(asked_again), -100.0, 0.0, 0.0)
    there = some.pattern.order >= 0
    found = strongest_of_trees(some, first_pass(some, model.first), model, there)
    found_names = {features.REASON_NAMES.get(number, '') for number in found[there].tolist()}
    assert found_names == {expected}


def test_scores_are_the_same_without_reasons() -> None:
    """Nothing is explained where scores are not published, and no score depends on it."""
    for points in CLOUDS.values():
        found, without = judged(points), judged(points, scores=False)
        assert found.score.tobytes() == without.score.tobytes()
        assert not without.reason.any()
        names_of(found)


def test_numbers_never_change() -> None:
    """Recorded clouds hold the numbers of reasons."""
    names = (
        '1:step 2:leap 3:along 4:along_m 5:between 6:beside 7:across 8:near3 9:near5 '
        '10:near5_m 11:before_own 12:behind_own 13:before_other 14:behind_other 15:level_own '
        '16:level_other 17:there_own 18:there_other 19:rough_own 20:rough_other 23:depth '
        '24:dense 25:sparse 26:bright 28:rank 65:first 66:first_own 67:first_other '
        '68:first_close 69:first_level 70:first_behind 71:first_before 72:wide_own 73:wide_other '
        '129:middle 130:agree 131:group 132:group_slope 133:group_width 134:group_advance '
        '135:group_length 136:height 193:between_surfaces 194:mirrored'
    )
    known = dict(one.split(':') for one in names.split())
    assert {int(number): name for number, name in known.items()} == features.REASON_NAMES


def test_survey_adds_up_to_the_log_odds() -> None:
    """With what the trees say on average; only requested points are given."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform((0, 0, 0), (30, 30, 0.05), (2000, 3))
    xyz[:20, 2] += rng.uniform(2, 9, 20)
    xyz[100:150] = xyz[50:100]  # two at one place
    points = points_of(xyz)
    parameters = FilterParameters()
    seen = DetectorInput(points, parameters, 20, whole=True)
    selected = rng.random(len(xyz)) < 0.3
    selected[:20] = True
    found = contributions(seen, parameters, selected)
    assert found.method == Method.NEIGHBOURS.value
    odds = survey.measure(xyz, measure_floor(xyz, np.arange(len(xyz))), whole=True)[0][selected]
    left = odds - found.added.sum(axis=0)
    is_lone = np.count_nonzero(found.added, axis=0) == 1
    assert 0 < np.count_nonzero(is_lone) < 20
    assert left[is_lone] == pytest.approx(MIN_LOG_ODDS, abs=2e-3)
    assert_adds_up(found.added[:, ~is_lone], odds[~is_lone], SURVEY_MODEL)


def test_reasons_without_a_scan_pattern() -> None:
    """Every rejected point says why: the feature that adds most, but how suspect it was before."""
    rng = np.random.default_rng(3)
    xyz = np.column_stack([rng.uniform(0, 20, (3000, 2)), rng.normal(0, 0.02, 3000)])
    xyz[:30, 2] += rng.uniform(2, 9, 30)
    zeros = np.zeros(len(xyz), np.int64)
    points, parameters = Points(xyz, zeros, zeros, zeros == 0), FilterParameters()
    chain = Chain(parameters.changed({'chain': ['boosted_trees'], 'scores': True}))
    chain.whole = True
    verdict = chain.judge(points)
    assert verdict.rejected[:30].sum() > 20
    np.testing.assert_array_equal(verdict.reason > 0, verdict.rejected)
    seen = DetectorInput(points, parameters, whole=True)
    found = contributions(seen, parameters, verdict.rejected)
    assert found.method == Method.NEIGHBOURS.value
    others = [k for k, name in enumerate(found.names) if name != 'first']
    strongest = np.array(others)[found.added[others].argmax(axis=0)]
    named = [reasons()[number].name for number in verdict.reason[verdict.rejected]]
    assert named == [found.names[k] for k in strongest]
    assert len(reasons()) <= MAX_CODES  # that a page can show
