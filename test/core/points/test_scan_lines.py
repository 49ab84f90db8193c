# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scan lines and segments, compared with plain loops."""

from collections.abc import Sequence

import numpy as np
import pytest
from helpers.scans import points_of
from naive import alpha_beta_gamma as naive
from numpy.typing import NDArray

from lidar_outlier_filter.core.points.points import Points, concatenate
from lidar_outlier_filter.core.points.scan_lines import (
    LineCounter,
    Lines,
    find_lines,
    find_returns,
    order_by_line,
)


def random_points(seed: int) -> Points:
    """Make lines with gaps and ties, in order of time, of line, or of nothing."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 300))
    t = rng.choice([0, 1, 10, 10, 10, 10, 15, 16, 100], count).cumsum() - 1000
    line = rng.integers(0, rng.integers(1, 12), count)
    points = points_of(np.zeros((count, 3)), t, line)
    orders = [np.arange(count), np.lexsort((t, line)), rng.permutation(count)]
    return points.take(orders[seed % 3])


def segments_of(lines: Lines) -> list[int]:
    """Return the number of the segment of each point, as the links make them."""
    result: list[int] = []
    for i, neighbour in enumerate(lines.before.tolist()):
        assert neighbour in {-1, i - 1}
        result.append(0 if not result else result[-1] + (neighbour == -1))
    return result


@pytest.mark.parametrize('seed', range(12))
def test_against_loops(seed: int) -> None:
    """Order, lines, intervals, segments and links are those of plain loops."""
    points = random_points(seed)
    order = order_by_line(points)
    assert order.tolist() == naive.scan_order(points.t.tolist(), points.line.tolist())
    points = points.take(order)
    t, line = points.t.tolist(), points.line.tolist()
    for gap_factor in (1.0, 1.5, 4.0):
        lines = find_lines(points, gap_factor)
        assert segments_of(lines) == naive.segments(t, line, gap_factor)
        after = [
            b if a != -1 else -1 for a, b in zip(lines.before[1:], range(1, len(t)), strict=True)
        ]
        assert lines.after.tolist() == [*after, -1]
        starts = [i for i in range(len(t)) if i == 0 or line[i] != line[i - 1]]
        assert lines.first.tolist() == [*starts, len(t)]
        for number, (begin, end) in enumerate(zip(starts, [*starts[1:], len(t)], strict=True)):
            assert lines.interval[number] == (naive.shot_interval(t[begin:end]) or 0)


@pytest.mark.parametrize('numbers', [(-(2**62), 2**62), (0, 10**9), (-5, -3)])
def test_odd_line_numbers(numbers: tuple[int, int]) -> None:
    """Lines may be numbered in any way: far apart, negative, beyond 32 bits."""
    points = points_of(np.zeros((4, 3)), np.arange(4)[::-1], np.array(numbers[::-1] * 2))
    assert order_by_line(points).tolist() == [3, 1, 2, 0]


def counted(angle: NDArray[np.float64], cuts: Sequence[int] = ()) -> list[int]:
    """Give the lines, from 0, of angles that come in messages cut there."""
    counter = LineCounter()
    parts = [counter.by_angle(part, np.isfinite(part)) for part in np.split(angle, cuts)]
    line = np.concatenate(parts)
    return (line - line[0]).tolist() if len(line) else []


def mirror(count: int, per_turn: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the angles of a mirror that turns, in [-π, π), and which turn each is of."""
    turned = np.arange(count) / per_turn
    return (turned % 1 - 0.5) * 2 * np.pi, np.floor(turned).astype(np.int64)


@pytest.mark.parametrize('sense', [1, -1])
@pytest.mark.parametrize('cut', [0, 90, 180, 270], ids='cut at {}'.format)
@pytest.mark.parametrize('span', [45, 120, 175, 180, 185, 300])
def test_each_turn_over_open_ground_is_a_line(span: int, cut: int, sense: int) -> None:
    """Each turn begins a line where few of its shots return, whichever way the mirror turns.

    The angles restart where nothing returns, as on a sensor that points down.
    """
    degree, turn = np.tile(np.arange(span + 1), 22), np.repeat(np.arange(22), span + 1)
    start = {0: 0, 90: -90, 180: -180 if span <= 180 else -span // 2, 270: 180 - span}[cut]
    angle = np.deg2rad((degree + start) * sense)
    assert counted(angle) == turn.tolist()
    assert counted(angle, range(1, len(angle))) == turn.tolist()


@pytest.mark.parametrize('seed', range(30))
def test_angles_against_loops(seed: int) -> None:
    """Lines by angle are those of plain loops, whatever the angles and the messages."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 600))
    angle, _ = mirror(count, rng.uniform(2, 100))
    step = rng.choice([0.0, 1e-3, 0.1, 0.6])
    angle = (angle + rng.uniform(-step, step, count) + np.pi) % (2 * np.pi) - np.pi
    low, high = np.sort(rng.uniform(-np.pi, np.pi, 2))
    if seed % 2:
        angle = angle[(angle >= low) & (angle <= high)]
    if seed % 3 == 0:
        angle = np.round(angle / (np.pi / 12)) * (np.pi / 12)  # steps of exactly the limits
    if seed % 5 == 0:
        angle = angle % (2 * np.pi)
    angle = angle * rng.choice([-1, 1]) if seed % 5 else angle
    cuts = np.sort(rng.integers(0, len(angle) + 1, 5)).tolist()
    expected = naive.angle_lines(angle.tolist())
    assert counted(angle, cuts) == counted(angle) == expected


def test_points_are_taken_and_joined() -> None:
    """Columns stay together; without a standard deviation before there is also no one after."""
    points = random_points(5)
    parts = [points.take(slice(0, 2)), points.take(slice(2, 2)), points.take(slice(2, None))]
    joined = concatenate(parts)
    assert joined.t.tolist() == points.t.tolist()
    assert joined.line.tolist() == points.line.tolist()
    assert joined.sigma is None
    own = Points(points.xyz, points.t, points.line, points.valid, points.t.astype(np.float64))
    both = concatenate([own.take(points.t > 0), own.take(points.t <= 0)])
    np.testing.assert_array_equal(both.sigma, both.t)


def test_returns_of_shots() -> None:
    """Points of a line and a time are one shot; those at one place are copies."""
    line = np.repeat([0, 1, 2], [9, 4, 8])
    t = np.array([0, 1, 1, 2, 3, 3, 3, 4, 5, *[5, 5, 6, 7], *[7, 7, 7, 7, 8, 8, 8, 8]])
    x = np.array([0, 1, 1, 2, 3, 9, 3, 4, 5, *[5, 8, 6, 7], *range(8)])
    returns = find_returns(points_of(np.stack([x, x, x], axis=1) + 0.5, t, line))
    assert returns is not None
    assert returns.number[:13].tolist() == [0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0]
    assert returns.shot[:13].tolist() == [0, 1, 1, 3, 4, 4, 4, 7, 8, 9, 9, 11, 12]
    assert returns.original[:13].tolist() == [0, 1, 1, 3, 4, 5, 4, 7, 8, 9, 10, 11, 12]
    # Most points of the third line share their times: its clock is too coarse.
    assert not returns.number[13:].any()
    for one in returns[1:]:
        assert one[13:].tolist() == list(range(13, 21))
    assert find_returns(points_of(np.zeros((3, 3)), np.arange(3), np.zeros(3, np.int64))) is None
    many = points_of(np.arange(150.0).reshape(50, 3), np.maximum(np.arange(50) - 16, 0))
    returns = find_returns(many)
    assert returns is not None
    assert not returns.number.any()
