# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive neighbours against numbers worked out by hand: who else would test the reference."""

import pytest

from naive import neighbours as naive

# On a line, at 0, 1, 3, 3 and 6 metres.
LINE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 0.0, 0.0), (6.0, 0.0, 0.0)]


def test_squared_distance() -> None:
    """2, 3 and 6 metres along the axes make 49 m²."""
    assert naive.squared((1, 1, 1), (3, -2, 7)) == 49


def test_sum_is_rounded_in_order() -> None:
    """Three times 0.1² : (0.01 + 0.01) + 0.01 in float64, not rounded once."""
    assert naive.squared((0.1, 0.1, 0.1), (0, 0, 0)) == (0.1 * 0.1 + 0.1 * 0.1) + 0.1 * 0.1


def test_coordinates_count_in_multiples() -> None:
    """Of 2**-510: three halves of it are two, a half is none, and so are all unset numbers."""
    unit = 2.0**-510
    values = [0.5 * unit, 1.5 * unit, -1.4 * unit, 1e-310, 2.0**-457, -1e150, 0.1]
    assert [naive.whole(value) for value in values] == [0, 2 * unit, -unit, 0, *values[4:]]
    assert naive.squared((1e-160, 0, 0), (0, 1e-310, 0)) == 0
    assert naive.squared((unit, 0, 0), (0, 0, 0)) == 2.0**-1020


@pytest.mark.parametrize(
    ('p', 'k', 'index', 'tied'),
    [
        (0, 1, [1], False),
        (0, 2, [1, 2], True),
        (0, 3, [1, 2, 3], False),
        (0, 4, [1, 2, 3, 4], False),
        (1, 1, [0], False),
        (1, 3, [0, 2, 3], False),
        (2, 1, [3], False),
        (2, 2, [3, 1], False),
        (2, 3, [3, 1, 0], True),
        (3, 4, [2, 1, 0, 4], False),
        (4, 1, [2], True),
    ],
)
def test_nearest(p: int, k: int, index: list[int], tied: bool) -> None:  # noqa: FBT001
    """Coincident points are neighbours, equally near ones come in the order of their indices."""
    assert naive.nearest(LINE, p, k) == (index, tied)


def test_within_takes_the_limit_in() -> None:
    """From 3: the coincident one at 0, then 1 at 2 metres, then 0 and 6 at 3 metres."""
    assert naive.within(LINE, 2, 9) == [0, 1, 3, 4]
    assert naive.within(LINE, 2, 8.9) == [1, 3]
    assert naive.within(LINE, 2, 0) == [3]
    assert naive.within(LINE, 2, -1) == []
    assert naive.within(LINE, 0, 0) == []
