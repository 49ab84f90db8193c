# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a page counts and groups, with numbers worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.evaluation.labels import Codes
from lidar_outlier_filter.report import worst
from lidar_outlier_filter.report.pack import BAD, GOOD, NO_TRUTH, _truth
from lidar_outlier_filter.report.tally import LARGEST_SCORE, SCORE_BINS, Tally
from lidar_outlier_filter.report.worst import connect, find

CODES = Codes(outliers=frozenset({1}), ignored=frozenset({9}))


def points(xyz: np.ndarray) -> Points:
    """Make points at one time on one line."""
    zeros = np.zeros(len(xyz), np.int64)
    return Points(xyz=xyz, t=zeros, line=zeros, valid=np.ones(len(xyz), np.bool_))


def test_scores_are_counted_in_their_bins() -> None:
    """The first bin begins at 0; the last holds what is larger than the largest, too."""
    width = LARGEST_SCORE / SCORE_BINS
    score = [0, 0.9 * width, width, LARGEST_SCORE - width / 2, LARGEST_SCORE, 1000, np.inf, np.nan]
    verdict = Verdict.untested(len(score))
    verdict.score[:] = score
    cloud: Any = SimpleNamespace(
        verdict=verdict, points=points(np.zeros((len(score), 3))), code=None, number=0
    )
    tally = Tally(CODES)
    tally.add(cloud)
    expected = np.zeros(SCORE_BINS, int)
    expected[[0, 1, SCORE_BINS - 1]] = 2, 1, 4
    assert tally.scores[0].tolist() == expected.tolist()
    assert (tally.untested, tally.scores[1].sum()) == (1, 0)


def test_truth_of_points_without_a_code() -> None:
    """A point of a cloud without labels is neither good nor bad on the page."""
    gathered: Any = SimpleNamespace(tally=SimpleNamespace(has_truth=True), codes=CODES)
    code = np.array([0, 1, 9, -1], np.int32)
    assert _truth(gathered, code).tolist() == [GOOD, BAD, NO_TRUTH, NO_TRUTH]


@pytest.mark.parametrize(
    ('step', 'groups'),
    [((1, 0, 0), 1), ((1, 1, 0), 1), ((1, 1, 1), 1), ((2, 0, 0), 2), ((2, 1, 1), 2)],
)
def test_cells_that_touch(step: tuple[int, int, int], groups: int) -> None:
    """By a face, an edge or a corner; with a cell between they are two groups."""
    xyz = np.array([[0.5, 0.5, 0.5], np.add(step, 0.5)]) * 0.3
    assert len(np.unique(connect(xyz, 0.3))) == groups


def test_the_worst_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large groups before small ones; of equal ones that with the highest score."""
    monkeypatch.setattr(worst, 'typical_scale', lambda *_: 1.0)
    x = np.array([0, 10, 10.5, 20, 30, 30.5, 40], float)  # groups of 1, 2, 1, 2, 1
    judged: Any = SimpleNamespace(
        loaded=SimpleNamespace(points=points(np.c_[x, x * 0, x * 0])),
        verdict=Verdict.untested(len(x)),
        high=np.zeros(len(x), np.bool_),
        units=np.ones(3),
    )
    judged.verdict.rejected[:] = True
    judged.verdict.score[:] = [5, 2, 3, 9, 4, 1, 7]
    assert [group.members.tolist() for group in find(judged).groups] == [
        [4, 5],
        [1, 2],
        [3],
        [6],
        [0],
    ]
