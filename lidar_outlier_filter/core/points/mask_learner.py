# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Learns where a sensor sees its own vehicle: what stays where it is while the vehicle moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.points.mask import COLUMNS, MOST_RINGS, Mask, look
from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.points.points import Points

BIN = 0.05  # metres, of ranges
STAYS = 0.5  # of the looks with a return in a cell, in which it is there
LEAST = 0.25  # of all looks
# Metres between two looks that count, where it is known where the sensor was.
STEP = 1.0
# Elsewhere: the share of the far cells whose range has changed, by so many metres, and by so much;
# these cells are so many columns wide.
CHANGED, BY_METRES, BY_SHARE = 0.2, 0.2, 0.05
WIDE = 4
SAMPLE = 500  # points of a look that show where the ground is
MOST_SAMPLES = 200  # looks
FLAT = 0.15  # metres from the plane of the ground
CLEAR = 0.25  # metres above it, where the vehicle begins
GROUND = 0.1  # of the points, at least, are on the plane
BELOW = 0.05  # of the points, at most, are below it
UPRIGHT = np.cos(np.pi / 4)  # of the tilt of the sensor against the ground
TRIALS = 300


class MaskLearner:
    """Looks of a sensor in, one after the other; a mask out.

    A look is about a turn. Only those count that show the scene from elsewhere than the last one
    that counted.

    Attributes
    ----------
    looks, taken : how many there were, and how many of them count

    """

    def __init__(self, reach: float) -> None:
        """Look for the vehicle up to ``reach`` metres from the sensor."""
        self.looks = self.taken = 0
        self._bins = int(np.ceil(reach / BIN))
        self._hits = np.zeros((0, COLUMNS, self._bins), np.uint16)
        self._returns = np.zeros((0, COLUMNS), np.int64)
        self._last: Floats = np.zeros((0, COLUMNS // WIDE))  # ranges of the last look that counted
        self._place: Floats | None = None
        self._sines = np.zeros(0)  # of elevations, added up by ring
        self._points = np.zeros(0, np.int64)
        self._samples: list[Floats] = []

    def add(self, points: Points, place: Floats | None = None) -> bool:
        """Take a look; return whether it counts.

        Parameters
        ----------
        points : valid ones, in the sensor's own frame, whose lines are its rings
        place : (3,) where the sensor was, metres; None: not known

        Raises
        ------
        CloudError
            If a line cannot be a ring.

        """
        self.looks += 1
        ring = points.line
        low, high = int(ring.min(initial=0)), int(ring.max(initial=-1))
        if low < 0 or high >= MOST_RINGS:
            raise CloudError('the ring of a point', f'from 0 to {MOST_RINGS - 1}', max(high, -low))
        self._grow(high + 1)
        column, distance = look(points.xyz)
        ranges = np.full(self._last.shape, np.inf)
        np.minimum.at(ranges, (ring, column // WIDE), distance)
        if not self._has_moved(ranges, place):
            return False
        self.taken += 1
        self._last, self._place = ranges, place
        self._count(ring, column, distance)
        sines = points.xyz[:, 2] / np.maximum(distance, BIN)
        self._sines += np.bincount(ring, sines, len(self._sines))
        self._points += np.bincount(ring, minlength=len(self._points))
        if len(self._samples) < MOST_SAMPLES and len(points):
            self._samples.append(points.xyz[:: -(-len(points) // SAMPLE)])
        return True

    def _grow(self, rings: int) -> None:
        """Make space for more rings."""
        more = rings - len(self._returns)
        if more > 0:
            wider = ((0, more), (0, 0))
            self._returns = np.pad(self._returns, wider)
            self._hits = np.pad(self._hits, (*wider, (0, 0)))
            self._last = np.pad(self._last, wider, constant_values=np.inf)
            self._sines = np.pad(self._sines, (0, more))
            self._points = np.pad(self._points, (0, more))

    def _has_moved(self, ranges: Floats, place: Floats | None) -> bool:
        """Return whether a look shows the scene from elsewhere than the last one that counted."""
        if self.taken == 0:
            return bool(np.isfinite(ranges).any())
        if place is not None and self._place is not None:
            return bool(np.linalg.norm(place - self._place) >= STEP)
        reach = self._bins * BIN
        both = np.isfinite(ranges) & np.isfinite(self._last)
        both &= np.maximum(ranges, self._last, where=both, out=np.zeros(both.shape)) > reach
        if not both.any():
            return False
        now, before = ranges[both], self._last[both]
        other = np.abs(now - before) > BY_METRES + BY_SHARE * np.minimum(now, before)
        return bool(other.mean() > CHANGED)

    def _count(self, ring: Ints, column: Ints, distance: Floats) -> None:
        """Count where there were returns, and at which ranges: each cell and bin once."""
        cell = ring * COLUMNS + column
        self._returns.reshape(-1)[np.unique(cell)] += 1
        number = (distance / BIN).astype(np.int64)
        # Noise may put a range into either of two bins: the neighbours count, too.
        around = number[:, np.newaxis] + np.array([-1, 0, 1])
        inside = (around >= 0) & (around < self._bins)
        every = (cell[:, np.newaxis] * self._bins + around)[inside]
        self._hits.reshape(-1)[np.unique(every)] += 1

    def learn(self) -> Mask:
        """Return what stayed where it is, but for the ground; a column more on either side."""
        mask = Mask.nothing(len(self._returns))
        least = np.maximum(STAYS * self._returns, LEAST * self.taken)
        where = np.argwhere(self._hits >= np.maximum(least, 1)[:, :, np.newaxis])
        ring, column, number = where[self._is_clear(*where.T)].T
        np.minimum.at(mask.near, (ring, column), number * BIN)
        np.maximum.at(mask.far, (ring, column), (number + 1) * BIN)
        return _wider(mask)

    def _is_clear(self, ring: Ints, column: Ints, number: Ints) -> Bools:
        """Return which places, by their cells and bins, are clear of the ground."""
        ground = _ground(np.concatenate([np.empty((0, 3)), *self._samples]))
        if ground is None:
            return np.ones(len(ring), np.bool_)
        up, height = ground
        sine = (self._sines / np.maximum(self._points, 1))[ring]
        level, azimuth = np.sqrt(1 - sine * sine), (column + 0.5) * (2 * np.pi / COLUMNS)
        towards = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), sine])
        above: Floats = (number + 0.5) * BIN * (up @ towards) + height
        return above > CLEAR


def _ground(xyz: Floats) -> tuple[Floats, float] | None:
    """Find the plane with most points on it, and nearly none below.

    Returns the direction that is up, and how high the sensor is above, metres; None: there is none.
    """
    rng = np.random.default_rng(0)
    best, found = GROUND * len(xyz), None
    for _ in range(TRIALS * (len(xyz) > 0)):
        corner, *sides = xyz[rng.integers(0, len(xyz), 3)]
        up = np.cross(sides[0] - corner, sides[1] - corner)
        if up[2] < 0:
            up = -up
        if not up[2] > UPRIGHT * np.linalg.norm(up):
            continue
        up /= np.linalg.norm(up)
        height = -float(up @ corner)
        above = xyz @ up + height
        on = float(np.count_nonzero(np.abs(above) < FLAT))
        if on > best and height > 0 and (above < -FLAT).mean() < BELOW:
            best, found = on, (up, height)
    return found


def _wider(mask: Mask) -> Mask:
    """Add to each row the cells beside those where the vehicle is: its edge is between them."""
    near, far = mask.near.copy(), mask.far.copy()
    for step in (-1, 1):
        beside = np.roll(mask.near, step, axis=1), np.roll(mask.far, step, axis=1)
        empty = ~mask.is_seen
        near[empty] = np.minimum(near, beside[0])[empty]
        far[empty] = np.maximum(far, beside[1])[empty]
    return Mask(near, far)
