# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of hard shapes, as sensors, maps and broken drivers may give, and a street beside."""

from collections.abc import Callable

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.points.points import Points

Rng = np.random.Generator

GRID = 1024.0  # parts of a metre: coordinates that are whole in them are exact in any map
UTM = (691_000.0, 5_334_000.0, 520.0)  # metres: east, north and up, of Munich
LINE, RINGS = 1000, 32  # points of a revolution; lines that are measured at once
NOISE = 0.008  # metres


def street(rng: Rng, count: int) -> Floats:
    """Scan a road and two facades, revolution by revolution, as a profile scanner does."""
    turn = np.arange(count) % LINE * (2 * np.pi / LINE)
    along = np.arange(count) // LINE * 0.05
    y, z = np.cos(turn), np.sin(turn)
    reach = np.minimum(8.0 / np.maximum(np.abs(y), 1e-9), 2.0 / np.maximum(-z, 1e-9))
    reach = np.minimum(reach, 40.0) + rng.normal(0, NOISE, count)
    stray = rng.random(count) < 0.005
    reach[stray] *= rng.random(np.count_nonzero(stray))
    return np.column_stack([along, reach * y, reach * z + 2.0])


def identical(rng: Rng, count: int) -> Floats:
    """Repeat one point."""
    return np.tile(rng.uniform(1, 9, 3), (count, 1))


def collinear(rng: Rng, count: int) -> Floats:
    """Put points on a line that is parallel to no axis."""
    return np.outer(rng.uniform(1, 100, count), [1.0, 2.0, 3.0])


def even_line(_rng: Rng, count: int) -> Floats:
    """Put points on an axis, all steps the same."""
    return np.outer(np.arange(1, count + 1) * 0.01, [1.0, 0.0, 0.0])


def coplanar(rng: Rng, count: int) -> Floats:
    """Put points on a plane at random."""
    return np.column_stack([rng.uniform(-50, 50, (count, 2)), np.zeros(count)])


def grid(_rng: Rng, count: int) -> Floats:
    """Put points on a plane, in rows and columns: all distances tie."""
    side = int(np.ceil(np.sqrt(count)))
    x, y = np.divmod(np.arange(count), side)
    return np.column_stack([x * 0.125, y * 0.125, np.ones(count)])


def circle(_rng: Rng, count: int) -> Floats:
    """Put points on a circle: all are as far from its centre."""
    turn = np.arange(count) * (2 * np.pi / count)
    return 10 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])


def circle_with_axis(rng: Rng, count: int) -> Floats:
    """Put one half on a circle and the other on its axis."""
    half = count // 2
    axis = np.column_stack([np.zeros((count - half, 2)), np.linspace(-20, 20, count - half)])
    return np.concatenate([circle(rng, half), axis])


def exponential(_rng: Rng, count: int) -> Floats:
    """Let every point be farther from the last by the same factor."""
    return np.outer(np.exp(np.linspace(np.log(1e-6), np.log(1e6), count)), [1.0, 0.0, 0.0])


def spiral(_rng: Rng, count: int) -> Floats:
    """Let every point be farther out by the same factor, on a spiral."""
    reach = np.exp(np.linspace(np.log(1e-3), np.log(1e5), count))
    turn = np.arange(count) * 2.399963  # the golden angle
    return np.column_stack([reach * np.cos(turn), reach * np.sin(turn), np.zeros(count)])


def utm(rng: Rng, count: int) -> Floats:
    """Move the street to where maps have it."""
    return street(rng, count) + UTM


def millimetres(rng: Rng, count: int) -> Floats:
    """Shrink the street to millimetres."""
    return street(rng, count) * 1e-3


def one_far(rng: Rng, count: int) -> Floats:
    """Put one point of the street a million kilometres away."""
    cloud = street(rng, count)
    cloud[count // 2] = 9e8, -9e8, 9e8
    return cloud


def three_positions(rng: Rng, count: int) -> Floats:
    """Repeat three points, in random order."""
    return rng.uniform(1, 9, (3, 3))[rng.integers(0, 3, count)]


def ball(rng: Rng, count: int) -> Floats:
    """Put points on a ball at random: all are as far from its centre."""
    way = rng.normal(size=(count, 3))
    way *= 10 / np.linalg.norm(way, axis=1, keepdims=True)
    return way


SHAPES: dict[str, Callable[[Rng, int], Floats]] = {
    one.__name__.replace('_', ' '): one
    for one in (
        identical,
        collinear,
        even_line,
        coplanar,
        grid,
        circle,
        circle_with_axis,
        exponential,
        spiral,
        utm,
        millimetres,
        one_far,
        three_positions,
        ball,
    )
}

# Of each detector, and of what its parameters choose among.
CHAINS: dict[str, dict[str, object]] = {
    'alpha_beta_gamma': {},
    'quadric': {},
    'quadric, patches': {'quadric.window': 'patch'},
    'lof': {},
    'lof, lof2': {'lof.statistic': 'lof2'},
    'sor': {},
    'sor, radius': {'sor.statistic': 'radius'},
    'hierarchical': {},
    'elevation': {},
    'boosted_trees': {},
}


def scanned(xyz: Floats, *, spins: bool = False) -> Points:
    """Give times and lines to points: of a profile scanner, or of one that spins."""
    count = len(xyz)
    line = np.arange(count) % RINGS if spins else np.arange(count) // LINE
    t = np.arange(count) // RINGS * (RINGS * 1000) if spins else np.arange(count) * 1000
    return Points(xyz, t, line.astype(np.int64), np.ones(count, np.bool_))
