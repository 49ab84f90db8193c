# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The mask of the own vehicle: its ranges by ring and azimuth, its file, and how it is learnt.

Returns that stay at the same direction and range while the vehicle moves are of the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import CloudError, ParameterError
from lidar_outlier_filter.parameters.declaration import OFF, read_small
from lidar_outlier_filter.parameters.filter import FilterParameters

COLUMNS = 720  # of the image: half a degree each, the first from 0° on, against the clock
MAX_RINGS = 1024
LARGEST_RANGE_M = 100.0  # metres: no vehicle is longer
HEAD = f'# own vehicle, {COLUMNS} columns, metres'
MASK_COLUMNS = 'ring,column,near,far'
MAX_MASK_BYTES = 32_000_000  # bytes
NEEDS_RINGS = 'the rings of the sensor, by a field or by rows, where there is a mask'

BIN = 0.05  # metres, of the histograms of ranges
MIN_SHARE_OF_RETURNS = 0.5  # of the turns with a return in a cell, in which a range recurs
# Of the points, in cells whose elevations differ by more than an angle: lines that are not rings.
MAX_SHARE_OF_WIDE, WIDE_ELEVATION = 0.5, np.radians(5)
MIN_SHARE_OF_RING = 0.5  # of the turns, in which the median ring has a point
MIN_SHARE_OF_TURNS = 0.25  # of all turns used
TURN_SPACING_M = 1.0  # between two turns that are used, where the sensor's position is known
# Elsewhere: the share of far cells whose range has changed, by so many metres plus so much of it.
CHANGED, BY_METRES, BY_SHARE = 0.2, 0.2, 0.05
WIDE = 4  # columns of one of these cells
POINTS_OF_TURN, MAX_SAMPLED_TURNS = 500, 200  # from which the plane of the ground is found
TRIALS = 300  # random planes
FLAT = 0.15  # metres from the plane of the ground
CLEAR = 0.25  # metres above it, where the vehicle begins
MIN_ON_GROUND, MAX_BELOW = 0.1, 0.05  # shares of the points on the plane, and below it
UPRIGHT = np.cos(np.pi / 4)  # of the tilt of the sensor against the ground


@dataclass(frozen=True, eq=False)
class Mask:
    """The own vehicle in the frame of its sensor.

    Attributes
    ----------
    near, far : (R, COLUMNS) float64
        Smallest and largest range of the vehicle, metres; inf and -inf in other directions.

    """

    near: Floats
    far: Floats

    @classmethod
    def nothing(cls, rings: int) -> Mask:
        """Return a mask without a vehicle."""
        return cls(np.full((rings, COLUMNS), np.inf), np.full((rings, COLUMNS), -np.inf))

    @property
    def is_seen(self) -> Bools:
        """Where the vehicle is, (R, COLUMNS)."""
        return np.asarray(self.far >= self.near)

    @cached_property
    def with_shadow(self) -> Mask:
        """The mask up to any range, without the columns at its edges: beams pass beside them."""
        seen = self.is_seen
        inner = seen & np.roll(seen, 1, axis=1) & np.roll(seen, -1, axis=1)
        return Mask(np.where(inner, self.near, np.inf), np.where(inner, np.inf, -np.inf))

    def covers(self, points: Points, tolerance: float) -> Bools:
        """Return which of N valid points are on the vehicle; invalid ones are not.

        Parameters
        ----------
        points : in the sensor's own frame, whose lines are its rings
        tolerance : metres, in front of the nearest range and behind the farthest

        """
        result = np.empty(len(points), np.bool_)
        cells = self.near, self.far
        _kernels.find_masked(points.xyz, points.line, points.valid, *cells, tolerance, result)
        return result


def masked(points: Points, mask: Mask | None, parameters: FilterParameters) -> Points:
    """Mask the own vehicle, and its shadow: masked points are neither valid nor neighbours."""
    if mask is None:
        return points
    covered = mask.covers(points, parameters.mask_tolerance)
    shadow = None
    if parameters.mask_shadow:
        shadow = mask.with_shadow.covers(points, parameters.mask_tolerance) & ~covered
        covered |= shadow
    return replace(points, valid=points.valid & ~covered, masked=covered, shadow=shadow)


def mask_of(parameters: FilterParameters) -> Mask | None:
    """Read the mask that the parameters name; None: it is off.

    Raises
    ------
    ParameterError
        If there is no such file, or it holds no mask.

    """
    return None if parameters.mask == OFF else read_mask(Path(parameters.mask))


def content_of(parameters: FilterParameters) -> str:
    """Hash the mask file, to detect a changed mask.

    Returns ``off`` without a mask, and the name of an unreadable file, which is refused elsewhere.
    """
    if parameters.mask == OFF:
        return OFF
    try:
        data = read_small(Path(parameters.mask), MAX_MASK_BYTES)
        return sha256(data).hexdigest()
    except OSError:
        return parameters.mask


def read_mask(path: Path) -> Mask:
    """Read a mask file; an invalid one is refused as a whole.

    Raises
    ------
    ParameterError
        If it cannot be read, or a line of it makes no sense.

    """
    try:
        data = read_small(path, MAX_MASK_BYTES)
        lines = data.decode('ascii').splitlines()
    except (OSError, ValueError) as err:
        reason = getattr(err, 'strerror', None) or 'bytes that are no text'
        raise ParameterError(f'the mask {path}', 'a readable file', f'"{reason}"') from err
    if len(data) > MAX_MASK_BYTES:
        raise ParameterError(f'the mask {path}', f'of at most {MAX_MASK_BYTES} bytes', 'more')
    if lines[:2] != [HEAD, MASK_COLUMNS]:
        must_be = f'one that begins with {HEAD!r} and {MASK_COLUMNS!r}'
        raise ParameterError(f'the mask {path}', must_be, repr(' '.join(lines[:2])))
    cells = [_cell(path, number, line) for number, line in enumerate(lines[2:], 3)]
    mask = Mask.nothing(1 + max((int(ring) for ring, *_ in cells), default=-1))
    for number, (ring, column, near, far) in enumerate(cells, 3):
        cell = int(ring), int(column)
        if mask.far[cell] >= 0:
            raise ParameterError(f'line {number} of the mask {path}', 'another cell', cell)
        mask.near[cell], mask.far[cell] = near, far
    return mask


def _cell(path: Path, number: int, line: str) -> tuple[float, float, float, float]:
    """Read a line: ring, column, and between which ranges."""
    try:
        ring, column, near, far = map(float, line.split(','))
    except ValueError:
        ring = column = near = far = np.nan
    whole = ring in range(MAX_RINGS) and column in range(COLUMNS)
    if not (whole and 0 <= near <= far <= LARGEST_RANGE_M):
        must_be = (
            f'a ring below {MAX_RINGS}, a column below {COLUMNS}, and two ranges, the nearer '
            f'first, up to {LARGEST_RANGE_M:g} m'
        )
        raise ParameterError(f'line {number} of the mask {path}', must_be, repr(line))
    return ring, column, near, far


def as_text(mask: Mask) -> str:
    """Write a mask as :func:`read_mask` reads it, a line for each cell; ranges in millimetres."""
    lines = [HEAD, MASK_COLUMNS]
    for ring, column in np.argwhere(mask.is_seen).tolist():
        near, far = mask.near[ring, column], mask.far[ring, column]
        lines.append(f'{ring},{column},{near:.3f},{far:.3f}')
    return '\n'.join(lines) + '\n'


class MaskLearner:
    """Learns a mask from turns of a sensor, one after the other.

    A turn is used if the sensor has moved since the last one that was used.

    Attributes
    ----------
    turns, taken : number of turns seen, and of turns used

    """

    def __init__(self, reach: float) -> None:
        """Look for the vehicle up to ``reach`` metres from the sensor."""
        self.turns = self.taken = 0
        self._bins = int(np.ceil(reach / BIN))
        self._hits = np.zeros((0, COLUMNS, self._bins), np.uint32)
        self._returns = np.zeros((0, COLUMNS), np.int64)
        self._last: Floats = np.zeros((0, COLUMNS // WIDE))  # ranges of the last turn used
        self._place: Floats | None = None
        self._sines = np.zeros(0)  # of elevations, added up by ring
        self._points = np.zeros(0, np.int64)
        self._samples: list[Floats] = []
        self._turns_of_ring = np.zeros(0, np.int64)
        self._wide = self._narrow = 0  # points in cells of several elevations, and in others

    @property
    def contradiction(self) -> str:
        """Say why the lines are not rings, which have one elevation at each azimuth; '': they are.

        Those of a profile scanner that stands upright have all elevations at two azimuths, and
        numbers that are not restarted come once.
        """
        seen = self._turns_of_ring[self._turns_of_ring > 0]
        if self._wide > MAX_SHARE_OF_WIDE * (self._wide + self._narrow):
            return 'lines with many elevations at the same azimuth, as a profile scanner has them'
        if len(seen) and np.median(seen) < MIN_SHARE_OF_RING * self.turns:
            return f'lines that recur in {np.median(seen):g} of {self.turns} turns'
        return ''

    def add(self, points: Points, place: Floats | None = None) -> bool:
        """Add a turn; return whether it is used.

        Parameters
        ----------
        points : valid ones, in the sensor's own frame, whose lines are its rings
        place : (3,) where the sensor was, metres; None: not known

        Raises
        ------
        CloudError
            If a line cannot be a ring.

        """
        self.turns += 1
        ring = points.line
        low, high = int(ring.min(initial=0)), int(ring.max(initial=-1))
        if low < 0 or high >= MAX_RINGS:
            raise CloudError('the ring of a point', f'from 0 to {MAX_RINGS - 1}', max(high, -low))
        self._grow(high + 1)
        self._turns_of_ring[np.unique(ring)] += 1
        column, distance = np.empty(len(points), np.int64), np.empty(len(points))
        _kernels.find_columns(points.xyz, COLUMNS, column, distance)
        ranges = np.full(self._last.shape, np.inf)
        np.minimum.at(ranges, (ring, column // WIDE), distance)
        if not self._has_moved(ranges, place):
            return False
        self.taken += 1
        self._last, self._place = ranges, place
        self._count(ring, column, distance)
        sines = points.xyz[:, 2] / np.maximum(distance, BIN)
        self._count_wide(ring * COLUMNS + column, np.arcsin(np.clip(sines, -1, 1)))
        self._sines += np.bincount(ring, sines, len(self._sines))
        self._points += np.bincount(ring, minlength=len(self._points))
        if len(self._samples) < MAX_SAMPLED_TURNS and len(points):
            self._samples.append(points.xyz[:: -(-len(points) // POINTS_OF_TURN)])
        return True

    def _grow(self, rings: int) -> None:
        more = rings - len(self._returns)
        if more > 0:
            wider = ((0, more), (0, 0))
            self._returns = np.pad(self._returns, wider)
            self._hits = np.pad(self._hits, (*wider, (0, 0)))
            self._last = np.pad(self._last, wider, constant_values=np.inf)
            self._sines = np.pad(self._sines, (0, more))
            self._points = np.pad(self._points, (0, more))
            self._turns_of_ring = np.pad(self._turns_of_ring, (0, more))

    def _has_moved(self, ranges: Floats, place: Floats | None) -> bool:
        """Return whether the sensor has moved since the last turn that was used."""
        if self.taken == 0:
            return bool(np.isfinite(ranges).any())
        if place is not None and self._place is not None:
            return bool(np.linalg.norm(place - self._place) >= TURN_SPACING_M)
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

    def _count_wide(self, cell: Ints, elevation: Floats) -> None:
        """Count the points in cells that have several elevations, radians."""
        low = np.full(self._returns.size, np.inf)
        high = -low
        np.minimum.at(low, cell, elevation)
        np.maximum.at(high, cell, elevation)
        wide = int(np.count_nonzero((high - low)[cell] > WIDE_ELEVATION))
        self._wide += wide
        self._narrow += len(cell) - wide

    def learn(self) -> Mask:
        """Return the static returns except the ground, widened by a column on either side."""
        mask = Mask.nothing(len(self._returns))
        least = np.maximum(MIN_SHARE_OF_RETURNS * self._returns, MIN_SHARE_OF_TURNS * self.taken)
        where = np.argwhere(self._hits >= np.maximum(least, 1)[:, :, np.newaxis])
        ring, column, number = where[self._is_clear(*where.T)].T
        np.minimum.at(mask.near, (ring, column), number * BIN)
        np.maximum.at(mask.far, (ring, column), (number + 1) * BIN)
        return _wider(mask)

    def _is_clear(self, ring: Ints, column: Ints, number: Ints) -> Bools:
        """Return which positions, by their cells and bins, are clear of the ground."""
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

    Returns the direction that is up, and the height of the sensor, metres; None: no ground.
    """
    rng = np.random.default_rng(0)
    best, found = MIN_ON_GROUND * len(xyz), None
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
        if on > best and height > 0 and (above < -FLAT).mean() < MAX_BELOW:
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
