# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scanners without rings: their beams go through prisms that turn, or over a mirror that nods.

Such a scanner points along x. It draws other curves in every cloud, so that gaps close with time.
What prisms do is the law of refraction at each of their faces (Liu, Yuan and Zhang 2022, Low-cost
retina-like robotic lidars based on incommensurable scanning, IEEE/ASME Transactions on
Mechatronics 27). The prisms of ``MID_40`` and ``L2`` are those of the simulator HELIOS++.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints, Rows
from lidar_outlier_lab.simulation.world.sensors import FIRST, TRUTH, LaserScanner

MINUTE = 60.0  # seconds


class Prism(NamedTuple):
    """A wedge of glass: the angle between its faces, rad, its turns a minute, its index."""

    angle: float
    turns: float
    refraction: float = 1.51


@dataclass(frozen=True, kw_only=True)
class FreeScanner(LaserScanner):
    """A scanner whose lasers fire one after the other, and whose clouds never repeat.

    Attributes
    ----------
    interval : time between shots, nanoseconds
    shots_per_line : shots of a cloud
    before : shots before the first one: where on its curve the scanner begins

    """

    interval: int = 10_000
    shots_per_line: int = 10_000
    before: int = 0
    resolution: float = 0.001
    divergence: float = 0.0013

    @abstractmethod
    def directions(self, shot: Ints) -> Floats:
        """Return directions (3, N) of shots counted from the start of the curve, of length one."""

    @property
    def block(self) -> int:
        """Shots that are cast at once."""
        return self.shots_per_line

    @property
    def point(self) -> np.dtype[np.void]:
        """Fields of a point."""
        return np.dtype([*FIRST, ('line', 'u1'), *TRUTH])

    def note(self, points: Rows, shot: Ints) -> None:
        """Write what the scanner itself knows of its shots into their points."""
        points['line'] = (self.before + shot) % self.rings

    def bundle(self, shot: Ints) -> tuple[Floats, Floats]:
        """Origins and directions (3, N, 1 + sub_rays) from the scanner, in its own frame."""
        centre = self.directions(self.before + shot)
        flat = np.hypot(centre[0], centre[1])
        aside = np.stack([centre[1], -centre[0], np.zeros_like(flat)]) / flat
        return self._rims(centre, aside, np.cross(aside, centre, axis=0))


@dataclass(frozen=True, kw_only=True)
class PrismScanner(FreeScanner):
    """Beams along x, in a fan, through prisms that turn about x.

    The first prism's flat face is towards the lasers, the others' is away from them.
    """

    prisms: tuple[Prism, ...]
    fan: tuple[float, ...] = (0.0,)  # rad, upwards

    @property
    def rings(self) -> int:
        """Number of lasers."""
        return len(self.fan)

    def directions(self, shot: Ints) -> Floats:
        """Return directions (3, N) of shots counted from the start of the curve, of length one."""
        up = np.array(self.fan)[shot % self.rings]
        beam = np.stack([np.cos(up), np.zeros_like(up), np.sin(up)])
        flat = np.array([1.0, 0.0, 0.0])[:, None]
        for number, prism in enumerate(self.prisms):
            turned = 2.0 * np.pi * prism.turns / MINUTE * self.seconds(shot)
            lean = np.sin(prism.angle) * (1.0 if number == 0 else -1.0)
            across = np.stack([np.cos(turned), np.sin(turned)])
            wedge = np.stack([np.full(len(shot), np.cos(prism.angle)), *(lean * across)])
            first, second = (flat, wedge) if number == 0 else (wedge, flat)
            beam = refract(refract(beam, first, 1.0 / prism.refraction), second, prism.refraction)
        return beam


@dataclass(frozen=True, kw_only=True)
class NoddingScanner(FreeScanner):
    """Lasers side by side on a rotor that nods: all around, in wide zigzags.

    Each laser goes up and down once more with every turn of the rotor, ``apart`` from the next.
    """

    low: float = np.radians(-7.0)
    high: float = np.radians(52.0)
    turns: float = 181.0 * MINUTE  # a minute
    nods: float = 9.7 * MINUTE  # a minute
    rings: int = 4  # lasers
    apart: float = np.radians(2.8)

    def directions(self, shot: Ints) -> Floats:
        """Return directions (3, N) of shots counted from the start of the curve, of length one."""
        minutes = self.seconds(shot) / MINUTE
        azimuth = -2.0 * np.pi * self.turns * minutes
        beside = (shot % self.rings - (self.rings - 1) / 2.0) * self.apart
        reach = (self.rings - 1) / 2.0 * self.apart
        middle, swing = (self.low + self.high) / 2.0, (self.high - self.low) / 2.0 - reach
        up = middle + swing * np.cos(2.0 * np.pi * self.nods * minutes) + beside * np.cos(azimuth)
        return np.stack([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])


def refract(beam: Floats, normal: Floats, ratio: float) -> Floats:
    """Bend beams (3, N) at faces whose normals (3, N) or (3, 1) go along with them.

    ``ratio`` is the refractive index before the face ÷ that behind it.
    """
    cosine = (beam * normal).sum(axis=0)
    behind = np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2))
    return ratio * beam + (behind - ratio * cosine) * normal


_WEDGE = np.radians(27.65251)
_TURNS = 631.7
# One laser, a rosette within 38.4°; 100 000 shots a second.
MID_40 = PrismScanner(
    prisms=(
        Prism(np.radians(18.0), -4664.0, 1.5095),
        Prism(np.radians(18.0), 7294.0, 1.5095),
    )
)
# Six lasers, 70° by 75°; 240 000 shots a second.
L2 = PrismScanner(
    interval=4167,
    shots_per_line=24_000,
    prisms=(
        Prism(_WEDGE, _TURNS),
        Prism(1.072 * _WEDGE, -(5.0 - 3.0 / 32.0) * _TURNS),
        Prism(0.100565 * _WEDGE, _TURNS),
    ),
    fan=tuple(np.arctan(np.linspace(-0.0268873, 0.0268873, 6)).tolist()),
)
# Four lasers, all around, from 7° below the horizon to 52° above it; 200 000 shots a second. Its
# maker's table is no formula: this has its speeds, its field of view, and how far lasers are apart.
MID_360 = NoddingScanner(interval=5000, shots_per_line=20_000)
