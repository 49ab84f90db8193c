# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Small clouds with all that makes neighbours hard to find, for the tests of LOF and SOR."""

from collections.abc import Callable

import numpy as np

from lidar_outlier_filter.core.annotations import Floats

Rng = np.random.Generator

COUNT = 160
UTM = np.array([389_512.25, 5_819_204.5, 34.125])


def scattered(rng: Rng) -> Floats:
    """Scatter points evenly in all directions."""
    return rng.normal(size=(COUNT, 3))


def sheet(rng: Rng) -> Floats:
    """Lay out a noisy plane with a few outliers above it, far from the origin."""
    xyz: Floats = rng.uniform([0, 0, 0], [10, 10, 0], (COUNT, 3)) + UTM
    xyz += rng.normal(0, 0.01, xyz.shape)
    xyz[:5, 2] += rng.uniform(1, 4, 5)
    return xyz


def corner(rng: Rng) -> Floats:
    """Let two walls of different density meet, and round all to float32."""
    xyz = rng.uniform(0, 10, (COUNT, 3))
    xyz[: COUNT // 4, 0] = 0
    xyz[COUNT // 4 :, 1] = 0
    return xyz.astype(np.float32).astype(np.float64)


def grid(rng: Rng) -> Floats:
    """Take positions of a grid, some of them twice: most points have ties."""
    return rng.integers(0, 6, (COUNT, 3)).astype(np.float64)


def doubled(rng: Rng) -> Floats:
    """Return every point twice, as a sensor does whose last return is its strongest."""
    return rng.permutation(np.repeat(scattered(rng)[: COUNT // 2], 2, axis=0))


def stacks(rng: Rng) -> Floats:
    """Put many points on a few positions among others, one place at zeros of both signs."""
    xyz = grid(rng)
    xyz[:70] = [0.0, 0.0, 0.0]
    xyz[20:30] = [-0.0, 0.0, -0.0]
    xyz[70:100] = xyz[70]
    xyz[100:130] = [0.0, 0.0, 0.001]
    return rng.permutation(xyz)


def lone_stack(rng: Rng) -> Floats:
    """Put half of the points far off, all on one place."""
    xyz = scattered(rng)
    xyz[: COUNT // 2] = 50.0
    return rng.permutation(xyz)


def three_positions(rng: Rng) -> Floats:
    """Leave fewer positions than neighbours are asked for."""
    xyz: Floats = rng.integers(0, 3, (COUNT, 1)) * np.array([1.0, 2.0, 4.0])
    return xyz


def line(rng: Rng) -> Floats:
    """Put points on a straight line, with ties and twins."""
    xyz: Floats = rng.integers(0, 150, (COUNT, 1)) * np.array([0.25, 0.5, -1.0])
    return xyz


def one_place(rng: Rng) -> Floats:
    """Put all points on one place."""
    return np.tile(rng.normal(size=3), (COUNT, 1))


CLOUDS: tuple[Callable[[Rng], Floats], ...] = (
    scattered,
    sheet,
    corner,
    grid,
    doubled,
    stacks,
    lone_stack,
    three_positions,
    line,
    one_place,
)


def rotation(rng: Rng) -> Floats:
    """Draw a rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.linalg.det(q)
    return q
