# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds whose neighbours are hard to find, as sensors, maps and broken drivers give them."""

from collections.abc import Callable

import numpy as np

from lidar_outlier_filter.core.annotations import Floats

Rng = np.random.Generator
Shape = Callable[[Rng, int], Floats]

COUNT = 160  # points, for naive twins
UTM = np.array([389_512.25, 5_819_204.5, 34.125])


def scattered(rng: Rng, count: int = COUNT) -> Floats:
    """Scatter points evenly in all directions."""
    return rng.normal(size=(count, 3))


def sheet(rng: Rng, count: int = COUNT) -> Floats:
    """Lay out a noisy plane with a few outliers above it, far from the origin."""
    xyz: Floats = rng.uniform([0, 0, 0], [10, 10, 0], (count, 3)) + UTM
    xyz += rng.normal(0, 0.01, xyz.shape)
    xyz[: count // 32, 2] += rng.uniform(1, 4, count // 32)
    return xyz


def corner(rng: Rng, count: int = COUNT) -> Floats:
    """Let two walls of different density meet, and round all to float32."""
    xyz = rng.uniform(0, 10, (count, 3))
    xyz[: count // 4, 0] = 0
    xyz[count // 4 :, 1] = 0
    return xyz.astype(np.float32).astype(np.float64)


def grid(rng: Rng, count: int = COUNT) -> Floats:
    """Take positions of a grid, some of them twice: most points have ties."""
    return rng.integers(0, round(count ** (1 / 3)) + 1, (count, 3)).astype(np.float64)


def doubled(rng: Rng, count: int = COUNT) -> Floats:
    """Return every point twice, as a sensor does whose last return is its strongest."""
    return rng.permutation(np.repeat(scattered(rng, count // 2 + 1), 2, axis=0)[:count])


def stacks(rng: Rng, count: int = COUNT) -> Floats:
    """Put many points on a few positions among others, one place at zeros of both signs."""
    xyz = grid(rng, count)
    first, second, third = (count * share // 16 for share in (7, 10, 13))
    xyz[:first] = [0.0, 0.0, 0.0]
    xyz[count // 8 : count * 3 // 16] = [-0.0, 0.0, -0.0]
    xyz[first:second] = xyz[first]
    xyz[second:third] = [0.0, 0.0, 0.001]
    return rng.permutation(xyz)


def lone_stack(rng: Rng, count: int = COUNT) -> Floats:
    """Put half of the points far off, all on one place."""
    xyz = scattered(rng, count)
    xyz[: count // 2] = 50.0
    return rng.permutation(xyz)


def three_positions(rng: Rng, count: int = COUNT) -> Floats:
    """Leave fewer positions than neighbours are asked for."""
    xyz: Floats = rng.integers(0, 3, (count, 1)) * np.array([1.0, 2.0, 4.0])
    return xyz


def line(rng: Rng, count: int = COUNT) -> Floats:
    """Put points on a straight line, with ties and twins."""
    xyz: Floats = rng.integers(0, count, (count, 1)) * np.array([0.25, 0.5, -1.0])
    return xyz


def one_place(rng: Rng, count: int = COUNT) -> Floats:
    """Put all points on one place."""
    return np.tile(rng.normal(size=3), (count, 1))


CLOUDS = (
    *(scattered, sheet, corner, grid, doubled),
    *(stacks, lone_stack, three_positions, line, one_place),
)


def circle(_: Rng, count: int) -> Floats:
    """Put points on a circle: all are as far from its centre."""
    turn = np.arange(count) * (2 * np.pi / count)
    return 10 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])


def circle_with_axis(rng: Rng, count: int) -> Floats:
    """Put one half on a circle and the other on its axis: points hide each other badly."""
    half = count // 2
    axis = np.column_stack([np.zeros((count - half, 2)), np.linspace(-20, 20, count - half)])
    return np.concatenate([circle(rng, half), axis])


def exponential(_: Rng, count: int) -> Floats:
    """Let every point be farther from the last by the same factor."""
    return np.outer(np.geomspace(1e-6, 1e6, count), [1.0, 0.0, 0.0])


def spiral(_: Rng, count: int) -> Floats:
    """Let every point be farther out by the same factor, on a spiral."""
    reach = np.geomspace(1e-3, 1e5, count)
    turn = np.arange(count) * 2.399963  # the golden angle
    return np.column_stack([reach * np.cos(turn), reach * np.sin(turn), np.zeros(count)])


def ball(rng: Rng, count: int) -> Floats:
    """Put points on a ball at random: all are as far from its centre."""
    way = rng.normal(size=(count, 3))
    way *= 10 / np.linalg.norm(way, axis=1, keepdims=True)
    return way


def rows_and_columns(_: Rng, count: int) -> Floats:
    """Put points on a plane, in rows and columns: all distances tie."""
    x, y = np.divmod(np.arange(count), int(np.ceil(np.sqrt(count))))
    return np.column_stack([x * 0.125, y * 0.125, np.ones(count)])


def rotation(rng: Rng) -> Floats:
    """Draw a rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.linalg.det(q)
    return q
