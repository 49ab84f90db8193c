# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive weighed features against numbers worked out by hand."""

from __future__ import annotations

from math import inf, isnan, nan, sqrt

import pytest

from naive import boosted_trees as naive

FLAT = [(float(x), float(y), 0.0) for x in range(5) for y in range(4)]
NOTHING = dict.fromkeys(naive.FEATURES, 1.0) | {'amid': 0.1, 'surface': 0.0, 'company': 0.0}
ONCE = dict.fromkeys(naive.FEATURES, 1.0)
# Two rows of 15 points, 0.02 apart, on a slope of 3 : 4; the standard deviation of their length.
ARM = [(side * 0.02, 0.8 * i * 0.05, 0.6 * i * 0.05) for i in range(15) for side in (0, 1)]
LENGTH = 0.05 * sqrt((15**2 - 1) / 12)


def scan(xyz: list[tuple[float, float, float]], t: list[int], line: list[int]) -> naive.Scan:
    """Make points a metre from the sensor."""
    return naive.Scan(xyz, t, line, [1.0] * len(xyz))


def test_surface_of_a_plane() -> None:
    """Half a metre above a plane of which one neighbour is at the same height."""
    xyz = [(1.5, 1.5, 0.5), *FLAT[:-1], (5.0, 5.0, 0.5)]
    off, scale, _ = naive.surface(xyz, 0, range(1, 21))
    assert off == pytest.approx(0.5, abs=0.01)
    assert scale < 0.05  # little of the stray neighbour


@pytest.mark.parametrize(('aside', 'amidst'), [(0.0, 1.0), (0.5, 0.75), (1.0, 0.0), (3.0, 0.0)])
def test_amidst(aside: float, amidst: float) -> None:
    """The grid's variances along x and y are 2 and 1.25, its spread the root of their sum."""
    xyz = [(2.0 + aside * sqrt(3.25), 1.5, 0.3), *FLAT]
    assert naive.surface(xyz, 0, range(1, 21))[2] == pytest.approx(amidst, abs=1e-12)


def test_surface_of_a_line() -> None:
    """Neighbours on the x axis: a point 3 and 4 aside is 5 from them, at the end of them."""
    xyz = [(0.0, 3.0, 4.0), *((float(x), 0.0, 0.0) for x in range(20))]
    off, scale, amidst = naive.surface(xyz, 0, range(1, 21))
    assert off == pytest.approx(5.0)
    assert scale == pytest.approx(1e-4)
    assert amidst == 0


def test_segments() -> None:
    """Intervals of 10 and one of 16: with a factor of 1.5 that is a gap."""
    line = scan([(0.0, 0.0, 0.0)] * 5, [0, 20, 10, 46, 30], [7, 7, 7, 7, 7])
    assert naive.segments(line, 1.5) == [[[0, 2, 1, 4], [3]]]
    assert naive.segments(line, 1.6) == [[[0, 2, 1, 4, 3]]]


def test_difference() -> None:
    """Halfway between 0 and 2 on the axis, 3 aside: noise adds up to 1 + 1/4 + 1/4."""
    line = scan([(0.0, 0.0, 0.0), (1.0, 3.0, 0.0), (2.0, 0.0, 0.0)], [0, 10, 20], [0, 0, 0])
    assert naive.difference(line, 1, 0, 2) == pytest.approx(3 / sqrt(1.5))
    ahead = scan([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 6.0, 0.0)], [0, 10, 20], [0, 0, 0])
    assert naive.difference(ahead, 2, 0, 1) == pytest.approx(6 / sqrt(1 + 1 + 4))
    assert naive.difference(ahead, 2, 1, 1) == inf


def test_follow() -> None:
    """Steps of 1, 2 and 4 on a line: the nearer counts; a lone point has neither."""
    xyz = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (3.0, 0.0, 0.0), (7.0, 0.0, 0.0), (9.0, 9.0, 9.0)]
    line = scan(xyz, [0, 1, 2, 3, 0], [0, 0, 0, 0, 1])
    step, along = naive.follow(line, naive.segments(line, 1.5))
    assert step == [1, 1, 2, 4, inf]
    assert along == pytest.approx([1 / sqrt(6), 0.5 / sqrt(1.5), 1 / sqrt(6), 2 / sqrt(6), inf])


def test_usual() -> None:
    """The median of the others nearby; infinite ones do not count."""
    parts = [[[0, 1], [2, 3]], [[4]]]
    assert naive.usual(parts, [1.0, 2.0, inf, 5.0, 9.0]) == [3.5, 3.0, 2.0, 1.5, 9.0]


def test_statistic() -> None:
    """Features are silent up to their least value, and say no more beyond their largest."""
    assert naive.statistic(NOTHING, ONCE) == 0
    assert naive.statistic(NOTHING | {'step': 1e9}, ONCE) == pytest.approx(2.0)
    assert naive.statistic(NOTHING | {'along': inf}, ONCE | {'along': 3.0}) == pytest.approx(6.3)
    assert naive.statistic(NOTHING | {'step': 0.0}, ONCE) == 0
    assert naive.statistic(NOTHING | {'surface': 2.5}, ONCE | {'surface': 2.0}) == 5.0
    assert naive.statistic(NOTHING | {'surface': -0.5, 'step': 1e9}, ONCE) == pytest.approx(1.5)
    assert naive.statistic(NOTHING | {'company': 0.5}, ONCE | {'company': 9.0}) == 4.5
    assert naive.statistic(NOTHING | {'surface': -0.5}, ONCE) == 0


def test_bereaved() -> None:
    """Of 22 in a row, two rejected: all but the farthest are near a point, itself not."""
    xyz = [(i * 1.0, 0.0, 0.0) for i in range(22)]
    names = [10 + i for i in range(22)]
    score = [0.0] * 10 + [2.0, nan, *[1.0] * 18, 3.0, 0.5]
    lost = naive.bereaved(xyz, names, score)
    assert lost[10] == 1  # 30, not itself
    assert lost[31] == 1  # 30; 10 is the farthest
    assert lost[20] == 2


def test_spins() -> None:
    """Three lines that last as long as all together spin; two do not, nor lines in turn."""
    xyz = [(0.0, 0.0, 0.0)] * 6
    assert naive.spins(scan(xyz, [0, 0, 0, 9, 9, 9], [0, 1, 2, 0, 1, 2]))
    assert not naive.spins(scan(xyz, [0, 0, 0, 9, 9, 9], [0, 1, 0, 1, 0, 1]))
    assert not naive.spins(scan(xyz, [0, 1, 2, 3, 4, 5], [0, 0, 1, 1, 2, 2]))


def test_straightness() -> None:
    """A slope of 3 : 4, two points wide; level, wide, a wire or short of points it is no group."""
    slanted = scan(ARM, list(range(30)), [i // 2 for i in range(30)])
    result = naive.straightness(slanted, [0.05] * 30, 1.5)
    assert result == pytest.approx([0.35 * LENGTH / 0.01] * 30)
    level = scan([(x, y, 0.0) for x, y, _ in ARM], list(slanted.t), list(slanted.line))
    assert all(isnan(one) for one in naive.straightness(level, [0.05] * 30, 1.5))
    # Two rows so far apart are √3 times as wide as they are apart, if spread evenly: 0.25 at most.
    for apart, expected in ((0.14, 0.35 * LENGTH / 0.07), (0.15, nan)):
        wide = scan(
            [(apart / 0.02 * x, y, z) for x, y, z in ARM], list(slanted.t), list(slanted.line)
        )
        result = naive.straightness(wide, [0.1] * 30, 1.5)
        assert result == pytest.approx([expected] * 30, nan_ok=True)
    wire = scan(ARM, list(slanted.t), list(range(30)))
    assert all(isnan(one) for one in naive.straightness(wire, [0.05] * 30, 1.5))
    few = slanted.take(range(23))
    assert all(isnan(one) for one in naive.straightness(few, [0.05] * 23, 1.5))
    enough = slanted.take(range(24))
    assert all(one > 1 for one in naive.straightness(enough, [0.05] * 24, 1.5))


def test_straightness_beside_a_car() -> None:
    """An arm 0.15 from a wall is one group with it within 4 × 0.05, and free within 1.5 × 0.05."""
    wall = [(-0.15, 0.05 * (i // 6), 0.05 * (i % 6)) for i in range(30)]
    both = scan(
        ARM + wall, list(range(60)), [i // 2 for i in range(30)] + [i // 6 for i in range(30)]
    )
    result = naive.straightness(both, [0.05] * 60, 1.5)
    assert result[:30] == pytest.approx([0.35 * LENGTH / 0.01] * 30)
    assert not any(one > 1 for one in result[30:])
