# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What hangs in the air and sends rays back: clouds of droplets, rain and snow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, ndtri

from lidar_outlier_filter.simulation.scene import Cause, towards

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.simulation.scene import Rays

    Floats = NDArray[np.float64]

TINY = 1e-12


@dataclass(frozen=True)
class Puff:
    """A normally distributed cloud of droplets: ``size`` its three standard deviations, metres.

    ``density`` is the chance per metre, at its centre, that a ray is sent back. It moves with
    ``velocity``, metres per second; ``centre`` is where it is at t = 0.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    density: float
    cause: Cause = Cause.EXHAUST
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def meet(self, rays: Rays, reach: Floats, rng: Floats) -> Floats:
        """Distance (N,) at which the centres of bundles are sent back before ``reach``; inf: never.

        ``rng`` (N,), uniform in 0 to 1, decides; the law is that of Beer and Lambert.
        """
        drift = np.reshape(self.velocity, (3, 1)) * rays.t
        if drift.any():
            rays = type(rays)(rays.origin - drift[:, :, None], rays.direction, rays.t, rays.reach)
        far = np.full(len(reach), np.inf)
        near = towards(rays, (np.array(self.centre), 4.0 * max(self.size)))
        origin, direction = rays.origin[:, near, 0], rays.direction[:, near, 0]
        far[near] = self._meet(origin, direction, reach[near], rng[near])
        return far

    def _meet(self, origin: Floats, direction: Floats, reach: Floats, rng: Floats) -> Floats:
        """Distance (M,) for single rays (3, M)."""
        size = np.reshape(self.size, (3, 1))
        start, step = (origin - np.reshape(self.centre, (3, 1))) / size, direction / size
        pace = np.sqrt((step * step).sum(axis=0))
        middle = -(start * step).sum(axis=0) / pace**2
        aside = (start * start).sum(axis=0) - (middle * pace) ** 2
        whole = self.density * np.exp(-aside / 2.0) * np.sqrt(2.0 * np.pi) / pace
        before = ndtr(-middle * pace)
        depth = whole * (ndtr((reach - middle) * pace) - before)
        sent_back = rng < -np.expm1(-depth)
        wanted = before - np.log1p(-np.where(sent_back, rng, 0.0)) / np.maximum(whole, TINY)
        place = middle + ndtri(np.clip(wanted, 0.0, 1.0)) / pace
        return np.where(sent_back, place, np.inf)


@dataclass(frozen=True)
class Fall:
    """Rain or snow, everywhere.

    The chance per metre that a ray is sent back is ``density / (1 + (range / fade)²)``: what hangs
    near a scanner is seen by it, and of what is far the echo is too weak.
    """

    cause: Cause
    density: float
    fade: float

    def meet(self, rays: Rays, reach: Floats, rng: Floats) -> Floats:  # noqa: ARG002
        """Distance (N,) at which bundles are sent back before ``reach``; inf: never."""
        depth = -np.log1p(-rng) / (self.density * self.fade)
        falls = depth < np.pi / 2.0
        far = np.where(falls, self.fade * np.tan(np.where(falls, depth, 0.0)), np.inf)
        return np.where(far < reach, far, np.inf)
