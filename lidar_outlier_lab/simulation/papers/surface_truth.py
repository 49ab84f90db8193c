# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A city from the air with the truth of Sotoodeh 2006, section 5.1: distance from a surface model.

His truth is no list of errors. Outliers are points farther than twice the standard deviation of all
distances from a surface that was made from images. Such a surface smooths edges and covers trees,
so most of these points are leaves and branches below the crowns, and walls.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_lab.simulation.papers.aerial import Flight, fly
from lidar_outlier_lab.simulation.world.landscape import Landscape, Plants

# 115 820 points in the paper, σ = 0.22 m; half of the shots into trees go in, 2.5 m on average.
CITY = Flight(340, 341, 0.8, 380.0, 0.01, Plants(75, 420, tall=(6.0, 18.0), wide=(2.0, 4.5)), 0)
NOISE = 0.22  # standard deviation of a coordinate, metres
LEAVES = (0.5, 2.5)
MATCHING = 0.365  # standard deviation of the surface model, metres, table 2
SMOOTH = 0.8  # metres over which matching smooths
GRID = 1.0  # metres between the corners of its triangles
CHECKS = 128  # points whose heights are measured by hand, in the paper
FINE = 0.25  # metres between the samples by which the distance to a triangle is found
BEYOND = 2.0  # standard deviations: "outside the 95 % confidence interval"


class City(NamedTuple):
    """Points with his truth.

    Attributes
    ----------
    xyz : (N, 3) float64
    residual : (N,) distance from the surface model, metres
    limit : points farther than this are outliers, metres
    checks : (128,) heights of positions chosen by lot over the surface model, metres

    """

    xyz: Floats
    residual: Floats
    limit: float
    checks: Floats

    @property
    def bad(self) -> Bools:
        """His outliers (N,)."""
        return self.residual > self.limit


def city(seed: int) -> City:
    """Scan a city, match a surface model, and measure every point against it."""
    rng = np.random.default_rng([seed, CITY.lines])
    flown = fly(CITY, rng, LEAVES)
    xyz = (flown.origin + flown.distance * flown.direction).T
    xyz += NOISE / np.sqrt(3.0) * rng.standard_normal(xyz.shape)
    land = flown.land
    x, y = (np.arange(0.0, length, GRID) for length in land.size)
    corners = np.stack(np.meshgrid(x, y, indexing='ij')).reshape(2, -1)
    height = land.view(*corners).height.reshape(len(x), len(y))
    rough = gaussian_filter(rng.standard_normal(height.shape), 1.0)
    height = gaussian_filter(height, SMOOTH / GRID) + MATCHING * rough / rough.std()
    residual = distances(xyz, height, GRID)
    # About the residuals' mean of zero: the mean square is what an interval on both sides has.
    limit = BEYOND * float(np.sqrt(np.mean(residual**2)))
    return City(xyz, residual, limit, _checks(land, height, np.random.default_rng([seed, CHECKS])))


def _checks(land: Landscape, height: Floats, rng: np.random.Generator) -> Floats:
    """Measure the top of what stands at some positions, and compare it with the surface model."""
    shape = np.array(height.shape) - 1
    place = rng.uniform(0.0, 1.0, (CHECKS, 2)) * np.minimum(GRID * shape, land.size)
    (i, j), (u, v) = np.divmod(place.T / GRID, 1.0)
    model = _on_triangles(height, i.astype(np.int64), j.astype(np.int64), u, v)
    return land.view(*place.T).height - model


def distances(xyz: Floats, height: Floats, grid: float) -> Floats:
    """Measure the distance of points (N, 3) to a surface over corners (I, J), metres.

    Two triangles in every square. They are sampled, so that a distance is too large by at most
    ``FINE`` ÷ √2, and that only close to the surface; steep squares are sampled along the height.
    """
    corners = [height[1:, :-1], height[:-1, 1:], height[1:, 1:], height[:-1, :-1]]
    rise = np.maximum.reduce(corners) - np.minimum.reduce(corners)
    parts = np.ceil(np.hypot(grid, rise) / FINE).astype(np.int64)
    samples = []
    for count in np.unique(parts):
        i, j = np.nonzero(parts == count)
        u, v = np.meshgrid(*(2 * [np.arange(count + 1) / count]), indexing='ij')
        u, v = u.ravel()[None], v.ravel()[None]
        z = _on_triangles(height, i[:, None], j[:, None], u, v)
        xyz_of = [(i[:, None] + u) * grid, (j[:, None] + v) * grid, z]
        samples.append(np.stack(xyz_of, axis=2).reshape(-1, 3))
    return cKDTree(np.concatenate(samples)).query(xyz)[0]


def _on_triangles(height: Floats, i: Ints, j: Ints, u: Floats, v: Floats) -> Floats:
    """Return the heights at (u, v), 0 to 1, of squares (i, j)."""
    a, b, c, d = height[i, j], height[i + 1, j + 1], height[i + 1, j], height[i, j + 1]
    # Of the two triangles below and above the diagonal from (0, 0) to (1, 1).
    return np.where(u >= v, a + u * (c - a) + v * (b - c), a + v * (d - a) + u * (b - d))
