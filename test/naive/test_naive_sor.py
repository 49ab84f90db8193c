# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive tests of the distance to the nearest neighbours against numbers worked out by hand."""

import pytest

from naive import sor as naive


def on_a_line(*x: float) -> list[tuple[float, float, float]]:
    """Put points on the x axis."""
    return [(float(one), 0.0, 0.0) for one in x]


FOUR = on_a_line(0, 1, 2, 7)  # mean distances to two others: 1.5, 1, 1.5, 5.5


def test_sor2() -> None:
    """The median is 1.5, from which the mean distances are 0, 0.5, 0 and 4 away."""
    assert naive.sor2(FOUR, 2, 0.5) == [0, 1, 0, 8]


def test_limits_that_grow_with_the_range() -> None:
    """Each point has its own: sor and sor2 times so much, radius at least so much."""
    plain = naive.sor(FOUR, 2, 1.0)
    grown = naive.sor(FOUR, 2, 1.0, [2, 1, 0.5, 4])
    assert grown == pytest.approx([plain[0] / 2, plain[1], plain[2] * 2, plain[3] / 4], rel=1e-15)
    assert naive.sor2(FOUR, 2, 0.5, [2, 1, 0.5, 4]) == [0, 1, 0, 2]
    assert naive.radius(FOUR, 2, 2.0, [1, 2, 4, 3]) == [1, 0.5, 0.5, 2]
