# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Lines that could be a scan pattern are one only if neighbouring lines resemble each other."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import Drive, road, sweep

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose, find_either
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.engine.whole_cloud import judge_whole
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.scan_pattern.resemblance import is_plausible
from lidar_outlier_filter.parameters.filter import FilterParameters

UTM = np.array([4e5, 5e6, 100.0])


def strip(up: float = 500.0, swing: float = 0.35, returns: int = 4) -> Points:
    """Return an airborne strip with a swinging mirror, 60 m/s, whose returns are numbered apart.

    Every line holds one return number of the whole strip, as where no flag ends lines.
    """
    rng = np.random.default_rng(3)
    t = np.arange(3_000) / 5_000
    angle = swing * np.sin(2 * np.pi * 40 * t)
    xyz = np.stack([60 * t, up * np.tan(angle), np.zeros_like(t)], axis=1)
    all_t = np.tile(np.rint(t * SECOND).astype(np.int64), returns)
    line = np.repeat(np.arange(returns), len(t))
    ground = np.tile(xyz, (returns, 1))
    ground[:, 2] = 12.0 - 4.0 * line + rng.normal(0, 0.05, len(line))
    ground += UTM + np.where(line[:, None] > 0, rng.normal(0, 0.4, ground.shape), 0.0)
    return Points(ground, all_t, line, np.ones(len(line), np.bool_))


def test_a_strip_is_no_spinning_sensor() -> None:
    """Far from the map's origin it could pass for one that turns slowly."""
    points = strip()
    found = find_either(points, 'auto')
    assert found is None or not is_plausible(found.pattern)
    parameters = FilterParameters()
    seen = DetectorInput(points, parameters, whole=True)
    assert choose(seen, parameters)[0] is Method.NEIGHBOURS
    rejected = judge_whole(points, parameters).rejected
    assert np.count_nonzero(rejected) < 0.01 * len(points)


@pytest.mark.parametrize('points', [sweep(5, 0.1, columns=200), Drive(11, 0.1).points, road(3)[0]])
def test_patterns_are_plausible(points: Points) -> None:
    """A sweep, a drive and the lines of a profile scanner."""
    found = find_either(points, 'auto')
    assert found is not None
    assert is_plausible(found.pattern)


def moved(points: Points) -> Floats:
    """Return where points are in a map that a vehicle moves through at 8 m/s."""
    away = np.stack([8e-9 * (points.t - points.t.min()), *np.zeros((2, len(points)))], axis=1)
    there: Floats = points.xyz + UTM + away
    return there


def test_a_sweep_in_a_map_is_seen_from_its_sensor() -> None:
    """Seen from the map's origin it is none; its own frame is found behind that."""
    points = sweep(5, 0.1, columns=400)
    found = find_either(replace(points, xyz=moved(points), own=None), 'auto')
    assert found is None or is_plausible(found.pattern)
