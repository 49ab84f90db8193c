# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive elevation test against numbers worked out by hand."""

from math import isnan, sqrt

import pytest

from naive import elevation as naive

# Five points in a row on the map, the middle one raised by 6.
ROW = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 6.0), (3.0, 0.0, 0.0), (4.0, 0.0, 0.0)]


def test_nearest() -> None:
    """The two nearest on the map, whatever their elevation; ties for the last place count too."""
    assert naive.nearest(ROW, 2, 2) == [1, 3]
    assert naive.nearest(ROW, 2, 1) == [1, 3]
    assert naive.nearest(ROW, 0, 2) == [1, 2]
    assert naive.nearest([(0, 0, 0), (0, 0, 5), (0, 0, 9)], 0, 1) == [1, 2]
    assert naive.nearest([(0, 0, 0), (0, 0, 5), (0, 0, 9)], 0, 1, 3) == [1]


def test_scores() -> None:
    """Mean 1.2, deviations 1.8 four times and -7.2: variance (12.96 + 51.84) / 4 = 16.2."""
    limit = 3.0 * sqrt(16.2)
    expected = [1.8 / limit] * 2 + [-7.2 / limit] + [1.8 / limit] * 2
    low = naive.scores(ROW, 2, 3.0, 'low', 0.0, 0.001, 0.005)
    assert low == pytest.approx(expected)
    assert naive.scores(ROW, 2, 3.0, 'high', 0.0, 0.001, 0.005) == pytest.approx(
        [-one for one in expected]
    )
    assert naive.scores(ROW, 2, 3.0, 'both', 0.0, 0.001, 0.005) == pytest.approx(
        [abs(one) for one in expected]
    )
    # A floor of 5 m instead of 4.02 m.
    floor = naive.scores(ROW, 2, 3.0, 'low', 0.0, 0.001, 5.0)
    assert floor == pytest.approx([one / 15 for one in (1.8, 1.8, -7.2, 1.8, 1.8)])


def test_too_few_points() -> None:
    """Without k others there is no score, neither at first nor after the histogram."""
    assert all(map(isnan, naive.scores(ROW, 5, 3.0, 'both', 5.0, 0.001, 0.005)))
    four = naive.scores(ROW, 4, 3.0, 'both', 5.0, 0.001, 0.005)
    assert four[2] == 1.2
    assert all(isnan(four[i]) for i in (0, 1, 3, 4))
