# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: surfaces and what hangs in the air between them, and what rays meet.

Surfaces are rows of numbers, see caster.hpp; each function at the end makes one
from its measures in metres and radians.

Frame: x along the street, y to the left, z up, metres. Arrays of rays are component first,
(3, ...), so that each component is contiguous. The first ray of a bundle is its centre; the others
lie close to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bytes, Floats, Ints, Triple
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab import _kernels

Point = Triple | Floats

BUNDLE_REACH = 0.1  # metres that the rays of a bundle stay within of its centre
STILL = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Rays:
    """N bundles of K rays.

    Attributes
    ----------
    origin, direction : (3, N, K) metres; directions have length one
    t : (N,) seconds since the start of the drive, for what moves
    reach : metres that the rays of a bundle stay within of its centre

    """

    origin: Floats
    direction: Floats
    t: Floats
    reach: float = BUNDLE_REACH

    def take(self, index: NDArray[np.intp]) -> Rays:
        """Choose bundles by index."""
        return Rays(self.origin[:, index], self.direction[:, index], self.t[index], self.reach)


class Air(Protocol):
    """What hangs in the air and sends some rays back."""

    @property
    def cause(self) -> Cause:
        """Return why points in it are outliers."""

    def meet(self, rays: Rays, reach: Floats, bright: Floats, rng: Floats) -> Floats:
        """Distance (N,) where the centres of bundles are sent back before ``reach``; inf: never.

        ``bright`` (N,) is the reflectance of what is met at ``reach``, cosine of incidence
        included. ``rng`` (N,), uniform in 0 to 1, decides.
        """


@dataclass(frozen=True)
class Hits:
    """What N bundles of K rays met.

    Attributes
    ----------
    distance : (N, K) metres; inf where nothing was met
    cosine : (N, K) of the angle of incidence
    surface : (N, K) int64, index into the scene's surfaces; -1 where nothing was met
    part : (N, K) int64, which part of it: 0 to 2, a face that is normal to this axis; 3, any other;
        4 more, a pane

    """

    distance: Floats
    cosine: Floats
    surface: Ints
    part: Ints


@dataclass(frozen=True, eq=False)
class Surface:
    """What reflects.

    Attributes
    ----------
    row : (_kernels.WIDTH,) its numbers for the kernels
    kind, pane : what it is, and what its windows are
    reflectance : share of the light that comes back at normal incidence, 0 to 1
    cause : why points on it are outliers; GOOD: they are not outliers

    """

    row: Floats
    kind: Kind
    reflectance: float
    cause: Cause = Cause.GOOD
    pane: Kind = Kind.AIR


@dataclass(frozen=True)
class Scene:
    """Surfaces, and what hangs in the air."""

    surfaces: tuple[Surface, ...]
    air: tuple[Air, ...] = field(default=())

    @cached_property
    def table(self) -> Floats:
        """Rows of all surfaces (S, _kernels.WIDTH)."""
        rows = [thing.row for thing in self.surfaces]
        return np.stack(rows) if rows else np.zeros((0, _kernels.WIDTH))

    @cached_property
    def reflectance(self) -> Floats:
        """Reflectance of each surface, and of none (S + 1,)."""
        return np.array([thing.reflectance for thing in self.surfaces] + [0.0])

    @cached_property
    def kinds(self) -> Bytes:
        """Kind of each surface, and of none; of its panes (S + 1, 2)."""
        kinds = [(thing.kind, thing.pane) for thing in self.surfaces]
        return np.array([*kinds, (Kind.AIR, Kind.AIR)], np.uint8)

    @cached_property
    def causes(self) -> Bytes:
        """Cause of points on each surface, and on none (S + 1,)."""
        return np.array([thing.cause for thing in self.surfaces] + [Cause.GOOD], np.uint8)

    def cast(self, rays: Rays) -> Hits:
        """Find the nearest surface on every ray."""
        origin, direction = map(np.ascontiguousarray, (rays.origin, rays.direction))
        t = np.ascontiguousarray(rays.t)
        return Hits(*_kernels.cast_rays(self.table, origin, direction, t, rays.reach))


def towards(rays: Rays, centre: Floats, radius: float) -> NDArray[np.intp]:
    """Index the bundles that may meet something inside a ball."""
    gap = centre[:, None] - rays.origin[:, :, 0]
    along = (gap * rays.direction[:, :, 0]).sum(axis=0)
    aside = (gap * gap).sum(axis=0) - along * along
    return np.flatnonzero((aside < (radius + rays.reach) ** 2) & (along > -radius))


def _row(
    shape: int, rest: Sequence[float], low: Point, high: Point, velocity: Triple = STILL
) -> Floats:
    """Lay out a row; ``low`` and ``high`` are corners of a box around the surface at t = 0."""
    row = np.zeros(_kernels.WIDTH)
    row[0] = shape
    row[_kernels.LOW : _kernels.HIGH] = low
    row[_kernels.HIGH : _kernels.VELOCITY] = high
    row[_kernels.VELOCITY : _kernels.REST] = velocity
    row[_kernels.REST : _kernels.REST + len(rest)] = rest
    return row


def _around(centre: Triple, half: Triple | float) -> tuple[Floats, Floats]:
    """Low and high corner of a box around a centre."""
    middle, away = np.array(centre), np.array(half)
    return middle - away, middle + away


def ground(
    start: float,
    end: float,
    half_width: float,
    crown: float = 0.0,
    kind: Kind = Kind.ROAD,
) -> Surface:
    """Lay a road along x, highest in its middle; it is met from above only.

    z = crown (1 - (y / half_width)²)
    """
    low = (start, -half_width, min(crown, 0.0))
    high = (end, half_width, max(crown, 0.0))
    rest = (start, end, half_width, crown)
    return Surface(_row(_kernels.GROUND, rest, low, high), kind, 0.2)


def _corners(a: Triple, b: Triple) -> tuple[Triple, Triple]:
    """Low and high corner of a box, of any two opposite ones."""
    low, high = zip(*map(sorted, zip(a, b, strict=True)), strict=True)
    return low, high


def box(
    a: Triple, b: Triple, kind: Kind, reflectance: float = 0.4, velocity: Triple = STILL
) -> Surface:
    """Put up a box with its edges along the axes between opposite corners; it may move."""
    low, high = _corners(a, b)
    return Surface(_row(_kernels.BOX, (*low, *high), low, high, velocity), kind, reflectance)


def building(  # noqa: PLR0913  the measures of its windows
    a: Triple,
    b: Triple,
    *,
    pane: Kind = Kind.FACADE,
    reflectance: float = 0.4,
    pitch: float = 3.0,
    storey: float = 3.2,
    window: tuple[float, float] = (1.3, 1.6),
    recess: float = 0.2,
    open_every: int = 4,
    all_around: bool = False,
) -> Surface:
    """Put up a box between opposite corners, with recessed windows along the street, some open.

    Cells of ``pitch`` by ``storey`` metres hold one window each, ``recess`` deep. Through every
    ``open_every``-th a ray is lost inside; 0: all are closed. With ``all_around`` the walls across
    the street have windows too.
    """
    sill, (low, high) = 0.9, _corners(a, b)
    rest = (*low, *high, pitch, storey, *window, sill, recess, open_every, float(all_around))
    row = _row(_kernels.BUILDING, rest, low, high)
    return Surface(row, Kind.FACADE, reflectance, pane=pane)


def tube(foot: Triple, top: Triple, radius: float, kind: Kind, reflectance: float = 0.4) -> Surface:
    """Put up the outside of a tube between the middles of its ends: a trunk, a wire."""
    start, end = np.array(foot), np.array(top)
    # Not the norm by NumPy: BLAS adds in another order on another processor.
    length = math.dist(foot, top)
    if not length > 0.0:
        raise FilterError('the ends of a tube', 'apart', f'{foot} twice')
    rest = (*foot, *(end - start) / length, radius, length)
    low, high = np.minimum(start, end) - radius, np.maximum(start, end) + radius
    return Surface(_row(_kernels.TUBE, rest, low, high), kind, reflectance)


def pole(x: float, y: float, radius: float = 0.08, tall: float = 6.0) -> Surface:
    """Put up an upright tube on (x, y)."""
    return tube((x, y, 0.0), (x, y, tall), radius, Kind.POLE, 0.5)


def barrier_arm(
    pivot: Triple, length: float, angle: float, rate: float, radius: float = 0.05
) -> Surface:
    """Let a tube swing about a pivot beside the road, in the plane x = const., towards -y.

    It is raised by ``angle`` (rad) at ``t = 0`` and by ``rate`` (rad/s) more as time goes on.
    """
    row = _row(
        _kernels.ARM, (*pivot, length, radius, angle, rate), *_around(pivot, length + radius)
    )
    return Surface(row, Kind.ARM, 0.6, Cause.BARRIER)


def ball(centre: Triple, radius: float, velocity: Triple = STILL) -> Surface:
    """Let a ball fly: a bird, to a scanner."""
    row = _row(_kernels.BALL, (*centre, radius), *_around(centre, radius), velocity)
    return Surface(row, Kind.AIR, 0.3, Cause.BIRD)


def lid(
    centre: Triple, radius: float = 0.35, relief: float = 0.006, spacing: float = 0.08
) -> Surface:
    """Lay the lid of a manhole: a disc at a height, with ribs and grooves in squares.

    Ribs are ``spacing`` from each other, and grooves ``relief`` below them.
    """
    row = _row(_kernels.LID, (*centre, radius, relief, spacing), *_around(centre, radius + relief))
    return Surface(row, Kind.MANHOLE, 0.45)


def crown(  # noqa: PLR0913  the measures of its leaves
    centre: Triple,
    half: Triple,
    seed: int = 0,
    cell: float = 0.15,
    leaf: float = 0.07,
    share: float = 0.3,
) -> Surface:
    """Let the leaves of a tree or a hedge be discs of ``leaf`` metres radius in an ellipsoid.

    One in each of a ``share`` of the cubes of ``cell`` metres that it is cut into; where, and how
    it leans, is drawn from ``seed``, so that every ray finds the same leaf. A ray goes about
    ``2 cell³ / (π leaf² share)`` metres deep.
    """
    rest = (*centre, *half, cell, leaf, share, seed)
    return Surface(_row(_kernels.CROWN, rest, *_around(centre, half)), Kind.FOLIAGE, 0.4)
