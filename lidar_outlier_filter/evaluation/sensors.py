# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated scanners: where their shots go, and what they make of what comes back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.points import SECOND
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.evaluation.scene import Hits

    Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Echoes:
    """What the receiver makes of N shots.

    Attributes
    ----------
    distance : (N,) float64
        Metres without noise; inf where no echo was strong enough.
    cosine : (N,) float64
        Of the angle of incidence.
    surface : (N,) int64
        Index of the surface met nearest to the distance; -1 without echo.
    mixed : (N,) bool
        The echo lies between surfaces that the footprint hit together, and on neither.

    """

    distance: Floats
    cosine: Floats
    surface: NDArray[np.int64]
    mixed: NDArray[np.bool_]


@dataclass(frozen=True)
class ProfileScanner:
    """A mirror that turns about one axis: a full circle per scan line, angle 0 straight up.

    The axis points along the drive, turned left by ``yaw`` and up by ``tilt`` (rad), so that
    neither kerbs nor poles lie in the scan plane. Values are those of a survey scanner such as the
    LYNX.

    Attributes
    ----------
    noise, noise_per_metre : float
        Standard deviation of a range at no range and normal incidence, metres, and by how much it
        grows with each metre.
    noise_of_spread : float
        Adds this much of the range over which a leaning surface spreads the footprint.
    aperture, divergence : float
        Radius of the beam at the scanner, metres, and by how much it grows with each metre.
    sub_rays : int
        Rays on the rim of a footprint, beside the one in its centre.
    pulse : float
        Returns closer together than this are one echo, metres.
    nearest, farthest : float
        Ranges that are measured, metres.
    weakest : float
        Least reflectance × cosine of incidence ÷ range² that gives an echo.

    """

    lines_per_second: float = 200.0
    shots_per_line: int = 1000
    yaw: float = np.radians(45.0)
    tilt: float = np.radians(15.0)
    noise: float = 0.008
    noise_per_metre: float = 0.0001
    noise_of_spread: float = 0.25
    aperture: float = 0.005
    divergence: float = 0.00025
    sub_rays: int = 6
    pulse: float = 0.8
    nearest: float = 1.0
    farthest: float = 150.0
    weakest: float = 4e-6

    def __post_init__(self) -> None:
        """Refuse a shot rate that is not a whole number of nanoseconds."""
        interval = SECOND / (self.lines_per_second * self.shots_per_line)
        if abs(interval - round(interval)) > 1e-9 * interval:
            raise FilterError('the interval of the shots', 'whole nanoseconds', f'{interval} ns')

    @property
    def interval(self) -> int:
        """Time between shots, nanoseconds."""
        return round(SECOND / (self.lines_per_second * self.shots_per_line))

    def angle(self, shot: NDArray[np.int64]) -> Floats:
        """Scan angle of shots counted from the start of the drive, 0 (up) to 2π."""
        step = 2.0 * np.pi / self.shots_per_line
        return step * (shot % self.shots_per_line).astype(np.float64)

    def bundle(self, angle: Floats) -> tuple[Floats, Floats]:
        """Origins and directions (3, N, 1 + sub_rays) from the scanner, vehicle's frame."""
        axis, up, side = self._axes()
        sin, cos = np.sin(angle), np.cos(angle)
        centre = up[:, None] * cos + side[:, None] * sin
        onward = side[:, None] * cos - up[:, None] * sin
        rim = 2.0 * np.pi / self.sub_rays * np.arange(self.sub_rays)
        offset = onward[:, :, None] * np.cos(rim) + axis[:, None, None] * np.sin(rim)
        offset = np.concatenate([np.zeros((3, len(angle), 1)), offset], axis=2)
        direction = centre[:, :, None] + self.divergence * offset
        return self.aperture * offset, direction / np.sqrt((direction**2).sum(axis=0))

    def _axes(self) -> tuple[Floats, Floats, Floats]:
        """Give the axis of the mirror, 'up' in the scan plane, and 'sideways' (right) in it."""
        sin, cos = np.sin([self.yaw, self.tilt]), np.cos([self.yaw, self.tilt])
        axis = np.array([cos[0] * cos[1], sin[0] * cos[1], sin[1]])
        side = np.array([sin[0], -cos[0], 0.0])
        return axis, np.cross(side, axis), side

    def footprint(self, distance: Floats) -> Floats:
        """Radius of the beam at a range, metres."""
        return self.aperture + self.divergence * distance

    def range_sigma(self, distance: Floats, cosine: Floats) -> Floats:
        """Tell the standard deviation of a range, which grows with it and with the incidence."""
        lean = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 0.01)
        spread = self.noise_of_spread * self.footprint(distance) * lean
        sigma: Floats = np.hypot(self.noise + self.noise_per_metre * distance, spread)
        return sigma

    def receive(self, hits: Hits, reflectance: Floats) -> Echoes:
        """Make one echo of what the rays of each footprint met, ``reflectance`` (N, K) there.

        Returns closer than ``pulse`` merge; of what is farther apart, the strongest counts.
        """
        distance, share = self._strongest(hits.distance)
        safe = np.where(share > 0.0, distance, 0.0)
        off = np.abs(hits.distance - safe[:, None])
        nearest = off.argmin(axis=1)[:, None]
        apart, cosine, bright, surface = (
            np.take_along_axis(values, nearest, axis=1)[:, 0]
            for values in (off, hits.cosine, reflectance, hits.surface)
        )
        seen = (safe >= self.nearest) & (safe <= self.farthest)
        seen &= share * bright * cosine >= self.weakest * safe**2
        mixed = seen & (apart > 3.0 * self.range_sigma(safe, cosine))
        distance = np.where(seen, safe, np.inf)
        return Echoes(distance, cosine, np.where(seen, surface, -1), mixed)

    def _strongest(self, distance: Floats) -> tuple[Floats, Floats]:
        """Mean distance (N,) and share of the largest group of rays; of equals the nearest."""
        count = distance.shape[1]
        ordered = np.sort(distance, axis=1)
        mean, share = ordered.mean(axis=1), np.isfinite(ordered[:, 0]).astype(np.float64)
        split = np.flatnonzero(np.isfinite(ordered[:, 0]))
        split = split[~(ordered[split, -1] - ordered[split, 0] <= self.pulse)]
        rays = ordered[split]
        met = np.isfinite(rays)
        rays = np.where(met, rays, 2.0 * self.farthest)
        steps = np.diff(rays, axis=1, prepend=rays[:, :1]) > self.pulse
        group = np.where(met, np.cumsum(steps, axis=1), -1)
        together = (group[:, :, None] == group[:, None, :]) & met[:, None, :]
        sizes = np.where(met, together.sum(axis=2), 0)
        largest = sizes.argmax(axis=1)[:, None]
        size = np.take_along_axis(sizes, largest, axis=1)[:, 0]
        chosen = np.take_along_axis(together, largest[:, :, None], axis=1)[:, 0]
        mean[split] = (rays * chosen).sum(axis=1) / size
        share[split] = size / count
        return mean, share
