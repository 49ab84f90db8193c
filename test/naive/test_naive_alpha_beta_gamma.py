# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive twin against numbers worked out by hand: who else would test the reference."""

import math
from math import nan, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from naive import alpha_beta_gamma as naive

# Critical values as printed in any table, for a significance of 0.001.
NORMAL = 3.290526731

FIVE = [-2.0, -1.0, 0.0, 1.0, 2.0]
ONES = [1.0] * 5
SECOND = 1_000_000_000

HAND: dict[str, Any] = {
    'before': 2,
    'after': 2,
    'order': 1,
    'significance': 0.001,
    'sides': 'both',
    'sigma': 1.0,
    'sigma_floor': 0.005,
    'min_window': 2,
    'passes': 10,
}


def run(
    z: list[float], own_sigma: list[float] | None = None, **changed: Any
) -> tuple[NDArray[np.float64], list[int], int]:
    """Judge one segment with a shot each second, x = y = 0; gives scores, rejected, passes."""
    count = len(z)
    zeros = np.zeros(count, np.int64)
    xyz = np.zeros((count, 3))
    xyz[:, 2] = z
    own = None if own_sigma is None else np.array(own_sigma)
    scores, rejected, passes = naive.alpha_beta_gamma(
        np.arange(count) * SECOND, xyz, zeros, zeros, own_sigma=own, **{**HAND, **changed}
    )
    return scores, np.flatnonzero(rejected).tolist(), passes


# Lines and segments ---------------------------------------------------------------------------


def test_segment_ends_only_above_the_gap_factor() -> None:
    """Interval 10: a difference of exactly 1.5 × 10 does not end a segment, one of 16 does."""
    assert naive.segments([0, 10, 20, 35], [0] * 4, 1.5) == [0, 0, 0, 0]
    assert naive.segments([0, 10, 20, 36], [0] * 4, 1.5) == [0, 0, 0, 1]


def angle_lines(*degrees: float) -> list[int]:
    """Give the lines of angles in degrees."""
    return naive.angle_lines([math.radians(one) for one in degrees])


def test_a_line_begins_where_the_angle_wraps() -> None:
    """At any time where the step is more than half a turn; the first angle ever is no wrap."""
    assert angle_lines() == []
    assert angle_lines(170) == [0]
    assert angle_lines(170, -170) == [0, 1]
    assert angle_lines(350, 10, 20) == [0, 1, 1]
    assert angle_lines(90, -90, 90) == [0, 0, 0]


def test_a_line_begins_where_the_angle_jumps_back() -> None:
    """Once the steps have gone 30° one way, a jump back by more than that begins a line."""
    assert angle_lines(0, 20, 40, 5, 25) == [0, 0, 0, 1, 1]
    assert angle_lines(0, -20, -40, -5, -25) == [0, 0, 0, 1, 1]
    assert angle_lines(0, 20, 40, 10, 30) == [0] * 5  # 30°, no more
    assert angle_lines(0, 20, 29, -10, 10) == [0] * 5  # no sense yet
    assert angle_lines(0, 20, 40, 110, 180) == [0] * 5  # forwards


def test_noise_at_the_wrap_begins_one_line() -> None:
    """Behind a wrap, the way back over it and the next wrap are noise."""
    assert angle_lines(140, 160, 175, -175, 178, -178, -170) == [0, 0, 0, 1, 1, 1, 1]


# Windows ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('p', 'm', 'window'),
    [
        (4, 10, [2, 3, 5, 6, 7]),
        (1, 10, [0, 2, 3, 4, 5]),
        (0, 10, [1, 2, 3, 4, 5]),
        (7, 10, [4, 5, 6, 8, 9]),
        (9, 10, [4, 5, 6, 7, 8]),
        (1, 4, [0, 2, 3]),
        (0, 1, []),
    ],
)
def test_centred_window_is_shifted_inwards(p: int, m: int, window: list[int]) -> None:
    """2 in front and 3 behind: six with the point itself, wherever it is."""
    assert naive.centred_window(p, m, 2, 3) == window


# The smoother -----------------------------------------------------------------------------------


def test_weights_of_five_equidistant_points() -> None:
    """Sums of δ⁰, δ², δ⁴ are 5, 10, 34, so λ = (34, 0, -10) / (5 × 34 - 10²).

    That is a = (17 - 5 δ²) / 35, and likewise b = δ / 10 and, twice (13), c = 2 (δ² - 2) / 14:
    the well-known weights of Savitzky and Golay.
    """
    a, b, c = naive.smoother_weights(FIVE, ONES, 2)
    assert_allclose(a, np.array([-3, 12, 17, 12, -3]) / 35, atol=1e-15)
    assert_allclose(b, np.array([-2, -1, 0, 1, 2]) / 10, atol=1e-15)
    assert_allclose(c, np.array([2, -1, -2, -1, 2]) / 7, atol=1e-15)


def weights_of_prediction(
    delta: list[float], variance: list[float], own: float, order: int
) -> tuple[NDArray[np.float64], float]:
    """Predict unit impulses at the points one by one: the weights of (15), and q."""
    weights, q = [], nan
    for i in range(len(delta)):
        impulse = np.zeros((len(delta), 3))
        impulse[i] = 1.0
        position, q = naive.predict(delta, impulse, variance, own, order)
        weights.append(position[0])
    return np.array(weights), q


PREDICTIONS = {
    # a without its middle, over 1 - 17/35; q = a_0 / (1 - a_0) = 17/18
    'five equidistant': ([-2.0, -1.0, 1.0, 2.0], 2, [-1 / 6, 2 / 3, 2 / 3, -1 / 6], 17 / 18),
    # 2 z(-1) - z(-2), and the third difference is 0: 3 z(-1) - 3 z(-2) + z(-3)
    'end of a line': ([-2.0, -1.0], 1, [-1.0, 2.0], 5.0),
    'end of a parabola': ([-3.0, -2.0, -1.0], 2, [1.0, -3.0, 3.0], 19.0),
    # interpolation between -1 and 2; Lagrange's polynomials of -1, 1, 2 at 0
    'irregular line': ([-1.0, 2.0], 1, [2 / 3, 1 / 3], 5 / 9),
    'irregular parabola': ([-1.0, 1.0, 2.0], 2, [1 / 3, 1.0, -1 / 3], 11 / 9),
}


@pytest.mark.parametrize('name', PREDICTIONS)
@pytest.mark.parametrize('own', [1.0, 100.0])
def test_prediction(name: str, own: float) -> None:
    """(15) and the second term of (16), whatever the tested point's own variance is."""
    delta, order, weights, q = PREDICTIONS[name]
    got, got_q = weights_of_prediction(delta, [1.0] * len(delta), own, order)
    assert_allclose(got, weights, atol=1e-12)
    assert got_q == pytest.approx(q, rel=1e-12)


# The test ---------------------------------------------------------------------------------------


def test_robust_sigma() -> None:
    """Ten residuals 0 to 9 (x), halved where 1 + q = 4; constant (y); below the floor (z).

    Reduced x: 0, 1, 2, 3, 4 and 5/2, 6/2, 7/2, 8/2, 9/2: median (3 + 3) / 2.
    """
    residuals = [np.array([-float(i), 7.0, 0.001]) for i in range(10)]
    qs = [0.0] * 5 + [3.0] * 5
    for r, q in zip(residuals, qs, strict=True):
        r[1] *= sqrt(1 + q)
    sigma = naive.robust_sigma(residuals, qs, 0.005)
    assert_allclose(sigma, [1.4826 * 3, 1.4826 * 7, 0.005])


# Passes -----------------------------------------------------------------------------------------


def test_outlier_of_ten_sigma_in_one_pass() -> None:
    """Seven points, the fourth 10 high, straight line through four others, σ = 1.

    Fourth: predicted 0 with q = 1/4. Third: from -2, -1, 1, 2 s, 10/4 with q = 1/4. Second: from
    -1, 1, 2, 3 s the weight at 2 is (15 - 5 × 2) / 35 = 1/7, q = 15/35. First: from 1, 2, 3, 4 s
    the weight at 3 is (30 - 10 × 3) / 20 = 0.
    """
    scores, rejected, passes = run([0, 0, 0, 10, 0, 0, 0], passes=1)
    third = 2.5 / sqrt(5 / 4) / NORMAL
    second = (10 / 7) / sqrt(10 / 7) / NORMAL
    fourth = 10 / sqrt(5 / 4) / NORMAL
    assert_allclose(scores, [0, second, third, fourth, third, second, 0], rtol=1e-9, atol=1e-15)
    assert rejected == [3]
    assert passes == 1


def test_good_point_between_two_equal_outliers_is_saved() -> None:
    """Outliers of 10 at 3 and 5 s: both are 7.5 from prediction, point 4 is 5 from it, a candidate.

    Pass 1 rejects the first of the equals. Pass 2 predicts point 4 from -3, -2, 1, 2 s, where the
    weight at 1 is (18 + 2) / 68 and q = 18/68; point 5 from -3, -1, 1, 2 s with q = 15/59, all 0.
    Pass 3 has nothing left to reject.
    """
    z: list[float] = [0, 0, 0, 10, 0, 10, 0, 0, 0]
    scores, rejected, passes = run(z)
    assert rejected == [3, 5]
    assert passes == 3
    assert scores[3] == pytest.approx(7.5 / sqrt(5 / 4) / NORMAL)
    assert scores[5] == pytest.approx(10 / sqrt(74 / 59) / NORMAL)
    assert_allclose(scores[[0, 1, 2, 4, 6, 7, 8]], 0, atol=1e-12)

    scores, rejected, passes = run(z, passes=2)
    assert rejected == [3, 5]
    assert passes == 2
    assert scores[4] == pytest.approx((10 * 20 / 68) / sqrt(86 / 68) / NORMAL)

    scores, rejected, passes = run(z, passes=1)
    assert rejected == [3, 4, 5]
    assert passes == 1
    assert scores[4] == pytest.approx(5 / sqrt(5 / 4) / NORMAL)


def test_corner_agrees_with_one_side() -> None:
    """A roof, |t - 5|: its ridge is predicted from either side exactly, and from both 5/4 too high.

    Windows of -2, -1, 1, 2 s: heights 2, 1, 1, 2 have the mean 3/2, with q = 1/4.
    """
    z = [float(abs(i - 5)) for i in range(11)]
    scores, rejected, _ = run(z, sigma=0.01, sides='either')
    assert_allclose(scores, 0, atol=1e-9)
    assert rejected == []
    scores, rejected, _ = run(z, sigma=0.01, sides='both', passes=1)
    assert 5 in rejected
    assert scores[5] == pytest.approx(1.5 / (0.01 * sqrt(5 / 4)) / NORMAL)


def test_either_falls_back_to_the_window_around_the_point() -> None:
    """Five points, four others are needed: only the ends have them on one side.

    Ends: from 1, 2, 3, 4 s the weight at 2 is (30 - 20) / 20, q = 30/20. The middle one has the
    window around it: 10 from 0, with q = 1/4.
    """
    scores, _, _ = run([0, 0, 10, 0, 0], sides='either', before=4, after=4, min_window=4, passes=1)
    assert scores[2] == pytest.approx(10 / sqrt(5 / 4) / NORMAL)
    assert_allclose(scores[[0, 4]], 5 / sqrt(5 / 2) / NORMAL)
    assert np.isfinite(scores[[1, 3]]).all()


@pytest.mark.parametrize(('count', 'tested'), [(9, False), (10, True)])
def test_estimated_sigma_needs_ten_residuals(count: int, *, tested: bool) -> None:
    """A line of nine points gives nine residuals."""
    scores, rejected, _ = run([0.0] * (count - 4) + [1.0, 0, 0, 0], sigma=0.0)
    assert np.isfinite(scores).all() == tested
    assert rejected == ([count - 4] if tested else [])


def test_own_sigma_goes_before_the_parameter() -> None:
    """σ = 1, 2, 3 and a window of one on each side: σ²_δz = 4 + (1 + 9) / 4."""
    scores, _, _ = run([0, 10, 0], own_sigma=[1.0, 2.0, 3.0], before=1, after=1, passes=1)
    assert scores[1] == pytest.approx(10 / sqrt(6.5) / NORMAL)
