# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter and RTS smoother of filterpy are the smoother of the paper, to 1e-6."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from naive import alpha_beta_gamma as naive
from numpy.testing import assert_allclose

from lidar_outlier_filter.core.detectors.alpha_beta_gamma import kalman
from lidar_outlier_filter.errors import FilterError, ParameterError

# Times of windows in shots, relative to the tested one.
WINDOWS: dict[str, list[float]] = {
    'uniform': [-5, -4, -3, -2, -1, 1, 2, 3, 4, 5],
    'end of a segment': [-5, -4, -3, -2, -1],
    'irregular': [-4.1, -3.9, -1.2, -1.1, 0.3, 2.0, 4.9],
    'ties': [-3, -3, -2, 0, 0, 2, 2],
    'missing shots': [-14, -13, -12, 3, 4],
    'almost together': [-5, -4.99, -4.98, -1],
}
SIGMA = 0.01  # metres


@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('name', WINDOWS)
def test_prediction_is_that_of_the_paper(name: str, order: int) -> None:
    """Equations (15) and (16) with unequal variances, near the origin and far from it."""
    rng = np.random.default_rng(len(name))
    u = np.array(WINDOWS[name])
    t = 1e-5 * u
    sigma = SIGMA * rng.uniform(0.3, 3.0, len(t))
    z = np.stack([0.02 * u, 3 - 0.01 * u + 0.004 * u**2, 0.3 * u], axis=1)
    z += rng.normal(size=z.shape) * sigma[:, None]
    expected, spread = naive.predict(t.tolist(), z, (sigma**2).tolist(), SIGMA**2, order)
    position, q = kalman.predict(t, z, sigma**2, order)
    assert q == pytest.approx(spread, rel=1e-6)
    assert_allclose(position, expected, rtol=0, atol=1e-6 * np.sqrt(spread))
    origin = np.array([4_500_000.0, 390_000.0, 120.0])
    far, _ = kalman.predict(t, z + origin, sigma**2, order)
    assert_allclose(far - origin, position, rtol=0, atol=1e-7)


@pytest.mark.parametrize(('t', 'order'), [([1.0, 1.0, 2.0, 2.0], 2), ([3.0, 3.0], 1), ([], 1)])
def test_too_few_different_times_are_refused(t: list[float], order: int) -> None:
    """Where the points leave the state open there is no prediction to give."""
    match = f'window must be of {order + 1} or more different times, got {len(set(t))}'
    with pytest.raises(FilterError, match=match):
        kalman.predict(np.array(t), np.zeros((len(t), 3)), np.ones(len(t)), order)


def test_missing_filterpy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the package the engine is refused by name."""
    monkeypatch.setitem(sys.modules, 'filterpy', None)
    monkeypatch.setitem(sys.modules, 'filterpy.kalman', None)
    match = r"alpha_beta_gamma.engine must be 'kernel' where the .* filterpy is not installed"
    with pytest.raises(ParameterError, match=match):
        kalman.check_installed()
