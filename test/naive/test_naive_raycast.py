# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The naive ray caster against distances and angles found by hand."""

import math

import pytest

from naive import raycast as naive

DOWN = (0.0, 0.0, -1.0)
AHEAD = (1.0, 0.0, 0.0)
SLANTED = (0.6, 0.0, -0.8)


def test_ground() -> None:
    """A flat road, a bent one at its middle and at its kerb, its end, and the sky."""
    assert naive.ground(-9, 9, 9, 0, (0, 0, 4), SLANTED) == pytest.approx((5.0, 0.8))
    assert naive.ground(-9, 9, 5, 0.1, (0, 0, 2.1), DOWN) == pytest.approx((2.0, 1.0))
    # There the road falls by 2 · 0.1 / 5 = 0.04 a metre.
    kerb = naive.ground(-9, 9, 5, 0.1, (0, 5, 2), DOWN)
    assert kerb == pytest.approx((2.0, 1 / math.sqrt(1 + 0.04**2)))
    assert naive.ground(-9, 2, 9, 0, (0, 0, 4), SLANTED) is None
    assert naive.ground(-9, 9, 9, 0, (0, 0, 4), AHEAD) is None
    assert naive.ground(-9, 9, 9, 0, (0, 0, -1), DOWN) is None


def test_box() -> None:
    """The front, the top, beside it, behind one, and inside."""
    low, high = (2.0, -1.0, -1.0), (3.0, 1.0, 1.0)
    assert naive.box(low, high, (0, 0, 0), AHEAD) == pytest.approx((2.0, 1.0))
    assert naive.box(low, high, (2.5, 0, 3), DOWN) == pytest.approx((2.0, 1.0))
    assert naive.box(low, high, (1.1, 0, 2.2), SLANTED) == pytest.approx((1.5, 0.6))
    assert naive.box(low, high, (0, 2, 0), AHEAD) is None
    assert naive.box(low, high, (4, 0, 0), AHEAD) is None
    assert naive.box(low, high, (2.5, 0, 0), AHEAD) is None


def test_tube() -> None:
    """Head on, off the middle, above its end, and along it."""
    foot, up = (3.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    assert naive.tube(foot, up, 0.5, 2, (0, 0, 1), AHEAD) == pytest.approx((2.5, 1.0))
    # 0.3 off the middle: the surface is 0.4 before it, and leans by 0.4 / 0.5.
    assert naive.tube(foot, up, 0.5, 2, (0, 0.3, 1), AHEAD) == pytest.approx((2.6, 0.8))
    assert naive.tube(foot, up, 0.5, 2, (0, 0, 3), AHEAD) is None
    assert naive.tube(foot, up, 0.5, 2, (3, 0, 4), DOWN) is None


def test_ball() -> None:
    """Head on, off the middle, behind one, and inside."""
    assert naive.ball((3, 0, 0), 0.5, (0, 0, 0), AHEAD) == pytest.approx((2.5, 1.0))
    assert naive.ball((3, 0, 0), 0.5, (0, 0.3, 0), AHEAD) == pytest.approx((2.6, 0.8))
    assert naive.ball((-3, 0, 0), 0.5, (0, 0, 0), AHEAD) is None
    assert naive.ball((0, 0, 0), 0.5, (0, 0, 0), AHEAD) is None


def test_lid() -> None:
    """A rib, the groove beside it, beside the lid, and from below."""
    centre = (1.0, 1.0, 0.1)
    assert naive.lid(centre, 0.3, 0.01, 0.2, (1.05, 1.05, 2.1), DOWN) == pytest.approx((2.0, 1.0))
    assert naive.lid(centre, 0.3, 0.01, 0.2, (0.95, 1.05, 2.1), DOWN) == pytest.approx((2.01, 1.0))
    assert naive.lid(centre, 0.3, 0.01, 0.2, (1.3, 1.3, 2.1), DOWN) is None
    assert naive.lid(centre, 0.3, 0.01, 0.2, (1.05, 1.05, 0), DOWN) is None


def test_scramble() -> None:
    """The first numbers of SplitMix64 from the seed 0, as its authors give them."""
    golden = 0x9E3779B97F4A7C15
    assert naive.scramble(golden) == 0xE220A8397B1DCDAF
    assert naive.scramble(2 * golden & (2**64 - 1)) == 0x6E789E6AA1B965F4


def test_crown() -> None:
    """With a leaf in every cell the first cell's is met, unless the ray passes beside it."""
    centre, half = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    aim = (0.999999, 0.001, math.sqrt(1 - 0.999999**2 - 0.001**2))
    hit = naive.crown(centre, half, 0.5, 9.0, 1.0, 7, (-5.0, 0.1, 0.1), aim)
    assert hit is not None
    # So large a leaf is a wall through its own place.
    place = [(n + naive.uniform(-2, 0, 0, 7, 1 + i)) * 0.5 for i, n in enumerate((-2, 0, 0))]
    height, around = 2 * naive.uniform(-2, 0, 0, 7, 4) - 1, math.tau * naive.uniform(-2, 0, 0, 7, 5)
    flat = math.sqrt(1 - height**2)
    normal = (flat * math.cos(around), flat * math.sin(around), height)
    met = naive.along((-5.0, 0.1, 0.1), aim, hit[0])
    assert naive.dot(naive.minus(met, (place[0], place[1], place[2])), normal) == pytest.approx(0)
    assert naive.crown(centre, half, 0.5, 9.0, 0.0, 7, (-5.0, 0.1, 0.1), aim) is None
    assert naive.crown(centre, half, 0.5, 9.0, 1.0, 7, (-5.0, 3.0, 0.1), aim) is None
