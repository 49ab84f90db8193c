# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What hangs in the air and sends rays back: clouds of droplets, rain and snow."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.special import ndtr, ndtri

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.simulation.weather.beams import Optics
from lidar_outlier_lab.simulation.weather.drops import REACH, STEPS, Precipitation, hazard, power
from lidar_outlier_lab.simulation.world.scene import Rays, towards

TINY = 1e-12
LEVELS = 200  # of the power to outshine, that chances are tabulated for
BRIGHTEST = 2.0  # reflectance of a surface that sends light straight back


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

    def meet(self, rays: Rays, reach: Floats, bright: Floats, rng: Floats) -> Floats:  # noqa: ARG002
        """Distance (N,) at which the centres of bundles are sent back before ``reach``; inf: never.

        ``rng`` (N,), uniform in 0 to 1, decides; the law is that of Beer and Lambert.
        """
        drift = np.reshape(self.velocity, (3, 1)) * rays.t
        if drift.any():
            rays = type(rays)(rays.origin - drift[:, :, None], rays.direction, rays.t, rays.reach)
        far = np.full(len(reach), np.inf)
        near = towards(rays, np.array(self.centre), 4.0 * max(self.size))
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
        requested = before - np.log1p(-np.where(sent_back, rng, 0.0)) / np.maximum(whole, TINY)
        position = middle + ndtri(np.clip(requested, 0.0, 1.0)) / pace
        return np.where(sent_back, position, np.inf)


@dataclass(frozen=True)
class Fall:
    """Rain or snow, everywhere: drops of all sizes, of which the nearest that is seen counts.

    A drop is seen if its echo is above the noise and above the surface's behind it: at range r
    before a surface of reflectance ρt at R, without extinction, its diameter must be at least
    θ r² √(ρt ÷ ρp) ÷ R. Both echoes lose light to the fall (Beer and Lambert). See :mod:`.drops`.

    Attributes
    ----------
    cause : Cause
    drops : Precipitation
    optics : of the sensor: its beams, and its noise

    """

    cause: Cause
    drops: Precipitation
    optics: Optics

    def meet(self, rays: Rays, reach: Floats, bright: Floats, rng: Floats) -> Floats:  # noqa: ARG002
        """Distance (N,) at which bundles are sent back before ``reach``; inf: never."""
        edges, levels, total = self._chances
        least = power(reach, bright, self.drops.extinction)
        level = np.searchsorted(levels, np.maximum(least, levels[0])).clip(0, len(levels) - 1)
        depth = -np.log1p(-rng)
        far = np.full(len(reach), np.inf)
        for number in np.unique(level):
            mine = np.flatnonzero(level == number)
            sums = total[number]
            met = mine[depth[mine] < np.interp(reach[mine], edges, sums)]
            # Where no drop is seen, the sum stands still: its inverse is not unique, and not asked.
            rising = np.concatenate([[True], np.diff(sums) > 0])
            far[met] = np.interp(depth[met], sums[rising], edges[rising])
        return far

    @cached_property
    def _chances(self) -> tuple[Floats, Floats, Floats]:
        """Ranges (M,), powers (L,), and how many drops outshine each up to a range (L, M)."""
        optics = self.optics
        edges = np.geomspace(optics.nearest, REACH, STEPS)
        levels = np.geomspace(optics.floor, BRIGHTEST / optics.nearest**2, LEVELS)
        chance = np.stack(
            [hazard(self.drops, optics, edges, np.full(STEPS, level)) for level in levels]
        )
        return edges, levels, cumulative_trapezoid(chance, edges, initial=0.0)


@dataclass(frozen=True)
class ThinFall:
    """Rain or snow by a simple law, of which as few can be drawn as one likes.

    The chance per metre that a ray is sent back is ``density / (1 + (range / fade)²)``. So it is
    densest at the scanner, unlike :class:`Fall`; the package's trees were trained on it.
    """

    cause: Cause
    density: float
    fade: float

    def meet(self, rays: Rays, reach: Floats, bright: Floats, rng: Floats) -> Floats:  # noqa: ARG002
        """Distance (N,) at which bundles are sent back before ``reach``; inf: never."""
        depth = -np.log1p(-rng) / (self.density * self.fade)
        falls = depth < np.pi / 2.0
        far = np.where(falls, self.fade * np.tan(np.where(falls, depth, 0.0)), np.inf)
        return np.where(far < reach, far, np.inf)


@dataclass(frozen=True)
class SunNoise:
    """Light that is no echo: a ``share`` of the shots is measured anywhere in the range gate.

    What lies before the surface replaces it; a shot at the sky gives a point.
    """

    share: float
    farthest: float = 150.0  # metres
    cause: Cause = Cause.SINGLE

    def meet(self, rays: Rays, reach: Floats, bright: Floats, rng: Floats) -> Floats:  # noqa: ARG002
        """Distance (N,) at which bundles seem to be sent back before ``reach``; inf: never."""
        far = np.where(rng < self.share, rng / self.share * self.farthest, np.inf)
        return np.where(far < reach, far, np.inf)
