# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Mixed pixels: found between two surfaces, which stay; what is judged is what loops judge."""

import numpy as np
import pytest
from helpers.scans import Drive, edges, measured, pattern_of, sweep
from naive import scan_pattern as naive

from lidar_outlier_filter.core.detectors.boosted_trees.features import REASON_NAMES, WINDOW
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    MIXED_MODEL,
    read_file,
)
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.parameters.filter import FilterParameters


def judged(points: Points, **changed: object) -> Verdict:
    """Judge a cloud by this detector, with reasons."""
    parameters = {'chain': ['mixed_pixels'], 'scores': True, **changed}
    return Chain(FilterParameters().changed(parameters)).judge(points)


def test_surfaces_stay() -> None:
    """Points between two walls are rejected and say why; both walls and a pole are kept."""
    points, mixed = edges()
    found = judged(points)
    assert found.rejected[mixed].mean() > 0.8
    assert not found.rejected[~mixed].any()
    assert {REASON_NAMES[n] for n in found.reason[found.rejected].tolist()} == {'between_surfaces'}
    assert not found.reason[~found.rejected].any()


def test_reasons_of_both_are_kept() -> None:
    """Where both vote, a point that only the trees on all causes reject keeps its reason."""
    points = sweep(4, 0.0, columns=900)
    found = judged(points, chain=['boosted_trees', 'mixed_pixels'], vote=1)
    assert np.array_equal(found.reason > 0, found.rejected)


def test_as_loops() -> None:
    """Points that stand off from both beside them in their ring have the sum of all trees."""
    points = sweep(1, 0.3, 1.3)
    pattern, data = pattern_of(points), read_file(MIXED_MODEL)
    out, trees = measured(pattern), data['trees']
    score, limit = judged(points).score, data['threshold'] - MIN_LOG_ODDS
    for line in range(len(pattern.first)):
        for k in range(pattern.first[line], pattern.last[line]):
            gaps = sorted(abs(float(pattern.range[k] - pattern.range[m])) for m in (k - 1, k + 1))
            odds = float(MIN_LOG_ODDS)
            if gaps[0] > np.float32(0.03) and gaps[1] > np.float32(0.12):
                point = dict(zip(WINDOW, out[:, k].tolist(), strict=True))
                odds = trees['start'] + sum(
                    naive.tree([*range(7)], at, value, [point[name] for name in names])
                    for names, at, value in zip(
                        trees['features'], trees['limits'], trees['values'], strict=True
                    )
                )
            expected = max(odds - MIN_LOG_ODDS, 0.0) / limit
            assert score[pattern.order[k]] == pytest.approx(expected, abs=1e-4)
    assert 0.02 < np.mean(score > 0) < 0.9


@pytest.mark.parametrize('points', [Drive(1).points, sweep(1, 0.0).take(slice(0, 10))])
def test_untested_without_rings(points: Points) -> None:
    """A profile scanner's points, and too few for a scan pattern, have no score."""
    assert np.isnan(judged(points).score).all()
