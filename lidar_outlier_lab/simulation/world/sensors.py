# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated scanners: where their shots go, and what they make of what comes back."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Rows
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab import _kernels
from lidar_outlier_lab.simulation.world.scene import Hits

# What every point carries; ``t`` is in nanoseconds after the header stamp, the last two are codes
# of Cause and Kind.
FIRST = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('t', '<u4')]
TRUTH = [('label', 'u1'), ('surface', 'u1')]
BLOCK_LINES = 20  # lines of a profile scanner that are cast at once, and share one stream of rng
BLOCK_COLUMNS = 250  # columns of a spinning scanner, likewise


@dataclass(frozen=True)
class Echoes:
    """What the receiver makes of N shots.

    Attributes
    ----------
    distance : (N,) metres without noise; inf where no echo was strong enough
    cosine : (N,) of the angle of incidence
    surface : (N,) int64, index of the surface met nearest to the distance; -1 without echo
    part : (N,) int64, part of that surface, as in :class:`Hits`
    mixed : (N,) bool, the echo lies between surfaces that the footprint hit together, and on
        neither

    """

    distance: Floats
    cosine: Floats
    surface: Ints
    part: Ints
    mixed: Bools


@dataclass(frozen=True, kw_only=True)
class Receiver:
    """What a scanner makes of the light that comes back; values are those of a survey scanner.

    Attributes
    ----------
    noise, noise_per_metre : standard deviation of a range at no range and normal incidence, metres,
        and by how much it grows with each metre
    noise_of_spread : adds this much of the range over which a leaning surface spreads the footprint
    resolution : ranges are rounded to multiples of it, metres; 0: they are not
    aperture, divergence : radius of the beam at the scanner, metres, and by how much it grows with
        each metre
    sub_rays : rays on the rim of a footprint, beside the one in its centre
    pulse : returns closer together than this are one echo, metres
    keeps_mixed : False: an echo of several surfaces is seen in the form of its pulse, and none is
        given
    nearest, farthest : ranges that are measured, metres
    weakest : least reflectance × cosine of incidence ÷ range² that gives an echo

    """

    noise: float = 0.008
    noise_per_metre: float = 0.0001
    noise_of_spread: float = 0.25
    resolution: float = 0.0
    aperture: float = 0.005
    divergence: float = 0.00025
    sub_rays: int = 6
    pulse: float = 0.8
    keeps_mixed: bool = True
    nearest: float = 1.0
    farthest: float = 150.0
    weakest: float = 4e-6

    def footprint(self, distance: Floats) -> Floats:
        """Radius of the beam at a range, metres."""
        return self.aperture + self.divergence * distance

    @property
    def reach(self) -> float:
        """Metres that the rays of a footprint stay within of its centre."""
        return self.aperture + self.divergence * 2.0 * self.farthest

    def range_sigma(self, distance: Floats, cosine: Floats) -> Floats:
        """Return the standard deviation of a range, which grows with it and with the incidence."""
        lean = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 0.01)
        spread = self.noise_of_spread * self.footprint(distance) * lean
        return np.hypot(self.noise + self.noise_per_metre * distance, spread)

    def measure(self, distance: Floats) -> Floats:
        """Round ranges as the scanner does."""
        if self.resolution == 0.0:
            return distance
        return np.rint(distance / self.resolution) * self.resolution

    def is_seen(self, distance: Floats, strength: Floats) -> Bools:
        """Return whether echoes from a range, so much of the light coming back, are measured."""
        inside = (distance >= self.nearest) & (distance <= self.farthest)
        return inside & (strength >= self.weakest * np.where(inside, distance, 0.0) ** 2)

    def receive(self, hits: Hits, reflectance: Floats) -> Echoes:
        """Make one echo of what the rays of each footprint met, ``reflectance`` (N, K) there.

        Returns closer than ``pulse`` merge; of what is farther apart, the strongest counts.
        """
        distance, share = _kernels.strongest(hits.distance, self.pulse)
        safe = np.where(share > 0.0, distance, 0.0)
        off = np.abs(hits.distance - safe[:, None])
        nearest = off.argmin(axis=1)[:, None]
        values: tuple[Any, ...] = off, hits.cosine, reflectance, hits.surface, hits.part
        apart, cosine, bright, surface, part = (
            np.take_along_axis(one, nearest, axis=1)[:, 0] for one in values
        )
        seen = self.is_seen(safe, share * bright * cosine)
        mixed = seen & (apart > 3.0 * self.range_sigma(safe, cosine))
        if not self.keeps_mixed:
            seen &= ~mixed
        distance = np.where(seen, safe, np.inf)
        return Echoes(distance, cosine, np.where(seen, surface, -1), part, mixed & seen)

    def without_strongest(self, distance: Floats) -> Floats:
        """Return distances (N, K) of rays without the group that gives the strongest echo."""
        order = distance.argsort(axis=1, kind='stable')
        there = np.take_along_axis(distance, order, axis=1)
        inside = np.isfinite(there)
        steps = np.diff(np.where(inside, there, 0.0), axis=1) > self.pulse
        group = np.pad(np.cumsum(steps, axis=1), ((0, 0), (1, 0)))
        groups = np.arange(distance.shape[1])[:, None, None]
        sizes = ((group == groups) & inside).sum(axis=2)
        there[group == sizes.argmax(axis=0)[:, None]] = np.inf
        left = np.empty_like(distance)
        np.put_along_axis(left, order, there, axis=1)
        return left

    def _rims(self, centre: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
        """Origins and directions (3, N, 1 + sub_rays) of beams around (3, N) directions.

        ``first`` and ``second``, (3, N) or (3, 1), span the plane across the beam.
        """
        rim = 2.0 * np.pi / self.sub_rays * np.arange(self.sub_rays)
        offset = first[:, :, None] * np.cos(rim) + second[:, :, None] * np.sin(rim)
        offset = np.concatenate([np.zeros((3, centre.shape[1], 1)), offset], axis=2)
        direction = centre[:, :, None] + self.divergence * offset
        return self.aperture * offset, direction / np.sqrt((direction**2).sum(axis=0))


@dataclass(frozen=True, kw_only=True)
class ProfileScanner(Receiver):
    """A mirror that turns about one axis: a full circle per scan line, angle 0 straight up.

    The axis points along the drive, turned left by ``yaw`` and up by ``tilt`` (rad), so that
    neither kerbs nor poles lie in the scan plane. With ``numbers_lines`` each point carries the
    number of its line, else only its angle. A mirror with facets, or one that swings to and fro,
    looks ``view`` rad around straight down in each line.
    """

    lines_per_second: float = 200.0
    shots_per_line: int = 1000
    yaw: float = np.radians(45.0)
    tilt: float = np.radians(15.0)
    numbers_lines: bool = False
    view: float = 2.0 * np.pi
    swings: bool = False

    def __post_init__(self) -> None:
        """Refuse a shot rate that is not a whole number of nanoseconds."""
        interval = SECOND / (self.lines_per_second * self.shots_per_line)
        if abs(interval - round(interval)) > 1e-9 * interval:
            raise FilterError('the interval of the shots', 'whole nanoseconds', f'{interval} ns')

    @property
    def interval(self) -> int:
        """Time between shots, nanoseconds."""
        return round(SECOND / (self.lines_per_second * self.shots_per_line))

    @property
    def block(self) -> int:
        """Shots that are cast at once."""
        return BLOCK_LINES * self.shots_per_line

    @property
    def point(self) -> np.dtype[np.void]:
        """Fields of a point."""
        line = [('line', '<u4')] if self.numbers_lines else []
        return np.dtype([*FIRST, ('scan_angle', '<f4'), *line, *TRUTH])

    def seconds(self, shot: Ints) -> Floats:
        """Seconds from the first shot to others."""
        return shot.astype(np.float64) * (self.interval / SECOND)

    def note(self, points: Rows, shot: Ints) -> None:
        """Write what the scanner itself knows of its shots into their points."""
        points['scan_angle'] = self.angle(shot)
        if self.numbers_lines:
            points['line'] = shot // self.shots_per_line

    def angle(self, shot: Ints) -> Floats:
        """Scan angle of shots counted from the start of the drive, 0 (up) to 2π."""
        step, number = self.view / self.shots_per_line, shot % self.shots_per_line
        if self.swings:
            back = shot // self.shots_per_line % 2 == 1
            number = np.where(back, self.shots_per_line - 1 - number, number)
        return (np.pi - self.view / 2.0) + step * number.astype(np.float64)

    def bundle(self, shot: Ints) -> tuple[Floats, Floats]:
        """Origins and directions (3, N, 1 + sub_rays) from the scanner, vehicle's frame."""
        axis, up, side = self._axes()
        angle = self.angle(shot)
        sin, cos = np.sin(angle), np.cos(angle)
        centre = up[:, None] * cos + side[:, None] * sin
        onward = side[:, None] * cos - up[:, None] * sin
        return self._rims(centre, onward, axis[:, None])

    def _axes(self) -> tuple[Floats, Floats, Floats]:
        """Give the axis of the mirror, 'up' in the scan plane, and 'sideways' (right) in it."""
        sin, cos = np.sin([self.yaw, self.tilt]), np.cos([self.yaw, self.tilt])
        axis = np.array([cos[0] * cos[1], sin[0] * cos[1], sin[1]])
        side = np.array([sin[0], -cos[0], 0.0])
        return axis, np.cross(side, axis), side


@dataclass(frozen=True, kw_only=True)
class LaserScanner(Receiver):
    """Lasers that fire one after the other, evenly in time; a line is a turn, or a cloud."""

    noise: float = 0.012
    noise_per_metre: float = 0.0002
    aperture: float = 0.006
    weakest: float = 1.2e-5

    @property
    @abstractmethod
    def rings(self) -> int:
        """Number of lasers."""

    @property
    @abstractmethod
    def interval(self) -> int:
        """Time between shots, nanoseconds."""

    @property
    @abstractmethod
    def shots_per_line(self) -> int:
        """Shots of a line."""

    @property
    def lines_per_second(self) -> float:
        """Lines per second."""
        return SECOND / (self.shots_per_line * self.interval)

    def seconds(self, shot: Ints) -> Floats:
        """Seconds from the first shot to others."""
        return shot * self.interval / SECOND


@dataclass(frozen=True, kw_only=True)
class SpinningScanner(LaserScanner):
    """A column of lasers, one for each ring, that turns clockwise; a turn begins at the back (-x).

    The lasers of a column fire one after the other, ring 0 first, evenly spread over its time; each
    points where the head has turned to by then.

    Attributes
    ----------
    elevation : (rings,) tuple of float, of each ring, rad
    columns : of a turn
    column_time : nanoseconds; a whole number of them for each laser

    """

    elevation: tuple[float, ...] = field(default=tuple(np.radians(np.linspace(-30.0, 10.0, 32))))
    columns: int = 2000
    column_time: int = 50_048
    resolution: float = 0.002
    divergence: float = 0.0012
    nearest: float = 0.8
    farthest: float = 120.0

    def __post_init__(self) -> None:
        """Refuse what has no lasers, or a laser that does not fire at a whole nanosecond."""
        if not self.elevation:
            raise FilterError('the elevations of the rings', 'at least one', 'none')
        if self.column_time < 1 or self.column_time % self.rings:
            must_be = f'a multiple of the number of rings, {self.rings}'
            raise FilterError('column_time', must_be, f'{self.column_time} ns')

    @property
    def rings(self) -> int:
        """Number of lasers."""
        return len(self.elevation)

    @property
    def interval(self) -> int:
        """Time between shots, nanoseconds."""
        return self.column_time // self.rings

    @property
    def shots_per_line(self) -> int:
        """Shots of a turn."""
        return self.columns * self.rings

    @property
    def block(self) -> int:
        """Shots that are cast at once."""
        return BLOCK_COLUMNS * self.rings

    @property
    def point(self) -> np.dtype[np.void]:
        """Fields of a point."""
        return np.dtype([*FIRST, ('ring', '<u2'), *TRUTH])

    def note(self, points: Rows, shot: Ints) -> None:
        """Write what the scanner itself knows of its shots into their points."""
        points['ring'] = shot % self.rings

    def bundle(self, shot: Ints) -> tuple[Floats, Floats]:
        """Origins and directions (3, N, 1 + sub_rays) from the scanner, in its own frame."""
        turned = (shot % self.shots_per_line) / self.shots_per_line
        azimuth, up = np.pi - 2.0 * np.pi * turned, np.array(self.elevation)[shot % self.rings]
        sin, cos = np.sin(azimuth), np.cos(azimuth)
        centre = np.stack([np.cos(up) * cos, np.cos(up) * sin, np.sin(up)])
        aside = np.stack([sin, -cos, np.zeros_like(sin)])
        above = np.stack([-np.sin(up) * cos, -np.sin(up) * sin, np.cos(up)])
        return self._rims(centre, aside, above)
