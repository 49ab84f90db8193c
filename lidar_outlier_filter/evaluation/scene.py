# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of plain surfaces and puffs of condensation, and what rays meet in them.

Frame: x along the street, y to the left, z up, metres. Arrays of rays are component first,
(3, ...), so that each component is contiguous. The first ray of a bundle is its centre; the others
lie close to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.special import ndtr, ndtri

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

BUNDLE_REACH = 0.1  # metres that the rays of a bundle stay within of its centre
TINY = 1e-12  # keeps a ray parallel to a face from dividing by zero; it meets the face nowhere near


class Cause(IntEnum):
    """Why a point is where it is; the code in the field ``label``."""

    GOOD = 0
    REFLECTION = 1
    EXHAUST = 2
    BARRIER = 3
    NEAR_SURFACE = 4
    MIXED = 5


class Kind(IntEnum):
    """What a shot was reflected by; the code in the field ``surface``."""

    AIR = 0
    ROAD = 1
    KERB = 2
    SIDEWALK = 3
    FACADE = 4
    POLE = 5
    CAR = 6
    ARM = 7


@dataclass(frozen=True)
class Rays:
    """N bundles of K rays.

    Attributes
    ----------
    origin, direction : (3, N, K) float64
        Metres; directions have length one.
    t : (N,) float64
        Seconds since the start of the drive, for what moves.

    """

    origin: Floats
    direction: Floats
    t: Floats

    def take(self, index: NDArray[np.intp]) -> Rays:
        """Choose bundles by index."""
        return Rays(self.origin[:, index], self.direction[:, index], self.t[index])


class Surface(Protocol):
    """What reflects."""

    @property
    def kind(self) -> Kind:
        """Tell what it is."""

    @property
    def reflectance(self) -> float:
        """Share of the light that comes back at normal incidence, 0 to 1."""

    @property
    def cause(self) -> Cause:
        """Tell whether points on it are outliers, and why."""

    @property
    def sphere(self) -> tuple[Floats, float] | None:
        """Centre and radius of a ball around it; None: too large to be worth one."""

    def meet(self, origin: Floats, direction: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Distance (inf: missed) and cosine of incidence of rays (3, ...) at t (...)."""


@dataclass(frozen=True)
class Ground:
    """A road along x, highest in its middle: z = crown (1 - (y / half_width)²)."""

    start: float
    end: float
    half_width: float
    crown: float = 0.0
    kind: Kind = Kind.ROAD
    reflectance: float = 0.2
    cause: Cause = Cause.GOOD
    sphere: None = None

    def height(self, y: Floats) -> Floats:
        """Height of the road at y, metres."""
        return self.crown * (1.0 - (y / self.half_width) ** 2)

    def meet(self, origin: Floats, direction: Floats, t: Floats) -> tuple[Floats, Floats]:  # noqa: ARG002
        """Distance and cosine of incidence, for rays from above."""
        bend = self.crown / self.half_width**2
        a = bend * direction[1] ** 2
        b = direction[2] + 2.0 * bend * origin[1] * direction[1]
        c = origin[2] - self.height(origin[1])
        root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
        # This form of the quadratic formula is exact for the flat road (a = 0) too.
        distance = 2.0 * c / np.maximum(root - b, TINY)
        x = origin[0] + distance * direction[0]
        y = origin[1] + distance * direction[1]
        inside = (x >= self.start) & (x <= self.end) & (np.abs(y) <= self.half_width)
        met = inside & (b < 0.0) & (c > 0.0) & (b * b >= 4.0 * a * c)
        slope = 2.0 * bend * y
        cosine = np.abs(direction[2] + slope * direction[1]) / np.sqrt(1.0 + slope * slope)
        return np.where(met, distance, np.inf), cosine


@dataclass(frozen=True)
class Box:
    """A box with its edges along the axes, from ``low`` to ``high``."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    kind: Kind
    reflectance: float = 0.4
    cause: Cause = Cause.GOOD

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Ball around the corners."""
        low, high = np.array(self.low), np.array(self.high)
        return (low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0

    def enter(self, origin: Floats, direction: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Distance to the face entered first (inf: missed), and the axis that is normal to it."""
        shape = (3,) + (1,) * (direction.ndim - 1)
        safe = np.where(np.abs(direction) < TINY, TINY, direction)
        first = (np.reshape(self.low, shape) - origin) / safe
        second = (np.reshape(self.high, shape) - origin) / safe
        entries = np.minimum(first, second)
        exits = np.maximum(first, second)
        # Pairwise maxima are several times as fast as a reduction over an axis of length three.
        axis = np.where(entries[1] > entries[0], 1, 0)
        entry = np.maximum(entries[0], entries[1])
        axis = np.where(entries[2] > entry, 2, axis)
        entry = np.maximum(entry, entries[2])
        met = (entry > 0.0) & (entry < np.minimum(np.minimum(exits[0], exits[1]), exits[2]))
        return np.where(met, entry, np.inf), axis

    def meet(self, origin: Floats, direction: Floats, t: Floats) -> tuple[Floats, Floats]:  # noqa: ARG002
        """Distance and cosine of incidence, for rays from outside."""
        distance, axis = self.enter(origin, direction)
        return distance, _component(direction, axis)


def _component(direction: Floats, axis: NDArray[np.intp]) -> Floats:
    """Size of one component of each direction (3, ...)."""
    size: Floats = np.abs(np.take_along_axis(direction, axis[None], axis=0)[0])
    return size


@dataclass(frozen=True)
class Building(Box):
    """A box whose walls along the street have recessed windows, some of them open.

    Cells of ``pitch`` by ``storey`` metres hold one window each, ``recess`` deep. Through every
    ``open_every``-th a ray is lost inside.
    """

    kind: Kind = Kind.FACADE
    pitch: float = 3.0
    storey: float = 3.2
    window: tuple[float, float] = (1.3, 1.6)
    sill: float = 0.9
    recess: float = 0.2
    open_every: int = 4

    def meet(self, origin: Floats, direction: Floats, t: Floats) -> tuple[Floats, Floats]:  # noqa: ARG002
        """Distance and cosine of incidence: on the wall, a window's reveal or its pane."""
        distance, axis = self.enter(origin, direction)
        cosine = _component(direction, axis)
        wall = np.isfinite(distance) & (axis == 1)
        rays = direction[:, wall]
        deeper, lean = self._window(origin[:, wall] + distance[wall] * rays, rays)
        distance[wall] += deeper
        cosine[wall] = np.where(deeper > 0.0, lean, cosine[wall])
        return distance, cosine

    def _window(self, wall: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """How much farther rays go that met the wall at ``wall`` (3, M), and the cosine there."""
        u, v = wall[0] - self.low[0], wall[2] - self.low[2]
        column, row = np.floor(u / self.pitch), np.floor(v / self.storey)
        u = u - (column + 0.5) * self.pitch
        v = v - row * self.storey - self.sill - self.window[1] / 2.0
        across, up = self.window[0] / 2.0, self.window[1] / 2.0
        hole = (np.abs(u) < across) & (np.abs(v) < up)
        steps = np.maximum(np.abs(direction), TINY)
        sideways = (across - np.sign(direction[0]) * u) / steps[0]
        upwards = (up - np.sign(direction[2]) * v) / steps[2]
        deeper = np.stack([sideways, self.recess / steps[1], upwards])
        first = deeper.argmin(axis=0)
        cosine = _component(steps, first)
        lost = (first == 1) & ((column + 2.0 * row) % self.open_every == 0.0)
        reached = np.where(lost, np.inf, deeper.min(axis=0))
        return np.where(hole, reached, 0.0), cosine


def _meet_tube(
    base: Floats, direction: Floats, axis: Floats, radius: float, length: float
) -> tuple[Floats, Floats]:
    """Meet the outside of a tube: ``base`` is origin minus the tube's foot, ``axis`` (3, ...)."""
    along, lean = (base * axis).sum(axis=0), (direction * axis).sum(axis=0)
    out, turn = base - along * axis, direction - lean * axis
    a = np.maximum((turn * turn).sum(axis=0), TINY)
    b = (out * turn).sum(axis=0)
    disc = b * b - a * ((out * out).sum(axis=0) - radius * radius)
    distance = (-b - np.sqrt(np.maximum(disc, 0.0))) / a
    place = along + distance * lean
    met = (disc > 0.0) & (distance > 0.0) & (place >= 0.0) & (place <= length)
    cosine = np.sqrt(np.maximum(disc, 0.0)) / radius
    return np.where(met, distance, np.inf), cosine


@dataclass(frozen=True)
class Pole:
    """An upright tube on (x, y)."""

    x: float
    y: float
    radius: float = 0.08
    tall: float = 6.0
    kind: Kind = Kind.POLE
    reflectance: float = 0.5
    cause: Cause = Cause.GOOD

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Ball around the tube."""
        return np.array([self.x, self.y, self.tall / 2.0]), self.tall / 2.0 + self.radius

    def meet(self, origin: Floats, direction: Floats, t: Floats) -> tuple[Floats, Floats]:  # noqa: ARG002
        """Distance and cosine of incidence."""
        shape = (3,) + (1,) * (direction.ndim - 1)
        foot, up = np.reshape([self.x, self.y, 0.0], shape), np.reshape([0.0, 0.0, 1.0], shape)
        return _meet_tube(origin - foot, direction, up, self.radius, self.tall)


@dataclass(frozen=True)
class BarrierArm:
    """A tube that swings about a pivot beside the road, in the plane x = const., towards -y.

    It is raised by ``angle`` (rad) at ``t = 0`` and by ``rate`` (rad/s) more as time goes on.
    """

    pivot: tuple[float, float, float]
    length: float
    angle: float
    rate: float
    radius: float = 0.05
    kind: Kind = Kind.ARM
    reflectance: float = 0.6
    cause: Cause = Cause.BARRIER

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Ball that the arm never leaves."""
        return np.array(self.pivot), self.length + self.radius

    def meet(self, origin: Floats, direction: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Distance and cosine of incidence, where the arm is at the time of each ray."""
        shape = (3,) + (1,) * (direction.ndim - 1)
        raised = np.clip(self.angle + self.rate * t, 0.0, np.pi / 2.0)
        axis = np.stack([np.zeros_like(raised), -np.cos(raised), np.sin(raised)])
        return _meet_tube(
            origin - np.reshape(self.pivot, shape), direction, axis, self.radius, self.length
        )


@dataclass(frozen=True)
class Puff:
    """A normally distributed cloud of droplets: ``size`` its three standard deviations, metres.

    ``density`` is the chance per metre, at its centre, that a ray is sent back.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    density: float

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Ball outside which nothing is left of it."""
        return np.array(self.centre), 4.0 * max(self.size)

    def meet(self, origin: Floats, direction: Floats, reach: Floats, dice: Floats) -> Floats:
        """Distance at which rays (3, M) are sent back before ``reach`` (M,); inf: they pass.

        ``dice`` (M,), uniform in 0 to 1, decides; the law is that of Beer and Lambert.
        """
        size = np.reshape(self.size, (3, 1))
        start, step = (origin - np.reshape(self.centre, (3, 1))) / size, direction / size
        pace = np.sqrt((step * step).sum(axis=0))
        middle = -(start * step).sum(axis=0) / pace**2
        aside = (start * start).sum(axis=0) - (middle * pace) ** 2
        whole = self.density * np.exp(-aside / 2.0) * np.sqrt(2.0 * np.pi) / pace
        before = ndtr(-middle * pace)
        depth = whole * (ndtr((reach - middle) * pace) - before)
        sent_back = dice < -np.expm1(-depth)
        wanted = before - np.log1p(-np.where(sent_back, dice, 0.0)) / np.maximum(whole, TINY)
        place = middle + ndtri(np.clip(wanted, 0.0, 1.0)) / pace
        return np.where(sent_back, place, np.inf)


@dataclass(frozen=True)
class Hits:
    """What N bundles of K rays met.

    Attributes
    ----------
    distance : (N, K) float64
        Metres; inf where nothing was met.
    cosine : (N, K) float64
        Of the angle of incidence.
    surface : (N, K) int64
        Index into the scene's surfaces; -1 where nothing was met.

    """

    distance: Floats
    cosine: Floats
    surface: NDArray[np.int64]


@dataclass(frozen=True)
class Scene:
    """Surfaces and puffs."""

    surfaces: tuple[Surface, ...]
    puffs: tuple[Puff, ...] = field(default=())

    def cast(self, rays: Rays) -> Hits:
        """Find the nearest surface on every ray."""
        shape = rays.direction.shape[1:]
        distance, cosine = np.full(shape, np.inf), np.ones(shape)
        surface = np.full(shape, -1, np.int64)
        t = np.broadcast_to(rays.t[:, None], shape)
        for index, thing in enumerate(self.surfaces):
            near = towards(rays, thing.sphere)
            if not len(near):
                continue
            some = rays.take(near)
            far, lean = thing.meet(some.origin, some.direction, t[near])
            closer = far < distance[near]
            distance[near] = np.where(closer, far, distance[near])
            cosine[near] = np.where(closer, lean, cosine[near])
            surface[near] = np.where(closer, index, surface[near])
        return Hits(distance, cosine, surface)


def towards(rays: Rays, sphere: tuple[Floats, float] | None) -> NDArray[np.intp]:
    """Index the bundles that may meet something inside the ball; None: all of them."""
    if sphere is None:
        return np.arange(rays.direction.shape[1])
    centre, radius = sphere
    gap = centre[:, None] - rays.origin[:, :, 0]
    along = (gap * rays.direction[:, :, 0]).sum(axis=0)
    aside = (gap * gap).sum(axis=0) - along * along
    return np.flatnonzero((aside < (radius + BUNDLE_REACH) ** 2) & (along > -radius))
