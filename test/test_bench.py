# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark compares before it times, and times what it says."""

import numpy as np
import pytest

from lidar_outlier_filter.core.detectors import filterpy_engine
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation import bench


def test_engines_agree() -> None:
    """The kernel is timed only because its answer is the Kalman filter's."""
    bench.compare_engines()


def test_wrong_answers_are_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that finds no difference anywhere is noticed."""
    honest = filterpy_engine.residuals
    monkeypatch.setattr(filterpy_engine, 'residuals', lambda *given: 0.0 * honest(*given))
    with pytest.raises(FilterError, match="the kernel's answer must be the Kalman filter's"):
        bench.compare_engines()


def test_smoother_is_timed_on_all_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points per second are those of all lines."""
    monkeypatch.setattr(bench, 'LINES', 30)
    timing = bench.time_smoother('either')
    assert timing.points == 30_000
    assert timing.speed == timing.points / timing.seconds / 1e6


def test_peer_rejects_what_the_method_says() -> None:
    """A grid of 10 × 10 with one point far off: that one, and nothing else."""
    x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    grid = np.stack([x.ravel(), y.ravel(), np.zeros(100)], axis=1)
    far = np.array([[50.0, 50.0, 50.0]])
    assert np.flatnonzero(bench._scipy_sor(np.concatenate([grid, far]))).tolist() == [100]
