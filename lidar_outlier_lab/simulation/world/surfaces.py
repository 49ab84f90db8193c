# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The surfaces that scenes are built of, as rows of numbers for the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.truth import Cause, Kind
from lidar_outlier_lab.simulation.world import caster

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.core.annotations import Floats, Triple

    Point = Triple | Floats

STILL = (0.0, 0.0, 0.0)


def _row(
    shape: int,
    rest: Sequence[float],
    low: Point,
    high: Point,
    velocity: Triple = STILL,
) -> Floats:
    """Lay out a row; ``low`` and ``high`` are corners of a box around the surface at t = 0."""
    row = np.zeros(caster.WIDTH)
    row[0] = shape
    row[caster.LOW : caster.HIGH] = low
    row[caster.HIGH : caster.VELOCITY] = high
    row[caster.VELOCITY : caster.REST] = velocity
    row[caster.REST : caster.REST + len(rest)] = rest
    return row


def _around(centre: Triple, half: Triple | float) -> tuple[Floats, Floats]:
    """Low and high corner of a box around a centre."""
    middle, away = np.array(centre), np.array(half)
    return middle - away, middle + away


@dataclass(frozen=True)
class _Plain:
    """What all surfaces are unless they say otherwise."""

    @property
    def pane(self) -> Kind:
        """Nothing here has windows, but buildings."""
        return Kind.AIR


@dataclass(frozen=True)
class Ground(_Plain):
    """A road along x, highest in its middle: z = height + crown (1 - ((y - side) / half_width)²).

    It is met from above only.
    """

    start: float
    end: float
    half_width: float
    crown: float = 0.0
    side: float = 0.0
    height: float = 0.0
    kind: Kind = Kind.ROAD
    reflectance: float = 0.2
    cause: Cause = Cause.GOOD

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        rest = (self.start, self.end, self.half_width, self.crown, self.side, self.height)
        low, high = self.side - self.half_width, self.side + self.half_width
        top = self.height + max(self.crown, 0.0)
        bottom = self.height + min(self.crown, 0.0)
        return _row(caster.GROUND, rest, (self.start, low, bottom), (self.end, high, top))


@dataclass(frozen=True)
class Box(_Plain):
    """A box with its edges along the axes, from ``low`` to ``high``; it may move."""

    low: Triple
    high: Triple
    kind: Kind
    reflectance: float = 0.4
    cause: Cause = Cause.GOOD
    velocity: Triple = STILL

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        return _row(caster.BOX, (*self.low, *self.high), self.low, self.high, self.velocity)


@dataclass(frozen=True)
class Building:
    """A box whose walls along the street have recessed windows, some of them open.

    Cells of ``pitch`` by ``storey`` metres hold one window each, ``recess`` deep. Through every
    ``open_every``-th a ray is lost inside; 0: all are closed. With ``all_around`` the walls across
    the street have windows too.
    """

    low: Triple
    high: Triple
    kind: Kind = Kind.FACADE
    pane: Kind = Kind.FACADE
    reflectance: float = 0.4
    cause: Cause = Cause.GOOD
    pitch: float = 3.0
    storey: float = 3.2
    window: tuple[float, float] = (1.3, 1.6)
    sill: float = 0.9
    recess: float = 0.2
    open_every: int = 4
    all_around: bool = False

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        cell = (self.pitch, self.storey, *self.window, self.sill, self.recess)
        rest = (*self.low, *self.high, *cell, self.open_every, float(self.all_around))
        return _row(caster.BUILDING, rest, self.low, self.high)


@dataclass(frozen=True)
class Tube(_Plain):
    """The outside of a tube between the middles of its ends: a trunk, a railing, a wire."""

    foot: Triple
    top: Triple
    radius: float
    kind: Kind
    reflectance: float = 0.4
    cause: Cause = Cause.GOOD

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        foot, top = np.array(self.foot), np.array(self.top)
        length = float(np.linalg.norm(top - foot))
        if not length > 0.0:
            raise FilterError('the ends of a tube', 'apart', f'{self.foot} twice')
        rest = (*foot, *(top - foot) / length, self.radius, length)
        low, high = np.minimum(foot, top) - self.radius, np.maximum(foot, top) + self.radius
        return _row(caster.TUBE, rest, low, high)


@dataclass(frozen=True)
class Pole(_Plain):
    """An upright tube on (x, y)."""

    x: float
    y: float
    radius: float = 0.08
    tall: float = 6.0
    kind: Kind = Kind.POLE
    reflectance: float = 0.5
    cause: Cause = Cause.GOOD

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        foot, top = (self.x, self.y, 0.0), (self.x, self.y, self.tall)
        return Tube(foot, top, self.radius, self.kind).row


@dataclass(frozen=True)
class BarrierArm(_Plain):
    """A tube that swings about a pivot beside the road, in the plane x = const., towards -y.

    It is raised by ``angle`` (rad) at ``t = 0`` and by ``rate`` (rad/s) more as time goes on.
    """

    pivot: Triple
    length: float
    angle: float
    rate: float
    radius: float = 0.05
    kind: Kind = Kind.ARM
    reflectance: float = 0.6
    cause: Cause = Cause.BARRIER

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        rest = (*self.pivot, self.length, self.radius, self.angle, self.rate)
        return _row(caster.ARM, rest, *_around(self.pivot, self.length + self.radius))


@dataclass(frozen=True)
class Ball(_Plain):
    """A ball that may move: a bird, to a scanner."""

    centre: Triple
    radius: float
    velocity: Triple = STILL
    kind: Kind = Kind.AIR
    reflectance: float = 0.3
    cause: Cause = Cause.BIRD

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        rest = (*self.centre, self.radius)
        return _row(caster.BALL, rest, *_around(self.centre, self.radius), self.velocity)


@dataclass(frozen=True)
class Lid(_Plain):
    """The lid of a manhole: a disc at a height, with ribs and grooves in squares."""

    centre: Triple
    radius: float = 0.35
    relief: float = 0.006  # metres from the ribs down to the grooves
    spacing: float = 0.08  # metres from rib to rib
    kind: Kind = Kind.MANHOLE
    reflectance: float = 0.45
    cause: Cause = Cause.GOOD

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        rest = (*self.centre, self.radius, self.relief, self.spacing)
        return _row(caster.LID, rest, *_around(self.centre, self.radius + self.relief))


@dataclass(frozen=True)
class Crown(_Plain):
    """The leaves of a tree or a hedge: discs of ``leaf`` metres radius in an ellipsoid.

    One in each of a ``share`` of the cubes of ``cell`` metres that it is cut into; where, and how
    it leans, is drawn from ``seed``, so that every ray finds the same leaf. A ray goes about
    ``2 cell³ / (π leaf² share)`` metres deep.
    """

    centre: Triple
    half: Triple
    seed: int = 0
    cell: float = 0.15
    leaf: float = 0.07
    share: float = 0.3
    kind: Kind = Kind.FOLIAGE
    reflectance: float = 0.4
    cause: Cause = Cause.GOOD

    @property
    def row(self) -> Floats:
        """Numbers for the kernel."""
        rest = (*self.centre, *self.half, self.cell, self.leaf, self.share, self.seed)
        return _row(caster.CROWN, rest, *_around(self.centre, self.half))
