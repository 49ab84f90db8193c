# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter and RTS smoother of filterpy are the smoother of the paper, to 1e-6."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from naive import alpha_beta_gamma as naive
from numpy.testing import assert_allclose

from lidar_outlier_filter.core.detectors.alpha_beta_gamma import kalman as filterpy_engine
from lidar_outlier_filter.errors import FilterError, ParameterError

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats

SHOT = 1e-5  # seconds

# Times of windows in shots, relative to the tested one.
WINDOWS: dict[str, list[float]] = {
    'uniform': [-5, -4, -3, -2, -1, 1, 2, 3, 4, 5],
    'start of a segment': [1, 2, 3, 4, 5, 6, 7, 8, 9, 10],
    'end of a segment': [-5, -4, -3, -2, -1],
    'irregular': [-4.1, -3.9, -1.2, -1.1, 0.3, 2.0, 4.9],
    'irregular end': [-5.0, -4.6, -2.2, -1.9, -0.4],
    'ties': [-3, -3, -2, 0, 0, 2, 2],
    'four': [-1, 1, 2, 3],
    'missing shots': [-14, -13, -12, 3, 4],
    'almost together': [-5, -4.99, -4.98, -1],
    'long': [float(i) for i in range(-20, 21) if i],
}
SIGMA = 0.01  # metres


def window(name: str, *, unequal: bool) -> tuple[Floats, Floats, Floats]:
    """Make times (s), noisy positions along a curve (m) and variances (m²) of a window."""
    rng = np.random.default_rng(len(name))
    t = np.array(WINDOWS[name]) * SHOT
    u = t / SHOT
    z = np.stack([0.02 * u, 3 - 0.01 * u + 0.004 * u**2, 0.3 * u], axis=1)
    sigma = SIGMA * (rng.uniform(0.3, 3.0, len(t)) if unequal else np.ones(len(t)))
    return t, z + rng.normal(size=z.shape) * sigma[:, None], sigma**2


@pytest.mark.parametrize('unequal', [False, True])
@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('name', WINDOWS)
def test_state_and_variance_are_those_of_the_paper(name: str, order: int, *, unequal: bool) -> None:
    """Equations (5) to (10), the tested point's own measurement among the others."""
    t, z, variance = window(name, unequal=unequal)
    own = np.array([[0.01, 2.98, -0.02]])
    t, z, variance = np.append(t, 0.0), np.concatenate([z, own]), np.append(variance, SIGMA**2)
    expected, spread = naive.smoothed_state(t.tolist(), z, variance.tolist(), order)
    state, covariance = filterpy_engine.states(t, z, variance, order, 0.0)
    deviation = np.sqrt(spread)[:, None]
    assert_allclose(np.diag(covariance), spread, rtol=1e-6)
    assert_allclose(state / deviation, expected / deviation, rtol=0, atol=1e-6)


@pytest.mark.parametrize('unequal', [False, True])
@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('name', WINDOWS)
def test_prediction_is_that_of_the_paper(name: str, order: int, *, unequal: bool) -> None:
    """Equations (15) and (16), in units of the standard deviation of the prediction."""
    t, z, variance = window(name, unequal=unequal)
    expected, spread = naive.predict(t.tolist(), z, variance.tolist(), SIGMA**2, order)
    position, q = filterpy_engine.predict(t, z, variance, order)
    assert q == pytest.approx(spread, rel=1e-6)
    assert_allclose(position, expected, rtol=0, atol=1e-6 * np.sqrt(spread))


@pytest.mark.parametrize('order', [1, 2])
def test_covariance_is_the_inverse_of_the_normal_matrix(order: int) -> None:
    """All of the covariance, not its diagonal only: (14) with δ² / 2 for the acceleration."""
    t, z, variance = window('irregular', unequal=True)
    design = np.stack([np.ones_like(t), t, t**2 / 2], axis=1)[:, : order + 1]
    design = design * SHOT ** -np.arange(order + 1)  # to invert numbers of a size
    inverse = np.linalg.inv(design.T @ (design / variance[:, None]))
    _, covariance = filterpy_engine.states(t, z, variance, order, 0.0)
    scale = SHOT ** np.arange(order + 1)
    assert_allclose(covariance * np.outer(scale, scale), inverse, rtol=1e-9)


def test_state_at_another_time() -> None:
    """The window's times are in the scale of ``at``: a parabola without noise is found anywhere."""
    t = 100.0 + np.array([0.0, 0.1, 0.2, 0.35, 0.5])
    z = np.stack([t, 2 - t, (t - 100) ** 2], axis=1)
    state, _ = filterpy_engine.states(t, z, np.ones(5), 2, 100.2)
    expected = np.array([[100.2, -98.2, 0.04], [1, -1, 0.4], [0, 0, 2]])
    assert_allclose(state, expected, rtol=1e-9, atol=1e-9)


def test_large_coordinates_keep_their_digits() -> None:
    """A prediction at 4 500 000 m is the one at 0 m, to the last digits of a float64 there."""
    t, z, variance = window('uniform', unequal=True)
    origin = np.array([4_500_000.0, 390_000.0, 120.0])
    near, q = filterpy_engine.predict(t, z, variance, 2)
    far, far_q = filterpy_engine.predict(t, z + origin, variance, 2)
    assert_allclose(far - origin, near, rtol=0, atol=5e-9)
    assert far_q == q


@pytest.mark.parametrize(
    ('t', 'order'), [([1.0, 1.0, 2.0, 2.0], 2), ([3.0, 3.0], 1), ([0.0, 0.0, 0.0], 1), ([], 1)]
)
def test_too_few_different_times_are_refused(t: list[float], order: int) -> None:
    """Where the points leave the state open there is no prediction to give."""
    match = f'window must be of {order + 1} or more different times, got {len(set(t))}'
    with pytest.raises(FilterError, match=match):
        filterpy_engine.predict(np.array(t), np.zeros((len(t), 3)), np.ones(len(t)), order)


def test_missing_filterpy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the optional package the engine is refused by name."""
    monkeypatch.setitem(sys.modules, 'filterpy', None)
    monkeypatch.setitem(sys.modules, 'filterpy.kalman', None)
    match = r"alpha_beta_gamma.engine must be 'kernel' where the .* filterpy is not installed"
    with pytest.raises(ParameterError, match=match):
        filterpy_engine.check_installed()


@pytest.mark.slow
def test_filterpy_is_imported_on_first_use_only() -> None:
    """Importing the engine must not need the optional package."""
    name = filterpy_engine.__name__
    code = f'import sys, {name} as engine; before = "filterpy" in sys.modules; '
    code += 'engine.check_installed(); sys.exit(before or "filterpy" not in sys.modules)'
    subprocess.run([sys.executable, '-c', code], check=True)
