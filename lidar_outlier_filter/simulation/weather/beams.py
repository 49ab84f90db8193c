# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The beams of a spinning sensor's cloud: those that came back, and those that did not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

TURN = 2.0 * np.pi
FEWEST = 16  # returns of a ring that show its angles
LAG = 8  # returns, to measure how fast the head turns
GAP = 1.5  # steps between two returns from which on a beam is missing between them


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
        result: Floats = self.aperture + self.divergence * distance
        return result

    def overlap(self, distance: Floats) -> Floats:
        """Share of the beam that the receiver sees at a range."""
        result: Floats = -np.expm1(-((distance / self.blind) ** 2))
        return result


@dataclass(frozen=True)
class Beams:
    """N beams, those without a return too.

    Attributes
    ----------
    direction : (N, 3) float64
        Of length one, in the sensor's frame.
    range : (N,) float64
        Metres; inf where nothing came back.
    reflectance : (N,) float64
        Of the surface, cosine of incidence included.
    ring, t : (N,) int64
        Line, and time in nanoseconds.
    source : (N,) int64
        Row of the point in the cloud it is from; -1 where nothing came back.

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


def find_beams(
    xyz: Floats, t: Ints, ring: Ints, reflectance: Floats, valid: NDArray[np.bool_]
) -> Beams:
    """Take the beams of a cloud, and add those that are missing in its pattern.

    A ring's returns follow each other at one angular step. Where the step between two is a
    multiple, beams are put between them; and at the ring's ends, as far as other rings reach.

    Raises
    ------
    FilterError
        If there are too few valid points to find the pattern.

    """
    index = np.flatnonzero(valid)
    index = index[np.lexsort((t[index], ring[index]))]
    if len(index) < FEWEST:
        raise FilterError('the valid points of a cloud', f'at least {FEWEST}', len(index))
    points = xyz[index]
    distance = np.sqrt((points * points).sum(axis=1))
    if (distance == 0).any():
        raise FilterError('a valid point', 'away from the sensor', '0, 0, 0')
    direction = points / distance[:, None]
    source = Beams(direction, distance, reflectance[index], ring[index], t[index], index)
    missing = _missing(source)
    return source if missing is None else _join(source, missing)


def _missing(some: Beams) -> Beams | None:
    """Find the beams without a return."""
    azimuth = np.arctan2(some.direction[:, 1], some.direction[:, 0])
    first = np.flatnonzero(np.diff(some.ring, prepend=some.ring[0] - 1))
    parts = [slice(a, b) for a, b in zip(first, [*first[1:], len(some)], strict=True)]
    rate = _rate(azimuth, some.t, parts)
    phases = [_unwrap(azimuth[part], some.t[part], rate) for part in parts]
    pairs = [(s, p) for s, p in zip(parts, phases, strict=True) if len(p) >= FEWEST]
    if not pairs or rate == 0.0:
        return None
    parts, phases = [s for s, _ in pairs], [p for _, p in pairs]
    begin, end = int(some.t.min()), int(some.t.max())
    found = []
    for part, phase in zip(parts, phases, strict=True):
        if (np.diff(phase) > 0).any():
            found.append(_of_ring(some, part, phase, rate, (begin, end)))
    return _stack(found) if found else None


def _of_ring(some: Beams, part: slice, phase: Floats, rate: float, ends: tuple[int, int]) -> Beams:
    """Find those of one ring; ``phase`` grows along it."""
    gaps = np.diff(phase)
    step = float(np.median(gaps[gaps > 0]))
    t = some.t[part].astype(np.float64)
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
    azimuth = np.sign(rate) * (phase[which] + share * gap[which])
    up = float(np.median(some.direction[part, 2]))
    level = np.sqrt(1.0 - up * up)
    direction = np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), np.full(len(which), up)], axis=1
    )
    time = np.rint(t[which] + share * (t[which + 1] - t[which])).astype(np.int64)
    count = len(which)
    ring = np.full(count, some.ring[part.start])
    nothing = np.full(count, np.inf)
    return Beams(direction, nothing, np.zeros(count), ring, time, np.full(count, -1))


def _rate(azimuth: Floats, t: Ints, parts: list[slice]) -> float:
    """Return how fast the head turns, rad/ns: the median over returns ``LAG`` places apart."""
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
    total: Floats = mine[0] + np.concatenate([[0.0], np.cumsum(step)])
    return total


def _wrap(angle: Floats) -> Floats:
    wrapped: Floats = angle - TURN * np.rint(angle / TURN)
    return wrapped


def _stack(parts: list[Beams]) -> Beams:
    columns = {
        name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])
    }
    return Beams(**columns)


def _join(first: Beams, second: Beams) -> Beams:
    """Join both, sorted by ring and time."""
    joined = _stack([first, second])
    order = np.lexsort((joined.t, joined.ring))
    return Beams(**{name: values[order] for name, values in vars(joined).items()})
