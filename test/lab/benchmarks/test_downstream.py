# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The measures of odometry and maps, on clouds and poses that are worked out by hand."""

import sys
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from numpy.typing import NDArray

from lidar_outlier_filter.core.points.points import Points

sys.path.insert(0, str(ROOT / 'benchmarks'))
downstream: Any = import_module('downstream')

AHEAD = np.eye(4)
LEFT = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def pose(x: float, y: float, turned: NDArray[np.float64] = AHEAD) -> NDArray[np.float64]:
    """Make a pose at a place."""
    result = turned.copy()
    result[:2, 3] = x, y
    return result


def sweep(*xyz: tuple[float, float, float]) -> Points:
    """Make a sweep of a few points."""
    zeros = np.zeros(len(xyz), np.int64)
    return Points(np.array(xyz, np.float64), zeros, zeros, np.ones(len(xyz), np.bool_))


def test_drift() -> None:
    """The start of a drive, and its heading there, are no drift."""
    truth = [pose(0, 0), pose(3, 0), pose(6, 0)]
    assert downstream.drift(truth, truth) == 0
    moved = [pose(9, 9, LEFT), pose(9, 12, LEFT), pose(9, 15, LEFT)]
    assert downstream.drift(moved, truth) == pytest.approx(0)
    assert downstream.drift([*truth[:2], pose(6, 0.5)], truth) == pytest.approx(0.5)


def test_cells() -> None:
    """A cell is filled by any point that a vehicle would drive into, wherever the sweep was."""
    first = sweep((0.1, 0.1, 0), (0.15, 0.1, 1), (0.1, 0.1, -1.9), (0.1, 0.1, 5), (-0.1, 0, 0))
    second = sweep((0.1, -1.1, 0), (7.1, 0, 0))
    masks = [np.array([True] * 4 + [False]), np.array([True, True])]
    found = downstream.cells([first, second], masks, [pose(0, 0), pose(0, 0, LEFT)], ground=-1)
    assert found == {(0, 0), (5, 0), (0, 35)}
