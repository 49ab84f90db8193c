# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive twin of the quadric detector gives the numbers that are worked out by hand."""

from math import sqrt

import numpy as np
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import t

from naive import quadric as naive
from naive.quadric import Fit, Frame, Growth, Rules

Floats = NDArray[np.float64]

H = 0.1
LEVEL = naive.Plane(
    np.eye(3)[::-1].copy(), np.zeros(3), np.ones(3), 1.0
)  # z = 0, x and y as they are


def corners() -> Floats:
    """Put two points on every corner of a square, H above it and H below."""
    return np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-H, H)], float)


def frame(points: Floats) -> Frame:
    """Give points unit variances, in the frame they are in."""
    return Frame(LEVEL, points, np.ones(len(points)))


def on_plane(points: Floats) -> Fit:
    """Fit a plane to the points, and measure it there and at (0, 0, 3 H)."""
    plane = naive.fit_plane(points, np.ones(len(points)))
    everywhere = np.vstack([points, [0, 0, 3 * H]])
    fit = naive.measure_plane(plane, everywhere, np.ones(len(everywhere)))
    fit.kept = list(range(len(points)))
    return fit


def test_plane() -> None:
    """Moments of the square are 8 and 8: Q is 1/8 for the height and for both tilts."""
    fit = on_plane(corners())
    assert_allclose(abs(fit.residual), [H] * 8 + [3 * H])
    assert_allclose(fit.lever, [3 / 8] * 8 + [1 / 8])
    assert_allclose(naive.deviation(fit), sqrt(8 * H**2 / 5))


def test_statistic() -> None:
    """σ̂0² = 8 H² / 5 and q_vv = 5/8: T = 1. Without its own part σ̂0² q_vv is H²: T = 1 too."""
    fit = on_plane(corners())
    outside = 3 / sqrt(8 / 5 * 9 / 8)
    paper = naive.scores_of(fit, Rules(0.05, 0, always_quadric=True), Growth(0))
    assert paper is not None
    assert_allclose(paper, np.append(np.ones(8), outside) / t.isf(0.025, 5))
    robust = naive.scores_of(fit, Rules(0.05, 0), Growth(0))
    assert robust is not None
    assert_allclose(robust, [*np.ones(8) / t.isf(0.025, 4), outside / t.isf(0.025, 5)])


def test_step() -> None:
    """Heights ±H over a square, the half of it at 2 H: the step lifts the plane, and Q is known."""
    points = corners()
    points[:, 2] += 2 * H
    solution = frame(points).step(np.eye(10)[3], np.ones(8), 4)
    assert solution is not None
    assert_allclose(solution.change, [-2 * H, 0, 0, 0], atol=1e-15)
    assert_allclose(solution.cofactor, np.diag([1 / 8, 1 / 8, 1 / 8, 0]), atol=1e-15)
    assert_allclose([solution.before, solution.after], [8 * (H**2 + 4 * H**2), 8 * H**2])


def ball(radius: float) -> Floats:
    """Spread points over a ball around (0, 0, 0): along three axes and towards eight corners."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    towards = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / sqrt(3)
    between = np.array([[3, 4, 0], [0, -3, 4], [-4, 0, 3]]) / 5
    return radius * np.vstack([axes, towards, between])


def test_ball() -> None:
    """Algebraic start: x² + y² + z² = R² exactly; residual ÷ slope is (r² - R²) / 2 r."""
    points = np.vstack([ball(2.0), [0, 0, 2.2]])
    there = frame(points)
    kept = list(range(17))
    a, gap = there.algebraic(kept)
    assert_allclose(a / a[4], [-4, 0, 0, 0, 1, 0, 1, 0, 0, 1], atol=1e-9)
    assert gap > 1e9
    slope, sigma2 = there.spread(a, kept)
    assert_allclose(abs(there.rows @ a / slope)[17], (2.2**2 - 4) / 4.4)
    assert_allclose(sigma2, slope**2)


def test_judge_of_a_plane() -> None:
    """A grid of ±1 cm: σ̂ 1 cm; a point 20 cm over its middle fails, the others do not."""
    grid = [[x / 5, y / 5, 0.01 * (-1) ** (x + y)] for x in range(6) for y in range(6)]
    scores = naive.judge([*grid, [0.5, 0.5, 0.2]], Rules())
    assert max(scores[:36]) < 1
    predicted = 0.01 * sqrt(36 / 33 * (1 + 1 / 36))
    assert_allclose(scores[36], 0.2 / predicted / t.isf(5e-7, 33), rtol=1e-3)
