# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Times that shots share are measured, and spread in the order of the shots."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from lidar_outlier_filter.core.points.shared_times import Clock, measure_clock, spread_times

SHOT = 1000  # nanoseconds


@pytest.mark.parametrize('each', [2, 4, 24, 384])
@pytest.mark.parametrize('lost', [0.0, 0.02])
def test_spread_times(each: int, lost: float) -> None:
    """Full ticks get the times of their shots; others keep order, and stay within their tick."""
    kept = np.random.default_rng(each).random(20 * each) >= lost
    true = (np.arange(20 * each) * SHOT)[kept]
    t = true // (each * SHOT) * (each * SHOT)
    clock = measure_clock(t)
    assert clock.tick == each * SHOT
    assert clock.shots <= each
    assert clock.share == pytest.approx(1 - 1 / each, abs=0.05)
    found = spread_times(t, clock)
    assert (np.diff(found) > 0).all()
    assert_array_equal(found // clock.tick * clock.tick, t)
    assert np.abs(found - true).max() <= SHOT * (0 if lost == 0 else 1 + 4 * lost * each)


def test_returns_of_a_shot_keep_one_time() -> None:
    """Later returns are no shots of their own."""
    shot = np.repeat(np.arange(40), np.where(np.arange(40) % 3 == 0, 2, 1))
    begins = np.append([True], shot[1:] != shot[:-1])
    t = shot // 4 * 4 * SHOT
    clock = measure_clock(t, begins)
    assert (clock.tick, clock.shots) == (4 * SHOT, 4)
    assert_array_equal(spread_times(t, clock, begins), shot * SHOT)


def test_times_of_their_own() -> None:
    """Few shared times are left as they are; of one time for all, only the share is known."""
    t = np.array([0, 1, 2, 2, 3, 4, 5])
    clock = measure_clock(t)
    assert clock.share == pytest.approx(1 / 6)
    assert clock[1:] == (0, 1)
    assert spread_times(t, clock) is t
    assert measure_clock(np.zeros(9, np.int64)) == Clock(1.0, 0, 9)
    for few in (0, 1):
        assert measure_clock(np.zeros(few, np.int64)) == Clock(0.0, 0, 1)
    assert len(spread_times(np.empty(0, np.int64), Clock(0.9, 10, 4))) == 0
