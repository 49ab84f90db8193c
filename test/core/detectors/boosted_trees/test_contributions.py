# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What features add: their sums are what judged."""

from __future__ import annotations

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.explain.explanation import contributions
from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method
from lidar_outlier_filter.core.detectors.boosted_trees.survey import judge as survey
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.neighbours.floor import look_around
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.parameters.filter import FilterParameters


def test_survey_adds_up_to_the_log_odds() -> None:
    """With what the trees say on average; only wanted points are given."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform((0, 0, 0), (30, 30, 0.05), (2000, 3))
    xyz[:20, 2] += rng.uniform(2, 9, 20)
    xyz[100:150] = xyz[50:100]  # two at one place
    zeros = np.zeros(len(xyz), np.int64)
    points = Points(xyz, zeros, zeros, np.ones(len(xyz), np.bool_))
    parameters = FilterParameters()
    seen = DetectorInput(points, parameters, 20, whole=True)
    wanted = rng.random(len(xyz)) < 0.3
    wanted[:20] = True
    found = contributions(seen, parameters, wanted)
    assert found.way == Method.NEIGHBOURS.value
    odds = survey.measure(xyz, look_around(xyz, np.arange(len(xyz))))
    total = found.added.sum(axis=0, dtype=np.float64) + found.average
    np.testing.assert_allclose(total, odds[wanted], atol=2e-4)
    assert len(np.unique(found.average)) == 2  # both passes judge some of them
