# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Fog, dust, exhaust and spray: clouds of drops and grains too small to be seen one by one.

A cloud has an extinction α(x) per metre, which is uneven. A cell of length L of a beam sends back
(π / S) (1 - e^(-αL)) e^(-2τ) ÷ r² as much as a white surface would, τ the optical depth before it
and S the ratio of extinction and backscatter. So fog is that of Hahner et al. 2021 (arXiv
2108.05249, eq. 7 to 10: soft target), cut into cells; its β = 0.046 / MOR is the same as S = 65.
Echoes that are closer than a pulse add up, the number of grains fluctuates (a Gamma law), and the
strongest cell is measured if it is above the noise and above what is left of the surface's echo.
Light is lost on the whole way to the surface and back (Beer and Lambert), echoes come from before
it: the last cell ends there.
Spray comes off wheels in clumps that trail behind: it is emitted there by Yang et al. 2023 (arXiv
2312.12772), too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter1d

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_lab.simulation.weather.beams import Beams, Optics

LATTICE = 24  # cells of the noise, until it repeats
OCTAVES = 3
BEAMS = 4096  # that are followed at once
WIDE = 3.0  # standard deviations of a puff that count
OUTSIDE = 1e-3  # per metre: less extinction counts as 0
VOXEL = 0.2  # metres
FARTHEST = 12.0  # metres up to which what is everywhere sends back echoes that count
STEP = 1.0  # metres: cells of what is beyond, which only takes light
MAX_STEPS = 128  # up to a surface, however far
DRIFT = 0.15  # standard deviation of how far a plume strays, per metre


@dataclass(frozen=True)
class PlumePuff:
    """A normally distributed part of a cloud.

    Attributes
    ----------
    centre, size : (3,) metres; size its standard deviations
    density : extinction at the centre, per metre

    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    density: float


@dataclass(frozen=True)
class Plume:
    """A cloud of drops or grains.

    Attributes
    ----------
    puffs : what it is made of; none: it is everywhere
    density : extinction everywhere, per metre
    ratio : S, of extinction and backscatter, sr
    lump : metres over which it is uneven
    uneven : standard deviation of the logarithm of its density
    grains : shape of the Gamma law: the fewer, the more the echoes fluctuate
    cell : metres
    bottom : height below which there is nothing, metres

    """

    puffs: Sequence[PlumePuff] = ()
    density: float = 0.0
    ratio: float = 30.0
    lump: float = 1.0
    uneven: float = 1.0
    grains: float = 2.0
    cell: float = 0.15
    bottom: float = -np.inf


class _Field:
    """The extinction in space: what the puffs add up to, unevenly."""

    def __init__(self, cloud: Plume, rng: np.random.Generator) -> None:
        self._cloud = cloud
        self._lattice = rng.standard_normal((OCTAVES, LATTICE, LATTICE, LATTICE))
        self._shift = rng.uniform(0.0, LATTICE, (OCTAVES, 3))
        low, high = _bounds(cloud.puffs)
        self._low = low
        self._grid = np.zeros(np.ceil((high - low) / VOXEL).astype(np.int64) + 1)
        axes = [low[axis] + VOXEL * np.arange(self._grid.shape[axis]) for axis in range(3)]
        for puff in cloud.puffs:
            self._add(puff, axes)
        if cloud.puffs:
            positions = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1)
            inside = (self._grid > OUTSIDE) & (positions[..., 2] > cloud.bottom)
            self._grid[~inside] = 0.0
            self._grid[inside] *= self._lumps(positions[inside])

    def _add(self, puff: PlumePuff, axes: list[Floats]) -> None:
        parts, falls = [], []
        for axis, centre, size in zip(axes, puff.centre, puff.size, strict=True):
            first, last = np.searchsorted(axis, (centre - WIDE * size, centre + WIDE * size))
            parts.append(slice(first, last))
            falls.append(np.exp(-0.5 * ((axis[first:last] - centre) / size) ** 2))
        self._grid[tuple(parts)] += puff.density * np.einsum('i,j,k->ijk', *falls)

    def _lumps(self, xyz: Floats) -> Floats:
        """Return smooth noise at positions (M, 3), of mean 1."""
        total = np.zeros(len(xyz))
        for octave, values in enumerate(self._lattice):
            positions = xyz.T * (2.0**octave / self._cloud.lump) + self._shift[octave][:, None]
            total += 0.6**octave * map_coordinates(values, positions, order=1, mode='grid-wrap')
        # Between the lattice's values it varies less: by 0.6 on average.
        total /= 0.6 * np.sqrt(sum(0.36**octave for octave in range(OCTAVES)))
        uneven = self._cloud.uneven
        return np.exp(uneven * total - uneven**2 / 2.0)

    def at(self, direction: Floats, middle: Floats) -> Floats:
        """Return the extinction (N, M) at ranges along directions (N, 3)."""
        xyz = middle[:, :, None] * direction[:, None, :]
        if not self._cloud.puffs:
            flat = xyz.reshape(-1, 3)
            return (self._cloud.density * self._lumps(flat)).reshape(middle.shape)
        positions = np.moveaxis((xyz - self._low) / VOXEL, 2, 0)
        return map_coordinates(self._grid, positions, order=1, mode='constant')


def _bounds(puffs: Sequence[PlumePuff]) -> tuple[Floats, Floats]:
    if not puffs:
        return np.zeros(3), np.zeros(3)
    centre = np.array([puff.centre for puff in puffs])
    reach = WIDE * np.array([puff.size for puff in puffs])
    return (centre - reach).min(axis=0), (centre + reach).max(axis=0)


def strike(
    cloud: Plume,
    optics: Optics,
    beams: Beams,
    reach: Floats,
    rng: np.random.Generator,
) -> tuple[Floats, Floats, Floats]:
    """Send beams through a cloud.

    Parameters
    ----------
    reach : (N,) metres that each beam goes at most

    Returns
    -------
    distance : (N,) metres of the strongest echo of the cloud; inf: no echo
    power : (N,) of that echo
    left : (N,) share of the surface's light that comes through, there and back; of beams without
        a surface it says nothing

    """
    field = _Field(cloud, rng)
    count = len(beams)
    distance, power, left = np.full(count, np.inf), np.zeros(count), np.ones(count)
    begin, end = _limits(cloud, beams, reach)
    met = np.flatnonzero(end > begin)
    # Beams of like length together: all of a part take as many steps.
    met = met[np.argsort(end[met] - begin[met], kind='stable')]
    for first in range(0, len(met), BEAMS):
        some = met[first : first + BEAMS]
        direction, start, stop = beams.direction[some], begin[some], end[some]
        near = np.clip(optics.nearest, start, stop)
        far = stop if cloud.puffs else np.clip(FARTHEST, near, stop)
        before = _depth(field, direction, start, near)
        cells = _cells(field, direction, near, far, cloud.cell)
        behind = _depth(field, direction, far, stop)
        left[some] = np.exp(-2.0 * (before + cells.depth.sum(axis=1) + behind))
        distance[some], power[some] = _measure(cloud, optics, cells, before, rng)
    distance[power <= 0.0] = np.inf
    return distance, power, left


class _Cells(NamedTuple):
    """Cells (N, M) of beams: where they begin and end, metres, and their optical depth."""

    low: Floats
    high: Floats
    depth: Floats


def _cells(field: _Field, direction: Floats, begin: Floats, end: Floats, cell: float) -> _Cells:
    """Cut beams into cells; the last one of each ends where the beam does."""
    count = max(int(np.ceil((end - begin).max() / cell)), 1)
    edges = np.minimum(begin[:, None] + cell * np.arange(count + 1), end[:, None])
    low, high = edges[:, :-1], edges[:, 1:]
    return _Cells(low, high, field.at(direction, (low + high) / 2.0) * (high - low))


def _depth(field: _Field, direction: Floats, begin: Floats, end: Floats) -> Floats:
    """Return the optical depth (N,) between two ranges."""
    count = int(np.clip(np.ceil((end - begin).max() / STEP), 1, MAX_STEPS))
    step = (end - begin) / count
    middle = begin[:, None] + step[:, None] * (np.arange(count) + 0.5)
    return field.at(direction, middle).sum(axis=1) * step


def _measure(
    cloud: Plume, optics: Optics, cells: _Cells, before: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return how far (N,) the strongest echo of cells is, and its power; ``before`` is a depth."""
    low, high, depth = cells
    middle, row = (low + high) / 2.0, np.arange(len(low))
    passed = before[:, None] + np.cumsum(depth, axis=1) - depth
    echo = np.pi / cloud.ratio * -np.expm1(-depth) * np.exp(-2.0 * passed)
    echo *= optics.overlap(middle) / middle**2
    echo *= rng.gamma(cloud.grains, 1.0 / cloud.grains, echo.shape)
    pulse = max(int(optics.pulse / cloud.cell), 1)
    seen = pulse * uniform_filter1d(echo, pulse, axis=1, mode='constant')
    # What is measured is where the pulse is strongest; within it the brightest cell counts.
    best = np.argmax(seen + echo, axis=1)
    low, high = low[row, best], high[row, best]
    return low + (high - low) * rng.uniform(0.0, 1.0, len(low)), seen[row, best]


def _limits(cloud: Plume, beams: Beams, reach: Floats) -> tuple[Floats, Floats]:
    """Return between which ranges each beam is in the cloud, up to its surface."""
    count = len(beams)
    if not cloud.puffs:
        return np.zeros(count), np.where(np.isfinite(reach), reach, FARTHEST)
    begin, end = np.full(count, np.inf), np.zeros(count)
    for puff in cloud.puffs:
        centre, radius = np.array(puff.centre), WIDE * max(puff.size)
        along, square = beams.through(centre, radius)
        half = np.sqrt(np.maximum(square, 0.0))
        hit = (square > 0) & (along + half > 0)
        begin = np.where(hit, np.minimum(begin, along - half), begin)
        end = np.where(hit, np.maximum(end, along + half), end)
    return np.maximum(begin, 0.0), np.minimum(end, reach)


def trail(  # noqa: PLR0913  what makes a plume
    start: tuple[float, float, float],
    heading: float,
    length: float,
    density: float,
    rng: np.random.Generator,
    width: float = 0.25,
    growth: float = 0.12,
) -> tuple[PlumePuff, ...]:
    """Put puffs behind a wheel, a pipe or a vehicle, wider and thinner as they are left behind.

    ``heading`` (rad) is where the plume goes; it strays by ``DRIFT`` per metre.
    """
    count = max(int(length / 0.7), 1)
    puffs = []
    aside = DRIFT * rng.standard_normal()
    for number in range(count):
        way = length * (number + 0.5) / count
        size = width + growth * way
        turn = aside * way + 0.3 * size * rng.standard_normal()
        x = start[0] + way * np.cos(heading) - turn * np.sin(heading)
        y = start[1] + way * np.sin(heading) + turn * np.cos(heading)
        z = start[2] + 0.5 * size + 0.2 * size * rng.standard_normal()
        thin = density * (width / size) * rng.uniform(0.4, 1.6)
        if x * x + y * y + z * z < (WIDE * size) ** 2:
            continue  # The sensor itself is in clear air.
        shape = (size * rng.uniform(0.8, 1.4), size * rng.uniform(0.8, 1.4), 0.7 * size)
        puffs.append(PlumePuff((float(x), float(y), float(z)), shape, float(thin)))
    return tuple(puffs)
