# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Chains that share what they see: the same verdicts, and points are looked at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import detector as weighted_sum
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.shared_sight import BLOCKS, SharedSight

THRESHOLDS = (0.4, 0.7, 1.0, 1.6)


def swung(seed: int) -> Points:
    """Scan a rough floor in lines, with points above it: a mirror that swings."""
    rng = np.random.default_rng(seed)
    x, y = np.divmod(np.arange(3000.0), 60)
    xyz = np.column_stack([x, y + rng.normal(0, 0.2, 3000), 0.05 * np.sin(x)])
    xyz[rng.choice(3000, 90, replace=False), 2] += rng.uniform(0.5, 6.0, 90)
    t = np.arange(3000) * 50_000
    return Points(xyz, t, x.astype(np.int64), np.ones(3000, np.bool_))


def chains() -> list[Chain]:
    """Make one for each threshold."""
    given = FilterParameters().changed({'scores': True})
    return [Chain(given.changed({'boosted_trees.threshold': one})) for one in THRESHOLDS]


def test_verdicts_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit those of chains by themselves; the first look is taken once for each block."""
    blocks = [swung(seed) for seed in range(3)]
    alone = [[chain.judge(points) for points in blocks] for chain in chains()]
    looks: list[int] = []
    look = weighted_sum.look_first

    def counted(*given: Any) -> weighted_sum.FirstLook:
        looks.append(1)
        return look(*given)

    monkeypatch.setattr(
        'lidar_outlier_filter.core.detectors.boosted_trees.ways.look_first', counted
    )
    sight = SharedSight()
    for chain, expected in zip(chains(), alone, strict=True):
        chain.see = sight
        for points, verdict in zip(blocks, expected, strict=True):
            again = points.take(slice(None))  # as another stream has them
            found = chain.judge(again)
            for name in ('score', 'detectors', 'rejected', 'reason'):
                assert getattr(found, name).tobytes() == getattr(verdict, name).tobytes()
        assert chain.ways.keys() == {'a weighted sum of features'}
    assert len(looks) == len(blocks) < BLOCKS
    assert 0 < np.count_nonzero(alone[0][0].rejected) > np.count_nonzero(alone[-1][0].rejected)


@pytest.mark.parametrize('name', ['xyz', 't', 'line'])
def test_other_points_are_looked_at(name: str) -> None:
    """One value of one point differs: it is another sight; so it is for a whole cloud."""
    sight, points, given = SharedSight(), swung(0), FilterParameters()
    seen = sight(points, given, 20, whole=False)
    assert sight(points.take(slice(None)), given, 20, whole=False) is seen
    assert sight(points, given, 20, whole=True) is not seen
    assert sight(points, given, 21, whole=False) is not seen
    other = points.take(np.arange(len(points)))
    getattr(other, name)[7] += 1
    assert sight(other, given, 20, whole=False) is not seen
