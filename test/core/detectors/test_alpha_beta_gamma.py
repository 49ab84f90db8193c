# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The fast α-β-γ smoother is its naive twin, and does what is promised of it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.scans import points_of
from naive import alpha_beta_gamma as naive
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.alpha_beta_gamma.detector import detect
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import find_lines, order_by_line
from lidar_outlier_filter.parameters.filter import FilterParameters

GAP = 1.5
SHOT = 10_000  # nanoseconds
NOISE = 0.01  # metres
UTM = np.array([389_512.25, 5_819_204.5, 34.125])


# Clouds in their order of arrival -----------------------------------------------------------------


def smoother(**changes: Any) -> AlphaBetaGamma:
    """Windows of 5 and 5 as in the paper, unless changed."""
    paper = {'before': 5, 'after': 5, 'order': 2, 'significance': 0.001, 'passes': 10}
    return AlphaBetaGamma(**{**paper, **changes})


def curve(t: NDArray[np.int64]) -> Floats:
    """Bend smoothly, as a scan line on a road does; metres."""
    u = t / SHOT
    return np.stack([0.1 * u, 0.002 * u**2 - 0.03 * u, 2 * np.sin(u / 40)], axis=1)


def noisy(xyz: Floats, rng: np.random.Generator, outliers: int) -> Floats:
    """Add noise to all, and to some that are chosen at random much more."""
    xyz = xyz + rng.normal(scale=NOISE, size=xyz.shape)
    some = rng.choice(len(xyz), size=min(outliers, len(xyz)), replace=False)
    xyz[some] += rng.normal(scale=30 * NOISE, size=(len(some), 3))
    return xyz


def smooth(rng: np.random.Generator) -> Points:
    """Two lines along a curve, with outliers: more points than the kernel takes at once."""
    t = np.arange(150) * SHOT
    return points_of(noisy(curve(t), rng, 8), t, np.arange(150) // 140)


def corners(rng: np.random.Generator) -> Points:
    """Walls at right angles and a step in depth, with outliers."""
    t = np.arange(100) * SHOT
    u = np.arange(100) % 40 / 10
    xyz = np.stack([np.minimum(u, 2), np.maximum(u, 2), np.where(t > 70 * SHOT, 3.0, 0.0)], axis=1)
    return points_of(noisy(xyz, rng, 4), t)


def irregular(rng: np.random.Generator) -> Points:
    """Jittering times, and shots that are missing at random."""
    t = np.cumsum(rng.integers(1, 2 * SHOT, size=100))
    t += SHOT * np.cumsum(rng.random(100) < 0.1)
    return points_of(noisy(curve(t), rng, 8), t)


def ties(rng: np.random.Generator) -> Points:
    """Every third shot has two returns, at one time.

    With fewer different times in a window, a parabola goes through two of the points and is as far
    from the other at the same time as that one's is from it: the digits lost decide which is worse.
    """
    t = np.arange(100) * 3 // 4 * SHOT
    return points_of(noisy(curve(t), rng, 8), t)


def short_segments(rng: np.random.Generator) -> Points:
    """Segments of 1 to 12 points, on three lines of odd numbers that arrive mixed."""
    lengths = np.concatenate([rng.permutation(np.arange(1, 13)) for _ in range(2)])
    gaps = np.repeat(np.arange(len(lengths)) * 4, lengths)
    t = (np.arange(len(gaps)) + gaps) * SHOT
    line = (np.repeat(np.arange(len(lengths)) % 3, lengths) - 1) * 10**12
    mixed = rng.permutation(len(t))
    return points_of(noisy(curve(t), rng, 12), t, line).take(mixed)


def utm(rng: np.random.Generator) -> Points:
    """Large coordinates and times as they are in the field."""
    cloud = smooth(rng)
    return replace(cloud, xyz=cloud.xyz + UTM, t=cloud.t + 1_726_000_000_123_456_789)


CLOUDS = {make.__name__: make for make in (smooth, corners, irregular, ties, short_segments, utm)}


def with_own_sigma(cloud: Points, rng: np.random.Generator) -> Points:
    """Give every point a standard deviation of its own."""
    return replace(cloud, sigma=NOISE * rng.uniform(0.5, 3.0, len(cloud)))


# Fast and naive -----------------------------------------------------------------------------------


def fast(cloud: Points, parameters: AlphaBetaGamma) -> Scores:
    """Judge points with the package; the result is in their order of arrival."""
    order = order_by_line(cloud)
    ordered = cloud.take(order)
    result = detect(ordered, find_lines(ordered, GAP), parameters)
    back = np.argsort(order)
    return Scores(result.score[back], passes=result.passes)


def slow(cloud: Points, parameters: AlphaBetaGamma) -> Scores:
    """Judge points with the twin; the result is in their order of arrival."""
    order = np.array(naive.scan_order(cloud.t.tolist(), cloud.line.tolist()), np.int64)
    ordered = cloud.take(order)
    t, line = ordered.t.tolist(), ordered.line.tolist()
    scores, rejected, passes = naive.alpha_beta_gamma(
        ordered.t,
        ordered.xyz,
        np.array(naive.segments(t, line, GAP), np.int64),
        ordered.line,
        own_sigma=ordered.sigma,
        **{
            name: getattr(parameters, name)
            for name in ('before', 'after', 'order', 'significance', 'sides', 'sigma')
        },
        sigma_floor=parameters.sigma_floor,
        min_window=parameters.min_window,
        passes=parameters.passes,
    )
    back = np.argsort(order)
    assert_array_equal(rejected, scores > 1)
    return Scores(scores[back], passes=passes)


def assert_same(got: Scores, expected: Scores, rtol: float, atol: float) -> None:
    """Ask for the same verdicts and passes, the same points untested, and scores alike."""
    assert_array_equal(np.isnan(got.score), np.isnan(expected.score))
    assert_allclose(got.score, expected.score, rtol=rtol, atol=atol)
    assert_array_equal(got.score > 1, expected.score > 1)
    assert got.passes == expected.passes


def assert_fast_is_naive(cloud: Points, parameters: AlphaBetaGamma) -> Scores:
    """Compare the two, and return the result; a score below 1e-9 is as good as 0."""
    result = fast(cloud, parameters)
    assert_same(result, slow(cloud, parameters), rtol=1e-9, atol=1e-9)
    return result


SIDES = pytest.mark.parametrize('sides', ['both', 'either'])


@SIDES
@pytest.mark.parametrize('name', CLOUDS)
def test_fast_is_naive_on_all_clouds(name: str, sides: str) -> None:
    """On every kind of cloud, each of which has outliers to find; long windows, too."""
    cloud = CLOUDS[name](np.random.default_rng(7))
    assert (assert_fast_is_naive(cloud, smoother(sides=sides)).score > 1).any()
    assert_fast_is_naive(cloud, smoother(sides=sides, before=20, after=15, passes=2))


@SIDES
@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('mode', ['line', 'fixed', 'own'])
def test_fast_is_naive_in_all_modes(sides: str, order: int, mode: str) -> None:
    """Every source of σ, with ties, and with a quarter of the points wrong, on two lines."""
    rng = np.random.default_rng(11)
    t = np.arange(80) * SHOT
    for cloud in ties(rng), points_of(noisy(curve(t), rng, 20), t, np.arange(80) % 2):
        own = with_own_sigma(cloud, rng) if mode == 'own' else cloud
        sigma = 0.02 if mode == 'fixed' else 0.0
        result = assert_fast_is_naive(own, smoother(sides=sides, order=order, sigma=sigma))
        assert result.passes > 1


@SIDES
@pytest.mark.parametrize(
    'changes',
    [
        {'before': 3, 'after': 6},
        {'before': 6, 'after': 3, 'significance': 0.05},
        {'before': 0, 'after': 6},
        {'before': 6, 'after': 0},
        {'before': 1, 'after': 4, 'passes': 3, 'significance': 0.01},
        {'passes': 1},
    ],
    ids=str,
)
def test_fast_is_naive_for_all_windows(changes: dict[str, Any], sides: str) -> None:
    """Lopsided and one-sided windows, few passes, short segments."""
    cloud = short_segments(np.random.default_rng(13))
    assert_fast_is_naive(cloud, smoother(sides=sides, **changes))


UNEVEN = (0, 9, 15, 20, 26, 33, 42, 49, 54, 60, 68, 77, 85)
DEGENERATE = {
    'nothing': [],
    'one point': [5],
    'one time': [5] * 12,
    'two times': [0] * 6 + [1] * 6,
    'two times and more': [0] * 7 + [1] * 7 + [2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
    'three times': [0] * 5 + [1] * 5 + [2] * 5,
    'almost one time': [*range(9), *range(10**9, 10**9 + 9)],
    # In units of the interval these are no whole numbers: what should be 0 is a rounding.
    'uneven times': [t for t in UNEVEN for _ in range(6)],
}


@SIDES
@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('name', DEGENERATE)
def test_degenerate_windows(name: str, order: int, sides: str) -> None:
    """Windows that cannot predict: the same points stay untested."""
    t = np.array(DEGENERATE[name], np.int64) * SHOT
    rng = np.random.default_rng(17)
    cloud = points_of(rng.normal(scale=NOISE, size=(len(t), 3)), t)
    parameters = smoother(order=order, sides=sides, sigma=NOISE)
    result = fast(cloud, parameters)
    expected = slow(cloud, parameters)
    assert_same(result, expected, rtol=1e-9, atol=1e-9)
    if name in ('one point', 'one time') or (name, order) == ('two times', 2):
        assert np.isnan(result.score).all()


# Several returns of a shot ------------------------------------------------------------------------


def test_each_return_of_a_shot_is_judged_among_first_ones() -> None:
    """Copies and farther returns change no verdict of first returns; copies share theirs."""
    points = smooth(np.random.default_rng(8))
    chain = Chain(FilterParameters().changed({'chain': ('alpha_beta_gamma',)}))
    alone = chain.judge(points).score
    far = points.xyz + np.array([0.0, 0.0, 7.0])
    twice = np.arange(len(points)) % 25 == 12
    index = np.repeat(np.arange(len(points)), np.where(twice, 3, 2))
    later = np.append([False], index[1:] == index[:-1])
    last = np.append(later[1:] != later[:-1], [True]) & later & twice[index]
    xyz = np.where(last[:, None], far[index], points.xyz[index])
    found = chain.judge(points_of(xyz, points.t[index], points.line[index])).score
    assert_array_equal(found[~last], alone[index[~last]])
    assert (found[last] > 1).all()
