# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points on surfaces, with noise along their normals, for the tests of the quadric detector."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats

Rng = np.random.Generator
Surface = tuple[Floats, Floats]  # points and normals, (n, 3) each

NOISE = 0.008  # metres


def road(rng: Rng, n: int) -> Surface:
    """Spread points over a flat road."""
    points = np.column_stack([rng.uniform(-0.3, 0.3, (n, 2)), np.zeros(n)])
    return points, np.tile([0.0, 0.0, 1.0], (n, 1))


def cambered(rng: Rng, n: int) -> Surface:
    """Spread points over a road that falls off by 7 cm on both sides."""
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    normals = np.column_stack([np.zeros(n), 0.6 * y, np.ones(n)])
    return np.column_stack([x, y, -0.3 * y**2]), _unit(normals)


def dome(rng: Rng, n: int) -> Surface:
    """Spread points over a cap of a ball of half a metre."""
    turn, cosine = rng.uniform(0, 2 * np.pi, n), rng.uniform(np.cos(1.2), 1, n)
    sine = np.sqrt(1 - cosine**2)
    normals = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), cosine])
    return 0.5 * normals, normals


def pole(rng: Rng, n: int) -> Surface:
    """Spread points over the side of a pole, 10 cm in radius, that is seen."""
    turn = rng.uniform(-1.3, 1.3, n)
    normals = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(n)])
    return 0.1 * normals + np.outer(rng.uniform(-0.3, 0.3, n), [0, 0, 1]), normals


def saddle(rng: Rng, n: int) -> Surface:
    """Spread points over a surface that bends both ways."""
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    normals = np.column_stack([-0.8 * y, -0.8 * x, np.ones(n)])
    return np.column_stack([x, y, 0.8 * x * y]), _unit(normals)


def corner(rng: Rng, n: int) -> Surface:
    """Spread points over the floor and two walls."""
    points, normals = rng.uniform(0, 0.4, (n, 3)), np.zeros((n, 3))
    wall = rng.integers(0, 3, n)
    points[np.arange(n), wall] = 0
    normals[np.arange(n), wall] = 1
    return points, normals


def kerb(rng: Rng, n: int) -> Surface:
    """Spread points over a road, the face of a kerb, and the sidewalk."""
    x, way = rng.uniform(-0.3, 0.3, n), rng.uniform(-0.35, 0.47, n)
    y = np.where(way < 0, way, np.maximum(way - 0.12, 0))
    points = np.column_stack([x, y, np.clip(way, 0, 0.12)])
    face = (way > 0) & (way < 0.12)
    return points, np.where(face[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])


def line(rng: Rng, n: int) -> Surface:
    """Spread points along one scan line, with noise across it in all directions."""
    points = np.outer(rng.uniform(-0.5, 0.5, n), [1, 0, 0])
    turn = rng.uniform(0, 2 * np.pi, n)
    return points, np.column_stack([np.zeros(n), np.cos(turn), np.sin(turn)])


def volume(rng: Rng, n: int) -> Surface:
    """Scatter points as leaves or droplets."""
    points = rng.normal(0, 0.2, (n, 3))
    return points, _unit(points)


SURFACES: tuple[Callable[[Rng, int], Surface], ...] = (
    road,
    cambered,
    dome,
    pole,
    saddle,
    corner,
    kerb,
    line,
    volume,
)


def sample(
    surface: Callable[[Rng, int], Surface],
    rng: Rng,
    n: int,
    share: float = 0.0,
    reach: tuple[float, float] = (0.06, 3.0),
) -> tuple[Floats, NDArray[np.bool_]]:
    """Measure points of a surface with noise, a share of them far off; and say which.

    Near points follow each other, as in the tree.
    """
    points, normals = surface(rng, n)
    wrong = rng.random(n) < share
    off = np.exp(rng.uniform(np.log(reach[0]), np.log(reach[1]), n))
    points += normals * np.where(wrong, off, rng.normal(0, NOISE, n))[:, None]
    order = np.lexsort(np.round(points.T / 0.2))
    return points[order], wrong[order]


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
