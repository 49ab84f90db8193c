# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: surfaces and what hangs in the air between them, and what rays meet.

Frame: x along the street, y to the left, z up, metres. Arrays of rays are component first,
(3, ...), so that each component is contiguous. The first ray of a bundle is its centre; the others
lie close to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bytes, Floats, Ints
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab.simulation.world import caster
from lidar_outlier_lab.simulation.world.surfaces import Surface

BUNDLE_REACH = 0.1  # metres that the rays of a bundle stay within of its centre


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


@dataclass(frozen=True)
class Scene:
    """Surfaces, and what hangs in the air."""

    surfaces: tuple[Surface, ...]
    air: tuple[Air, ...] = field(default=())

    @cached_property
    def table(self) -> Floats:
        """Rows of all surfaces (S, caster.WIDTH)."""
        rows = [thing.row for thing in self.surfaces]
        return np.stack(rows) if rows else np.zeros((0, caster.WIDTH))

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
        # One layout of arrays: the kernel would be compiled again for each other one.
        origin, direction = map(np.ascontiguousarray, (rays.origin, rays.direction))
        return Hits(*caster.cast(self.table, origin, direction, rays.t, rays.reach))


def towards(rays: Rays, centre: Floats, radius: float) -> NDArray[np.intp]:
    """Index the bundles that may meet something inside a ball."""
    gap = centre[:, None] - rays.origin[:, :, 0]
    along = (gap * rays.direction[:, :, 0]).sum(axis=0)
    aside = (gap * gap).sum(axis=0) - along * along
    return np.flatnonzero((aside < (radius + rays.reach) ** 2) & (along > -radius))
