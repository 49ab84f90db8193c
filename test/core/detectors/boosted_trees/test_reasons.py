# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The reason that is published of a rejected point: the feature that adds most to its score."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers import ROOT
from helpers.profile_drives import Drive, prepared
from helpers.profile_drives import pattern_of as profile_of
from helpers.sweeps import pattern_of as spinning_of
from helpers.sweeps import sweep

from lidar_outlier_filter.core.detectors.boosted_trees.explain.pattern_reasons import contribute
from lidar_outlier_filter.core.detectors.boosted_trees.explain.reasons import (
    REASON_NAMES,
    strongest_of_trees,
)
from lidar_outlier_filter.core.detectors.boosted_trees.models import (
    PROFILE_MODEL,
    TreeModel,
    load,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.features import COUNT, FEATURES
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import first_pass
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.profile_features import (
    PROFILE,
    measure_profile,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import (
    AGAIN,
    COUNT_AGAIN,
    measure_again,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.window import prepare
from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from lidar_outlier_filter.core.detectors.boosted_trees.pattern.window import Prepared
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.core.verdict import Verdict

PAGE = ROOT / 'doc/detectors/boosted_trees.md'


def judged(points: Points, **changed: object) -> Verdict:
    """Judge a cloud, with reasons unless they are not wanted."""
    values = {name.replace('__', '.'): value for name, value in changed.items()}
    parameters = {'chain': ['boosted_trees'], 'scores': True, **values}
    return Chain(FilterParameters().changed(parameters)).judge(points)


def strongest(points: Points, some: Prepared, model: TreeModel, *more: str) -> list[str]:
    """Name the strongest feature of each point, of all that either pass measures."""
    pattern = some.pattern
    there, lines = pattern.order >= 0, len(pattern.first)
    first = first_pass(some, model.first)
    window = np.zeros((COUNT_AGAIN, len(there)), np.float32)
    measure_again(some, first, 0, lines, window)
    others = np.zeros((len(more), len(there)), np.float32)
    if more:
        measure_profile(some, 0, lines, others)
    values = np.concatenate([window[:COUNT], others, window[COUNT:]])
    names = np.array([*FEATURES, *more, *AGAIN])
    once, twice = np.zeros_like(values), np.zeros_like(values)
    contribute(model.first, values, there, once)
    contribute(model.again, values, there, twice)
    likely = np.isin(names, ['range', 'glare', 'share', 'share_range'])
    once[likely], twice[likely] = -np.inf, -np.inf
    found, again = names[once.argmax(axis=0)], names[twice.argmax(axis=0)]
    known = (first.score > np.float32(model.doubtful)) & (again != 'first')
    result = np.empty(len(points), names.dtype)
    result[pattern.order[there]] = np.where(known, again, found)[there]
    return [str(name) for name in result]


def names_of(found: Verdict) -> list[str]:
    """Name the reasons of all points; those that are not rejected have none."""
    assert np.array_equal(found.reason > 0, found.rejected)
    return [REASON_NAMES.get(number, '') for number in found.reason.tolist()]


@pytest.mark.parametrize('threads', [1, 3])
def test_spinning_sensor(threads: int) -> None:
    """Rejected points, in any order, have the strongest feature."""
    points = sweep(5, 0.2, 1.4, columns=200)
    points = points.take(np.random.default_rng(threads).permutation(len(points)))
    expected = strongest(points, prepare(spinning_of(points)), load())
    found = judged(points, threads=threads)
    assert names_of(found) == [
        name if out else '' for name, out in zip(expected, found.rejected, strict=True)
    ]
    assert found.rejected.sum() > 30


def test_profile_scanner() -> None:
    """The trees of profile scanners have features of their own."""
    points = Drive(12, 0.1, lines=20, shots=400, strays=0.03).points
    expected = strongest(points, prepared(profile_of(points)), load(PROFILE_MODEL), *PROFILE)
    found = judged(points)
    assert names_of(found) == [
        name if out else '' for name, out in zip(expected, found.rejected, strict=True)
    ]
    assert {*names_of(found)} & {*PROFILE}


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
    some = prepare(spinning_of(sweep(5, 0.2, columns=200)))

    def ask(names: list[str]) -> Trees:
        """Ask always the same, what no value is above: the least value is right."""
        every = [*FEATURES, *AGAIN]
        feature = np.repeat([[every.index(name)] for name in names], 7, axis=1).astype(np.int32)
        value = np.tile(np.arange(-8, 0, dtype=np.float32), (len(names), 1))
        limit = np.full(feature.shape, np.inf, np.float32)
        return Trees(feature, limit, value, np.float32(0))

    model = TreeModel(ask(asked), ask(asked_again), -100.0, 0.0, 0.0)
    there = some.pattern.order >= 0
    found = strongest_of_trees(some, first_pass(some, model.first), model, there)
    assert {REASON_NAMES.get(number, '') for number in found[there].tolist()} == {expected}


def test_scores_are_the_same_without_reasons() -> None:
    """Nothing is explained where scores are not published, and no score depends on it."""
    for points in (sweep(6, 0.1), Drive(13).points):
        found, without = judged(points), judged(points, scores=False)
        assert found.score.tobytes() == without.score.tobytes()
        assert not without.reason.any()
        names_of(found)


def test_page_lists_the_numbers() -> None:
    """The documentation names every number, and no other."""
    rows = re.findall(r'^\| (\d+) \| `(\w+)` \|', PAGE.read_text(encoding='utf-8'), re.MULTILINE)
    assert {int(number): name for number, name in rows} == REASON_NAMES
