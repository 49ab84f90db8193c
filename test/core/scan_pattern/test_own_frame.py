# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of spinning sensors that others have moved are judged in the sensor's own frame."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.scans import points_of

from lidar_outlier_filter.core.detectors.boosted_trees.methods import Method, choose
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.scan_pattern.own_frame import find_own_frame
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.simulation.world.trajectory import Route

RINGS, COLUMNS = 16, 900
WALLS = np.array([[25.0, -15.0], [12.0, -8.0], [8.0, -1.9]])  # m: of a hall, in each direction
CURVE = Route(((0.0, 8.0, 0.3), (1.0, 12.0, 0.5)), start=(310.0, -120.0, 0.7), bump=0.03)


def turn_of_a_head(offsets: float = 0.0) -> Points:
    """Return a turn in a hall in the sensor's frame, with noise of 1 cm, and snow beside it."""
    rng = np.random.default_rng(5)
    t = np.repeat(np.arange(COLUMNS) * (SECOND // 10) // COLUMNS, RINGS)
    ring = np.tile(np.arange(RINGS), COLUMNS)
    azimuth = 1.0 - 2.0 * np.pi * t / (SECOND // 10) + offsets * (ring % 4)
    up = np.radians(np.linspace(-15.0, 15.0, RINGS))[ring]
    ray = np.stack([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], 1)
    walls = np.where(ray > 0, WALLS[:, 0], WALLS[:, 1])
    far = (walls / ray).min(axis=1)
    far += rng.normal(0.0, 0.01, len(far))
    falls = rng.random(len(far)) < 0.01
    far[falls] *= rng.uniform(0.2, 0.8, np.count_nonzero(falls))
    return points_of(ray * far[:, None], t, ring)


def moved(points: Points, away: float = 0.0) -> Points:
    """Move points along a curve, each at its time."""
    seconds = points.t / SECOND
    turned = np.einsum('ijn,nj->ni', CURVE.rotation(seconds), points.xyz + np.array(CURVE.mount))
    return replace(points, xyz=turned + CURVE.position(seconds).T + away)


@pytest.mark.parametrize(('offsets', 'away'), [(0.0, 0.0), (0.05, 0.0), (0.0, 4e6)])
def test_the_sensor_is_found(offsets: float, away: float) -> None:
    """Within 2 cm and about a degree, wherever it drives; rings may point to one side."""
    points = turn_of_a_head(offsets)
    found = find_own_frame(moved(points, away))
    assert found is not None
    assert found.own is not None
    assert np.abs(found.range - points.range).max() < 0.02
    up = found.own[:, 2] / found.range - points.xyz[:, 2] / points.range
    # It leans by a degree more and less on its way.
    assert np.median(np.abs(up)) < 0.003
    assert np.abs(up).max() < 0.02
    turned = np.arctan2(found.own[:, 1], found.own[:, 0])
    turned = np.angle(np.exp(1j * (turned - np.arctan2(points.xyz[:, 1], points.xyz[:, 0]))))
    assert np.ptp(turned) < 0.04  # the vehicle itself turns by 0.03 rad


def test_trees_judge_what_others_moved() -> None:
    """As they judge the same points in the sensor's own frame."""
    parameters = FilterParameters()
    own, given = turn_of_a_head(), moved(turn_of_a_head())
    method, _ = choose(DetectorInput(given, parameters, 20), parameters)
    assert method is Method.PATTERN
    selected, found = (Chain(parameters).judge(points).rejected for points in (own, given))
    assert np.count_nonzero(selected) > 100
    assert np.mean(selected != found) < 0.001


def test_two_returns_of_a_shot() -> None:
    """They have one time: the step of the head is that between two shots."""
    given = moved(turn_of_a_head())
    assert find_own_frame(given.take(np.repeat(np.arange(len(given)), 2))) is not None


def test_order_does_not_matter() -> None:
    """Points of a stream may come in any order: the result is the same, bit for bit."""
    given = moved(turn_of_a_head())
    order = np.random.default_rng(1).permutation(len(given))
    one, other = find_own_frame(given), find_own_frame(given.take(order))
    assert one is not None
    assert other is not None
    assert one.own is not None
    assert other.own is not None
    assert np.array_equal(one.own[order], other.own)


CHANGES: dict[str, Callable[[Points], Points]] = {
    'unsteady': lambda it: replace(it, t=it.t + np.rint(4e6 * np.sin(it.t / 2e6)).astype(int)),
    'anywhere': lambda it: replace(it, xyz=np.random.default_rng(2).uniform(-20, 20, it.xyz.shape)),
    'at one place': lambda it: replace(it, xyz=np.ones_like(it.xyz)),
    'seconds apart': lambda it: replace(it, t=it.t - (it.t < SECOND // 20) * 5 * SECOND),
    'three rings': lambda it: it.take(it.line < 3),
    'ring by ring': lambda it: replace(it, t=it.t + it.line * SECOND),
    'on its side': lambda it: replace(it, xyz=it.xyz[:, [2, 1, 0]] + 50.0),
}


@pytest.mark.parametrize('name', CHANGES)
def test_no_frame_is_made_up(name: str) -> None:
    """Points that no steadily turning head sees have none."""
    assert find_own_frame(CHANGES[name](turn_of_a_head())) is None
