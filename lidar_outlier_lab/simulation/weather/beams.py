# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The beams of a spinning sensor's cloud: those that came back, and those that did not."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.simulation.world.prisms import FreeScanner

TURN = 2.0 * np.pi
MIN_RING_POINTS = 16  # returns of a ring that show its angles
LAG = 8  # returns, to measure how fast the head turns
GAP = 1.5  # steps between two returns from which on a beam is missing between them
STEADY = 0.9  # share of the returns that follow the pattern: with less there is no pattern
LEVEL = 0.05  # rad, at most, between a return and the elevation of its ring


@dataclass(frozen=True)
class Optics:
    """What a sensor's beams are like; the defaults suit most spinning sensors.

    Attributes
    ----------
    divergence : full angle of the cone, rad
    aperture : diameter of the beam at the sensor, metres
    nearest, farthest : metres; at the farthest, a surface of reflectance 0.9 gives the least echo
    blind : metres over which the receiver comes to see the beam
    pulse : half the length of a pulse, metres

    """

    divergence: float = 0.003
    aperture: float = 0.008
    nearest: float = 0.8
    farthest: float = 120.0
    blind: float = 2.0
    pulse: float = 1.0

    @property
    def floor(self) -> float:
        """The least power that is detected, as reflectance ÷ m² (Kilic et al. 2021, eq. 9)."""
        return 0.9 / self.farthest**2

    def diameter(self, distance: Floats) -> Floats:
        """Diameter of the beam at a range, metres."""
        return self.aperture + self.divergence * distance

    def overlap(self, distance: Floats) -> Floats:
        """Share of the beam that the receiver sees at a range."""
        return -np.expm1(-((distance / self.blind) ** 2))


@dataclass(frozen=True)
class Beams:
    """N beams, those without a return too.

    Attributes
    ----------
    direction : (N, 3) of length one, in the sensor's frame
    range : (N,) metres; inf where nothing came back
    reflectance : (N,) of the surface, cosine of incidence included
    ring, t : (N,) int64, line, and time in nanoseconds
    source : (N,) int64, row in the cloud it is from; -1 where the cloud has none, and nothing came
        back

    """

    direction: Floats
    range: Floats
    reflectance: Floats
    ring: Ints
    t: Ints
    source: Ints

    def __len__(self) -> int:
        """Count the beams."""
        return len(self.t)

    def through(self, centre: Floats, radius: float) -> tuple[Floats, Floats]:
        """Return how far (N,) along each beam the middle of a ball is, and its half way squared.

        In metres, and m²; no beam meets the ball where the second is not above 0.
        """
        # Not by `@`: BLAS adds in another order on another processor.
        along: Floats = np.einsum('ij,j->i', self.direction, centre)
        return along, radius**2 - (np.sum(centre**2) - along**2)


def find_beams(  # noqa: PLR0913  the columns of a cloud
    xyz: Floats,
    t: Ints,
    ring: Ints,
    reflectance: Floats,
    valid: Bools,
    empty: Bools | None = None,
    *,
    adds: bool = True,
) -> Beams:
    """Take the beams of a cloud, and add those that are missing in its pattern.

    A ring's returns follow each other at one angular step. Where the step between two is a
    multiple, beams are put between them; and at the ring's ends, as far as other rings reach.

    Parameters
    ----------
    xyz, t, ring, reflectance : (N, ...) as in :class:`Beams`
    valid : (N,) bool, of the points that came back
    empty : (N,) bool, of rows without a return whose ring and time are known
    adds : False: only the cloud's own rows

    Raises
    ------
    FilterError
        If there are too few valid points to find the pattern, or if they have none.

    """
    index = np.flatnonzero(valid)
    index = index[np.lexsort((t[index], ring[index]))]
    if len(index) < MIN_RING_POINTS:
        raise FilterError('the valid points of a cloud', f'at least {MIN_RING_POINTS}', len(index))
    points = xyz[index]
    distance = np.sqrt((points * points).sum(axis=1))
    if (distance == 0).any():
        raise FilterError('a valid point', 'away from the sensor', '0, 0, 0')
    direction = points / distance[:, None]
    some = Beams(direction, distance, reflectance[index], ring[index], t[index], index)
    rings, rate = _rings(some)
    if empty is not None and empty.any():
        found = [_of_rows(one, ring, t, empty, rate) for one in rings]
        some = _join([some, *found])
        rings = [_merge(one, new, rate) for one, new in zip(rings, found, strict=True)]
    if not adds:
        return some
    ends = int(some.t.min()), int(some.t.max())
    return _join([some, *(_between(one, rate, ends) for one in rings if one.turns)])


def beams_of(scanner: FreeScanner, points: Points, reflectance: Floats) -> Beams:
    """Take all beams of a scanner's first cloud, those without a return too.

    Times of the points count from its first shot; reflectances (N,) are theirs.
    """
    shot = np.arange(scanner.shots_per_line)
    taken = points.t // scanner.interval
    distance, bright = np.full(len(shot), np.inf), np.zeros(len(shot))
    source = np.full(len(shot), -1)
    distance[taken], bright[taken] = points.range, reflectance
    source[taken] = np.arange(len(points))
    counted = scanner.before + shot
    t, ring = shot * scanner.interval, counted % scanner.rings
    direction = np.ascontiguousarray(scanner.directions(counted).T)
    every = Beams(direction, distance, bright, ring, t, source)
    return _take(every, np.lexsort((t, ring)))


class _Ring(NamedTuple):
    """The beams of one ring in the order of time; ``phase`` (M,) grows along them, rad.

    ``step`` is the angle between two shots, ``up`` the sine of the elevation.
    """

    beams: Beams
    phase: Floats
    step: float
    up: float

    @property
    def turns(self) -> bool:
        """Whether its beams show how it turns."""
        return len(self.phase) >= MIN_RING_POINTS and self.step > 0.0


def _rings(some: Beams) -> tuple[list[_Ring], float]:
    """Cut beams into rings; return how fast the head turns too, rad/ns.

    Raises
    ------
    FilterError
        If no head turns about the z axis.

    """
    azimuth = np.arctan2(some.direction[:, 1], some.direction[:, 0])
    first = np.flatnonzero(np.diff(some.ring, prepend=some.ring[0] - 1))
    parts = [slice(a, b) for a, b in zip(first, [*first[1:], len(some)], strict=True)]
    rate = _rate(azimuth, some.t, parts)
    rings, steady, level = [], 0, 0
    for part in parts:
        phase = _unwrap(azimuth[part], some.t[part], rate)
        gaps = np.diff(phase)
        forward = gaps[gaps > 0]
        step = float(np.median(forward)) if len(forward) else 0.0
        elevation = np.arcsin(np.clip(some.direction[part, 2], -1.0, 1.0))
        middle = float(np.median(elevation))
        steady += 1 + int((gaps > -step).sum())
        level += int((np.abs(elevation - middle) < LEVEL).sum())
        rings.append(_Ring(_take(some, part), phase, step, np.sin(middle)))
    share = min(steady, level) / len(some)
    if rate == 0.0 or share < STEADY:
        must_be = 'rings of a sensor that spins, in its own frame'
        raise FilterError('the lines of a cloud', must_be, 'others')
    return rings, rate


def _of_rows(ring: _Ring, line: Ints, time: Ints, empty: Bools, rate: float) -> Beams:
    """Give directions to rows without a return: they lie evenly between those with one."""
    row = np.flatnonzero(empty & (line == ring.beams.ring[0]))
    t = time[row]
    if not ring.turns or not len(t):
        return _take(ring.beams, slice(0, 0))
    every_t, every_row = np.append(ring.beams.t, t), np.append(ring.beams.source, row)
    order = np.lexsort((every_row, every_t))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    known, requested = rank[: len(ring.phase)], rank[len(ring.phase) :]
    phase = np.interp(requested, known, ring.phase)
    phase += ring.step * (
        np.minimum(requested - known[0], 0) + np.maximum(requested - known[-1], 0)
    )
    # So many between two returns there can only be if the angle between these is as large.
    after = np.searchsorted(known, requested)
    inside = (after > 0) & (after < len(known))
    after = np.clip(after, 1, len(known) - 1)
    steps = (ring.phase[after] - ring.phase[after - 1]) / ring.step
    count = known[after] - known[after - 1]
    fits = ~inside | ((steps > count / GAP) & (steps < count * GAP))
    return _nothing(ring, phase[fits], t[fits], rate, row[fits])


def _merge(ring: _Ring, found: Beams, rate: float) -> _Ring:
    """Put beams without a return into their ring."""
    if not len(found):
        return ring
    beams = _join([ring.beams, found])
    azimuth = np.arctan2(beams.direction[:, 1], beams.direction[:, 0])
    return ring._replace(beams=beams, phase=_unwrap(azimuth, beams.t, rate))


def _between(ring: _Ring, rate: float, ends: tuple[int, int]) -> Beams:
    """Find the beams that a ring lacks: where the step is a multiple, and before its ends."""
    phase, step = ring.phase, ring.step
    t = ring.beams.t.astype(np.float64)
    # One more at either end, where the ring's sweep begins and ends.
    before = phase[0] - abs(rate) * (t[0] - ends[0]) - step
    after = phase[-1] + abs(rate) * (ends[1] - t[-1]) + step
    phase = np.concatenate([[before], phase, [after]])
    t = np.concatenate([[ends[0]], t, [ends[1]]])
    gap = np.diff(phase)
    many = np.where(gap > GAP * step, np.rint(gap / step) - 1, 0).astype(np.int64).clip(0)
    which = np.repeat(np.arange(len(many)), many)
    number = np.arange(len(which)) - np.repeat(np.cumsum(many) - many, many) + 1
    share = number / (many[which] + 1)
    time = np.rint(t[which] + share * (t[which + 1] - t[which])).astype(np.int64)
    row = np.full(len(which), -1)
    return _nothing(ring, phase[which] + share * gap[which], time, rate, row)


def _nothing(ring: _Ring, phase: Floats, t: Ints, rate: float, source: Ints) -> Beams:
    """Make beams of a ring from which nothing came back."""
    azimuth = np.sign(rate) * phase
    level, count = np.sqrt(1.0 - ring.up**2), len(phase)
    direction = np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), np.full(count, ring.up)], axis=1
    )
    number = np.full(count, ring.beams.ring[0])
    return Beams(direction, np.full(count, np.inf), np.zeros(count), number, t, source)


def _rate(azimuth: Floats, t: Ints, parts: list[slice]) -> float:
    """Return how fast the head turns, rad/ns: the median over returns ``LAG`` apart."""
    rates = []
    for part in parts:
        if part.stop - part.start <= LAG:
            continue
        turned = _wrap(np.diff(azimuth[part]))
        total = np.cumsum(np.concatenate([[0.0], turned]))
        span = (t[part][LAG:] - t[part][:-LAG]).astype(np.float64)
        moved = total[LAG:] - total[:-LAG]
        rates.append(moved[span > 0] / span[span > 0])
    every = np.concatenate(rates) if rates else np.zeros(0)
    return float(np.median(every)) if len(every) else 0.0


def _unwrap(azimuth: Floats, t: Ints, rate: float) -> Floats:
    """Return the angle turned (N,), growing with time whichever way the head turns, rad."""
    sign = 1.0 if rate >= 0 else -1.0
    mine = sign * azimuth
    expected = abs(rate) * np.diff(t).astype(np.float64)
    step = expected + _wrap(np.diff(mine) - expected)
    return mine[0] + np.concatenate([[0.0], np.cumsum(step)])


def _wrap(angle: Floats) -> Floats:
    return angle - TURN * np.rint(angle / TURN)


def _take(beams: Beams, part: slice | NDArray[np.intp]) -> Beams:
    return Beams(**{name: values[part] for name, values in vars(beams).items()})


def _join(parts: list[Beams]) -> Beams:
    """Join all, sorted by ring and time."""
    every = Beams(
        **{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])}
    )
    return _take(every, np.lexsort((every.t, every.ring)))
