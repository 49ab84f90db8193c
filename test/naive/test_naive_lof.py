# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive local outlier factor against numbers worked out by hand."""

import pytest

from naive import lof as naive


def on_a_line(*x: float) -> list[tuple[float, float, float]]:
    """Put points on the x axis."""
    return [(float(one), 0.0, 0.0) for one in x]


def test_two_loose_points_behind_two_close_ones() -> None:
    """With k = 1: k-distances 1, 1, 2, 4; neighbours 1, 0, 1, 3; densities 1, 1, 1/2, 1/4."""
    cloud = on_a_line(0, 1, 3, 7)
    assert [naive.k_distance_squared(cloud, p, 1) for p in range(4)] == [1, 1, 4, 16]
    assert naive.local_outlier_factors(cloud, 1) == [1, 1, 2, 2]


def test_ties_are_neighbours_too() -> None:
    """With k = 1: the point at 0 has two neighbours, 2 away: densities 1/2, 1/2, 1, 1.

    With either of the two alone its factor would be 1 or 2.
    """
    cloud = on_a_line(-2, 0, 2, 3)
    assert naive.neighbourhood(cloud, 1, 4.0) == [0, 2]
    assert naive.local_outlier_factors(cloud, 1) == [1, 1.5, 1, 1]


def test_more_coincident_points_than_k() -> None:
    """With k = 2, three points at 0: their 2-distinct-distance is 3, to the second other place.

    Mean reach distances: each at 0: (3 + 3 + 1 + 3) / 4; at 1, whose neighbours are those at 0:
    (3 + 3 + 3) / 3; at 3, which has all four: (2 + 3 + 3 + 3) / 4.
    """
    cloud = on_a_line(0, 0, 0, 1, 3)
    assert [naive.k_distance_squared(cloud, p, 2) for p in range(5)] == [9, 9, 9, 1, 9]
    stack = (2 / 2.5 + 1 / 3 + 4 / 11) / 4 * 2.5
    expected = [stack, stack, stack, 3 / 2.5, (3 / 2.5 + 1 / 3) / 4 * 11 / 4]
    assert naive.local_outlier_factors(cloud, 2) == pytest.approx(expected, rel=1e-15)
