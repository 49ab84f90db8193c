# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive twin against numbers worked out by hand: who else would test the reference."""

from math import sqrt
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from naive import alpha_beta_gamma as naive

# Critical values as printed in any table, for a significance of 0.001.
NORMAL = 3.290526731

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


# Passes -----------------------------------------------------------------------------------------


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


def test_own_sigma_goes_before_the_parameter() -> None:
    """σ = 1, 2, 3 and a window of one on each side: σ²_δz = 4 + (1 + 9) / 4."""
    scores, _, _ = run([0, 10, 0], own_sigma=[1.0, 2.0, 3.0], before=1, after=1, passes=1)
    assert scores[1] == pytest.approx(10 / sqrt(6.5) / NORMAL)
