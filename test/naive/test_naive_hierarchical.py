# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive hierarchical outlier detection against numbers worked out by hand."""

from math import sqrt

import pytest

from naive import hierarchical as naive

Z99, Z95 = 2.5758293035489004, 1.959963984540054


def on_a_line(*x: float) -> list[tuple[float, float, float]]:
    """Put points on the x axis."""
    return [(float(one), 0.0, 0.0) for one in x]


def test_limit() -> None:
    """Of 1, 1, 2, 4: median 1.5, mean 2, squared deviations 1, 1, 0, 4, so variance 6/3."""
    assert naive.limit([4, 1, 2, 1], 0.99) == pytest.approx(1.5 + Z99 * sqrt(2), rel=1e-12)
    assert naive.limit([4, 1, 2, 1], 0.95) == pytest.approx(1.5 + Z95 * sqrt(2), rel=1e-12)
    assert naive.limit([4, 1, 2, 1], 0.0) == 1.5


def test_gabriel_graph_of_right_angles() -> None:
    """A point on the ball is not inside: both diagonals of a square are edges, so is a hypotenuse.

    On a line only the steps are.
    """
    square = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    assert naive.gabriel_graph(square) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    assert naive.gabriel_graph(on_a_line(0, 1, 2)) == [(0, 1), (1, 2)]


def test_phases() -> None:
    """A far pair goes in phase 1, a near point in phase 2.

    x = 0 … 9 in steps of 1, then 11.5, then 40 and 41. Lengths of the tree's edges: ten times 1,
    2.5 and 28.5; median 1, mean 41/12, variance 62.58 (10 + 6.25 + 812.25 = 828.5, less
    12 · 3.41667² = 140.083, over 11): σ 7.91, limit 21.4 – the pair is cut off. In the rest nine
    times 1, and 2.5: mean 1.15, variance (15.25 - 10 · 1.3225) / 9 = 0.225, limit 1.93.
    """
    cloud = on_a_line(*range(10), 11.5, 40, 41)
    verdict = naive.detect(cloud, 0.99, 0.95, 3)
    assert verdict.phase == [0] * 10 + [2, 1, 1]
    assert verdict.cluster == [10] * 10 + [1, 2, 2]
    assert verdict.score == pytest.approx([0.3] * 10 + [3, 1.5, 1.5])


def test_coincident_points_are_one_place() -> None:
    """They count in the size, and make no edges: three at 40 are a cluster of three."""
    cloud = on_a_line(*range(10), 11.5, 40, 40, 40)
    verdict = naive.detect(cloud, 0.99, 0.95, 3)
    assert verdict.phase == [0] * 10 + [2, 0, 0, 0]
    assert verdict.cluster == [10] * 10 + [1, 3, 3, 3]
    assert naive.detect(on_a_line(5, 5, 5), 0.99, 0.95, 2).cluster == [3, 3, 3]
