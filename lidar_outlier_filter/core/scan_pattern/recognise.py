# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the points are: a spinning sensor, a scanner of profiles, one without rings, or neither.

What a cloud claims, its rings, times and frame, is believed where geometry agrees: seen from where
its beams leave, all returns of a ring have one elevation. Where it disagrees, the sensor's own
frame and its rings are sought, and the first reading that agrees is taken.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.scan_lines import is_interleaved, line_starts, order_by_line
from lidar_outlier_filter.core.scan_pattern.own_frame import find_own_frame
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.recovered_rings import (
    MAX_RINGS,
    MIN_RINGS,
    Rings,
    as_turn,
    draws_curves,
    find_rings,
    find_rows,
    in_bands,
)
from lidar_outlier_filter.core.scan_pattern.scan_pattern import MIN_RING_RETURNS, find_pattern
from lidar_outlier_filter.core.scan_pattern.steady_times import with_steady_times

SAMPLE_RETURNS = 64  # returns of a ring that show its elevation
# Median deviation of a ring's elevations ÷ angle to the ring beside it. Of real sensors it was 0.12
# and less, as lenses sit beside the axis; of the same rings seen from elsewhere 0.8 and more.
AGREES, DISAGREES = 0.25, 2.0  # between: motion within a turn, or a frame a few metres away
MIN_RING_DEGREES = 15  # of azimuth, in which a typical ring has returns
MIN_RING_TURN_RAD = 0.3  # rad that a ring covers at least
MIN_GRID_RETURNS = 4  # of a row or column that shows an elevation
MAX_MISSES = 3  # blocks without rings, after which a stream has none
# Share of returns after which the next of their ring is off, and one of those after it is near.
# Of two sensors it was 0.92 and more, of one, in any frame, 0.14 and less.
MIN_TURNS_SHARE = 0.5
LATER, OFF_TIMES = (2, 3, 4), 4.0  # returns on; times as far
TIME_STRETCHES = 64  # of time
MIN_STRETCH_PART = 0.25  # of the returns that a ring has in a stretch on average
MIN_TIMED_SHARE = 0.3  # of the stretches, in which a typical ring has returns
MIN_RING_GAP_RAD = 1e-4  # rad: rings nearer to each other are far from the origin


class SensorKind(Enum):
    """What the points are, in words for users."""

    SPINNING = 'a spinning sensor'
    PROFILE = 'a scanner of profiles'
    FREE = 'a scanner without rings'


class Recognised(NamedTuple):
    """A scan pattern, and what of."""

    kind: SensorKind
    pattern: Pattern


@dataclass
class Kept:
    """What earlier blocks of a stream have shown, so that it is not sought anew in each."""

    rings: Rings | None = None
    misses: int = 0  # blocks without rings, one after the other

    def find_rings(self, xyz: Floats) -> Rings | None:
        """Return the rings of points (N, 3): known ones if they fit; None if there are none."""
        if self.rings is not None and self.rings.fit(xyz):
            return self.rings
        if self.misses >= MAX_MISSES:
            return None
        rings = find_rings(xyz)
        self.misses = 0 if rings is not None else self.misses + 1
        self.rings = self.rings if rings is None else rings
        return rings


def recognise(
    points: Points, sensor: str, threads: int = 0, kept: Kept | None = None
) -> Recognised | None:
    """Find the scan pattern of points; None if they have none.

    Parameters
    ----------
    points : valid ones
    sensor : 'spinning', 'profile', 'free' (a scanner without rings), or 'auto' (any of them)
    threads : maximum number of threads; 0: all cores
    kept : what earlier blocks of the stream have shown

    """
    if sensor == 'free':
        return _find_in_bands(points, threads)
    # Azimuths are known in the sensor's own frame only.
    turned, kept = as_turn(points).in_own_frame, Kept() if kept is None else kept
    order = order_by_line(turned)
    claim = _Claim(turned, order, points.ring is not None or sensor == 'spinning', threads)
    if sensor == 'profile':
        return _find_profiles(points, claim)
    spread = ring_spread(turned, order, spins=claim.spins)
    has_rings = len(line_starts(turned.line[order])) > MIN_RINGS
    pattern = None if has_rings else _find_in_rings(turned, kept, threads)
    if pattern is None and sensor == 'auto' and draws_curves(turned, order):
        return _find_in_bands(points, threads)
    if pattern is None and spread <= AGREES:
        steady = with_steady_times(turned, order)
        by_time = order if steady is turned else order_by_line(steady)
        pattern = find_pattern(steady, threads, by_time, spins=claim.spins)
    # A spinning sensor's lines are measured at once, a profile scanner's are not: at most one of
    # the two fits.
    if pattern is None and sensor == 'auto' and (profiles := _find_profiles(points, claim)):
        return profiles
    if pattern is None:
        pattern = _find_otherwise(claim, spread, kept)
    return None if pattern is None else Recognised(SensorKind.SPINNING, pattern)


class _Claim(NamedTuple):
    """Points as they come: seen from the origin of their frame, by their own lines and times."""

    points: Points
    order: Ints
    spins: bool  # whether lines are known to be rings
    threads: int


def _find_profiles(points: Points, claim: _Claim) -> Recognised | None:
    order = claim.order if points.ring is None else None
    pattern = find_profile_pattern(points, claim.threads, order)
    return None if pattern is None else Recognised(SensorKind.PROFILE, pattern)


def _find_in_bands(points: Points, threads: int) -> Recognised | None:
    pattern = find_pattern(in_bands(points).in_own_frame, threads, spins=True)
    return None if pattern is None else Recognised(SensorKind.FREE, pattern)


def _find_otherwise(claim: _Claim, spread: float, kept: Kept) -> Pattern | None:
    """Find the pattern of a spinning sensor in another frame, or without its rings or times."""
    points, order, spins, threads = claim
    pattern, is_recovered = None, points.ring is not None
    # The own frame of points that may have been moved takes long.
    if not is_recovered:
        moved = find_own_frame(points, order)
        pattern = None if moved is None else find_pattern(moved.in_own_frame, threads, order)
    if pattern is None and spread <= DISAGREES:
        pattern = find_pattern(points, threads, order, spins=spins, in_rows=spread <= AGREES)
        if pattern is not None or is_recovered:
            return pattern
    if pattern is None:
        pattern = _find_in_rings(points, kept, threads)
    rows = find_rows(points, order) if pattern is None else None
    if rows is None:
        return pattern
    return find_pattern(as_turn(replace(points, ring=rows)), threads, spins=True)


def _find_in_rings(points: Points, kept: Kept, threads: int) -> Pattern | None:
    """Find the pattern of rings that elevations show, with their own times if they agree."""
    rings = kept.find_rings(points.xyz)
    if rings is None:
        return None
    ring = rings.number(points.xyz)
    turned = as_turn(replace(points, ring=ring))
    # A mirror that turns upright has elevations, too, each at two azimuths.
    degrees = len(np.unique(ring * 360 + turned.t * 360 // SECOND))
    if degrees < MIN_RING_DEGREES * len(rings.angles):
        return None
    timed = replace(points, line=ring)
    pattern = find_pattern(timed, threads) if _are_timed_together(timed) else None
    if pattern is not None:
        return pattern
    turned = replace(turned, t=turned.t + 2 * SECOND * _turn_numbers(points))
    return find_pattern(turned, threads, spins=True)


def _turn_numbers(points: Points) -> Ints:
    """Return the turn (N,) of points that have no time in it: their message, or a part of one."""
    _, message = np.unique(points.t, return_inverse=True)
    if message.max() < MIN_RINGS:  # all points of a message have its stamp
        return message
    order = order_by_line(points)
    first = line_starts(points.line[order])
    if len(first) > MIN_RINGS or is_interleaved(points.t[order], first):
        return np.zeros(len(points), np.int64)
    _, message = np.unique(points.line, return_inverse=True)
    return message


def _are_timed_together(points: Points) -> bool:
    """Return whether typical rings have their part of the returns at nearly every time.

    Where points come ring by ring, and times follow from their order, each ring has its own.
    Stretches of time are those of equal numbers of points.
    """
    stretch = np.empty(len(points), np.int64)
    stretch[np.argsort(points.t, kind='stable')] = (
        np.arange(len(points)) * TIME_STRETCHES // len(points)
    )
    _, ring = np.unique(points.line, return_inverse=True)
    count = np.bincount(
        ring * TIME_STRETCHES + stretch, minlength=(ring.max() + 1) * TIME_STRETCHES
    )
    part = count.reshape(-1, TIME_STRETCHES) >= MIN_STRETCH_PART * len(points) / len(count)
    return bool(np.median(part.mean(axis=1)) >= MIN_TIMED_SHARE)


def share_rings(points: Points) -> bool:
    """Return whether returns of several sensors, of the same ring numbers, take turns in time.

    Parameters
    ----------
    points : valid ones, with rings as lines, in any frame

    """
    order = order_by_line(points)
    line = points.line[order]
    first = line_starts(line)
    if len(first) <= MIN_RINGS or not is_interleaved(points.t[order], first):
        return False
    xyz = points.xyz[order]
    # Two returns of a shot are off each other, too, but in one direction.
    length = np.sqrt((xyz**2).sum(axis=1, keepdims=True))
    towards = np.divide(xyz, length, out=np.zeros_like(xyz), where=length > 0)

    def away(on: int) -> Floats:
        """Return how far the direction is of a return that is so many on in the ring."""
        found = np.full(len(line), np.inf)
        same = np.flatnonzero(line[on:] == line[:-on])
        found[same] = np.sqrt(((towards[same + on] - towards[same]) ** 2).sum(axis=1))
        return found

    following, later = away(1), np.minimum.reduce([away(on) for on in LATER])
    turns = OFF_TIMES * later < following
    return bool(turns[np.isfinite(following)].mean() > MIN_TURNS_SHARE)


def rows_are_columns(xyz: Floats, valid: Bools) -> bool:
    """Return whether the rows of an organised cloud are columns of a sweep, so its columns rings.

    Returns of a ring have one elevation, seen from the sensor. Where they have none in rows nor in
    columns, as in another frame, there are more shots in a turn than rings in a sensor.

    Parameters
    ----------
    xyz : (height, width, 3) float64
        Metres.
    valid : (height, width) bool

    """
    height, width = valid.shape
    if min(height, width) < MIN_RINGS:
        return False
    sine = _sines(np.where(valid[..., None], xyz, np.nan))
    as_rows, as_columns = _grid_spread(sine), _grid_spread(sine.T)
    # Shots of turns of one mirror have one elevation, too, but all at one azimuth.
    if as_columns < as_rows and _typical_turn(xyz, valid) < MIN_RING_TURN_RAD:
        return False
    if min(as_rows, as_columns) > AGREES:
        return bool(height > MAX_RINGS >= width)
    return bool(as_columns < as_rows)


def _typical_turn(xyz: Floats, valid: Bools) -> float:
    """Return how far a column (height, width, 3) typically turns from row to row in all, rad."""
    azimuth = np.where(valid, np.arctan2(xyz[..., 1], xyz[..., 0]), np.nan)
    step = np.diff(azimuth, axis=0)
    step -= 2.0 * np.pi * np.rint(step / (2.0 * np.pi))
    measured = step[np.isfinite(step).any(axis=1)]
    return float(abs(np.nanmedian(measured, axis=1).sum()))


def _grid_spread(sine: Floats) -> float:
    """Return what :func:`ring_spread` does, of lines (L, M) with NaN where there is no return."""
    count = np.isfinite(sine).sum(axis=1)
    some = sine[count >= MIN_GRID_RETURNS]
    return np.inf if len(some) < MIN_RINGS else _spread(some)


def _sines(xyz: Floats) -> Floats:
    """Return sines of elevations (...) of points (..., 3); 0 at the origin."""
    distance = np.sqrt((xyz**2).sum(axis=-1))
    sines: Floats = np.divide(
        xyz[..., 2], distance, out=np.zeros_like(distance), where=distance != 0
    )
    return sines


def _medians(rows: Floats) -> Floats:
    """Return the median of each row, without its NaN, for which NumPy takes 30 times as long."""
    has_nan = np.isnan(rows).any()
    medians: Floats = (np.nanmedian if has_nan else np.median)(rows, axis=1)
    return medians


def _spread(sine: Floats) -> float:
    """Return how far sines (L, M) are off the median of their line ÷ how far the next line is."""
    middle = _medians(sine)
    gap = float(np.median(np.diff(np.sort(middle))))
    off = _medians(np.abs(sine - middle[:, None]))
    return np.inf if gap < MIN_RING_GAP_RAD else float(np.median(off)) / gap


def ring_spread(points: Points, order: Ints, *, spins: bool = False) -> float:
    """Return how far returns are off the elevation of their ring ÷ how far the next ring is.

    Parameters
    ----------
    points : valid ones, seen from the origin
    order : that of :func:`.order_by_line`
    spins : whether lines are known to be rings

    Returns
    -------
    float
        0 of a single ring; inf of lines that are measured one after the other, and of rings without
        any angle between them.

    """
    if not len(order):
        return np.inf
    first = line_starts(points.line[order])
    if not spins and not is_interleaved(points.t[order], first):
        return np.inf
    count = np.diff(first)
    full = np.flatnonzero(count >= MIN_RING_RETURNS)
    if len(full) <= 1:
        return 0.0
    some = order[
        first[full, None] + np.arange(SAMPLE_RETURNS) * count[full, None] // SAMPLE_RETURNS
    ]
    return _spread(_sines(points.xyz[some]))
