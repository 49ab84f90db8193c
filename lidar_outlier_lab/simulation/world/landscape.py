# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Country seen from the air: hills, houses and trees as heights on a grid."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter

from lidar_outlier_filter.core.annotations import Bytes, Floats, Ints
from lidar_outlier_filter.evaluation.truth import Kind
from lidar_outlier_lab import _kernels

BLOCK = 16  # corners to a side, of the squares that a ray is led over at once
WAVES = 24  # that hills are made of
EAVES = 0.3  # metres that the foot of a tree's cone is above the ground


class TopView(NamedTuple):
    """What is seen at N positions from above: height of the top (metres), and kind."""

    height: Floats
    kind: Bytes


@dataclass(frozen=True)
class Landscape:
    """Heights at the corners of squares of ``cell`` metres; corner (0, 0) is at x = y = 0.

    Attributes
    ----------
    ground, top : (columns, rows) heights of the bare ground and of what stands on it, metres; x is
        the first index
    owner : (columns, rows) int64, what a corner belongs to: 0 the ground, more a house, less a
        tree. Between corners of several owners the height jumps.

    """

    ground: Floats
    top: Floats
    owner: Ints
    cell: float

    @property
    def size(self) -> tuple[float, float]:
        """Length along x and y, metres."""
        columns, rows = self.top.shape
        return (columns - 1) * self.cell, (rows - 1) * self.cell

    def view(self, x: Floats, y: Floats) -> TopView:
        """Look at positions (N,) from straight above."""
        owner = np.zeros(len(x), np.int64)
        x, y = map(np.ascontiguousarray, (x, y))
        height = _kernels.view_top(self.top, self.owner, self.cell, x, y, owner)
        return TopView(height, _kinds(owner))

    def cast(self, origin: Floats, direction: Floats, depth: Floats) -> tuple[Floats, Bytes]:
        """Follow rays down: the distance (N,) at which each meets something, and its kind.

        Parameters
        ----------
        origin, direction : (3, N) float64
            From above everything, downwards.
        depth : (N,) float64
            Metres of leaves that a ray goes through; then it is sent back. Below a tree is ground.

        """
        owner = np.zeros(len(depth), np.int64)
        fields = (self.ground, self.top, self.owner, _highest(self.top))
        bottom = float(self.ground.min()) - 1.0
        origin, direction, depth = map(np.ascontiguousarray, (origin, direction, depth))
        cell, side = self.cell, self.cell * BLOCK
        distance = _kernels.descend(fields, cell, side, origin, direction, depth, bottom, owner)
        return distance, _kinds(owner)


def _kinds(owner: Ints) -> Bytes:
    kinds = np.where(owner > 0, Kind.ROOF, np.where(owner < 0, Kind.FOLIAGE, Kind.TERRAIN))
    return kinds.astype(np.uint8)


def _highest(top: Floats) -> Floats:
    """Height above which nothing is in each square of ``BLOCK`` corners, or half a cell around."""
    padded = np.pad(top, [(0, BLOCK), (0, BLOCK)], mode='edge')
    highest: Floats = maximum_filter(padded, BLOCK + 2, mode='nearest')
    columns, rows = (slice(BLOCK // 2, side // BLOCK * BLOCK + BLOCK, BLOCK) for side in top.shape)
    return np.ascontiguousarray(highest[columns, rows])


def hills(size: tuple[float, float], cell: float, steep: float, rng: np.random.Generator) -> Floats:
    """Add waves up: from as long as the land to a few metres, the shorter the lower.

    ``steep`` is about the standard deviation of the slope of the longest ones.
    """
    columns, rows = (int(np.ceil(length / cell)) + 1 for length in size)
    x, y = cell * np.arange(columns)[:, None], cell * np.arange(rows)[None, :]
    height = np.zeros((columns, rows))
    for i in range(WAVES):
        length = max(size) * 0.85**i
        way, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        number = 2.0 * np.pi / length
        # cos(a + b) from two short rows of cosines: many times as fast as on the whole grid.
        a, b = number * np.cos(way) * x + phase, number * np.sin(way) * y
        wave = np.cos(a) * np.cos(b) - np.sin(a) * np.sin(b)
        height += steep / number * 0.9**i * rng.uniform(0.3, 1.0) * wave
    return height


@dataclass(frozen=True)
class Plants:
    """How many houses and trees, and how large: (low, high) in metres; of trees, the share pointed.

    ``clearing`` metres around a third of the middle stay free of trees; 0: none do.
    """

    houses: int
    trees: int
    eaves: tuple[float, float] = (3.0, 7.0)
    tall: tuple[float, float] = (4.0, 14.0)
    wide: tuple[float, float] = (1.5, 3.5)
    pointed: float = 0.3
    clearing: float = 0.0


def build(ground: Floats, cell: float, plants: Plants, rng: np.random.Generator) -> Landscape:
    """Put houses with gables, and trees round or pointed, on the ground; none hides another."""
    top, owner = ground.copy(), np.zeros(ground.shape, np.int64)
    land = Landscape(ground, top, owner, cell)
    long, broad = land.size
    for number in range(plants.houses):
        position = (rng.uniform(0.0, long), rng.uniform(0.0, broad))
        half = (rng.uniform(4.0, 9.0), rng.uniform(3.5, 6.0))
        _house(land, number + 1, position, half, rng.uniform(*plants.eaves))
    middle = np.array([long / 2.0, broad / 2.0])
    for number in range(plants.trees):
        position = (rng.uniform(0.0, long), rng.uniform(0.0, broad))
        tall, wide, lot = rng.uniform(*plants.tall), rng.uniform(*plants.wide), rng.random()
        if np.hypot(*(np.array(position) - middle)) >= plants.clearing:
            _tree(land, -1 - number, position, (wide, tall), is_pointed=lot < plants.pointed)
    return land


def _house(
    land: Landscape,
    number: int,
    position: tuple[float, float],
    half: tuple[float, float],
    eaves: float,
) -> None:
    """Put a house with a ridge along x, unless something is there."""
    box = _box(land, position, half)
    if land.owner[box].any():
        return
    _, y = _around(land, box, position)
    base = land.ground[box].max()
    roof = base + eaves + 0.7 * (half[1] - np.minimum(np.abs(y), half[1]))
    land.top[box] = roof
    land.owner[box] = number


def _tree(
    land: Landscape,
    number: int,
    position: tuple[float, float],
    size: tuple[float, float],
    *,
    is_pointed: bool,
) -> None:
    """Put a cone or half an ellipsoid of (radius, height) where it stands out above the others."""
    wide, tall = size
    box = _box(land, position, (wide, wide))
    x, y = _around(land, box, position)
    off = np.sqrt(x * x + y * y) / wide
    form = 1.0 - off if is_pointed else np.sqrt(np.maximum(1.0 - off * off, 0.0))
    height = land.ground[box] + EAVES + (tall - EAVES) * form
    higher = (off < 1.0) & (land.owner[box] <= 0) & (height > land.top[box])
    land.top[box] = np.where(higher, height, land.top[box])
    land.owner[box] = np.where(higher, number, land.owner[box])


def _box(
    land: Landscape, position: tuple[float, float], half: tuple[float, float]
) -> tuple[slice, slice]:
    """Corners within a rectangle around a position."""
    low, high = (
        [int((at + sign * reach) / land.cell) for at, reach in zip(position, half, strict=True)]
        for sign in (-1.0, 1.0)
    )
    return (slice(max(low[0], 0), high[0] + 1), slice(max(low[1], 0), high[1] + 1))


def _around(
    land: Landscape, box: tuple[slice, slice], position: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Coordinates of the corners in a box, from a position."""
    columns, rows = land.owner[box].shape
    x = (box[0].start + np.arange(columns)) * land.cell - position[0]
    y = (box[1].start + np.arange(rows)) * land.cell - position[1]
    return x[:, None], y[None, :]
