# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Rings of a cloud without a ring field, from elevations or rows; or bands of elevation.

A spinning sensor measures at some elevations only. Seen from the origin of its beams, points lie at
these elevations, and none between. Clouds of other sensors have no such elevations. Where motion
has spoilt them, points may still come ring by ring, as rows of a range image.
"""

import math
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.scan_lines import line_starts
from lidar_outlier_filter.core.scan_pattern.scan_pattern import MIN_RING_RETURNS, TURN, advances

# The origin of the beams: lenses sit beside the axis, and frames begin below them, so near points
# of a ring are not at its elevation. Seen from the right position, elevations lie closest together.
SEARCH_STEPS = 6  # steps of the first search, each way
STEP_M = 0.02  # metres
FINEST_STEP_M = 0.0005
MOVES = 4  # with each step
COARSE_POINTS, FINE_POINTS = 1 << 12, 1 << 14  # points of the first search, and of the others
MIN_GAIN = 0.02  # halvings of the distance, less than which the origin is as good


class Origin(NamedTuple):
    """Origin of the beams: metres above the frame's origin, and outwards from its axis."""

    up: float
    out: float


def find_origin(flat: Floats, z: Floats) -> Origin:
    """Find the origin of the beams.

    Parameters
    ----------
    flat, z : (N,) float64
        Distance from the axis, and height, metres, sorted by height, then by distance.

    """
    best, least = Origin(0.0, 0.0), math.inf
    few, their_z = (one[:: max(1, len(z) // COARSE_POINTS)].copy() for one in (flat, z))
    for i in range(-SEARCH_STEPS, SEARCH_STEPS + 1):
        for j in range(-SEARCH_STEPS, SEARCH_STEPS + 1):
            tried = Origin(STEP_M * i, STEP_M * j)
            value = _kernels.spread(few, their_z, *tried)
            if value < least:
                best, least = tried, value
    flat, z = (one[:: max(1, len(z) // FINE_POINTS)].copy() for one in (flat, z))
    least, step = _kernels.spread(flat, z, *best), STEP_M / 2
    while step >= FINEST_STEP_M:
        for _ in range(MOVES):
            around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
            near = [Origin(best.up + step * i, best.out + step * j) for i, j in around]
            values = [_kernels.spread(flat, z, *one) for one in near]
            if min(values) >= least:
                break
            least = min(values)
            best = near[values.index(least)]
        step /= 2
    return best if _kernels.spread(flat, z, 0.0, 0.0) > least + MIN_GAIN else Origin(0.0, 0.0)


MIN_RINGS, MAX_RINGS = 8, 160  # of a sensor: there are some with 8, and none above 128
MAX_TURN_POINTS = 2_000_000  # two returns of 128 rings, a shot each 0.1°, are half of that
MIN_SPAN_RAD = 0.05  # rad from the lowest ring to the highest: a cloud far from its origin has less
COLUMN_RAD = TURN / 72_000  # rad: a column of the histogram of elevations
WIDTHS = (1, 2, 4, 8, 16, 32)  # columns over which the histogram is smoothed
FAR_M = 8.0  # metres, from which on what a beam leaves beside the origin does not matter
# Rad of elevation, in which all but the nearest quarter of the points are far: a wider one, or a
# larger part, would be all that a ring on the ground has.
BAND_RAD = TURN / 1440
MIN_RING_POINTS = 6  # points of a ring, in as many columns as it is smoothed over
NEAR_PART = 0.25  # of the angle to the nearer ring beside: so near a ring are its points
# Share of the points that are so near. Of sensors it was 0.98 and more, and 0.89 where coordinates
# within a room were rounded to 1 cm; of other clouds 0.66 and less.
MIN_NEAR_SHARE = 0.85
AS_GOOD = 0.002  # less than the best share: the smoother histogram counts


class Rings(NamedTuple):
    """Where beams leave, and the angles of the rings upwards, rad, ascending."""

    origin: Origin
    angles: Floats

    def number(self, xyz: Floats) -> Ints:
        """Return the nearest ring (N,) of each point (N, 3); 0 is the lowest."""
        between = (self.angles[1:] + self.angles[:-1]) / 2.0
        elevation = _kernels.elevations(*_flat(xyz), *self.origin)
        return np.searchsorted(between, elevation).astype(np.int64)

    def fit(self, xyz: Floats) -> bool:
        """Return whether most of a sample of the points (N, 3) lie on these rings."""
        some = xyz[:: max(1, len(xyz) // FINE_POINTS)]
        if len(some) < MIN_RINGS * MIN_RING_RETURNS:
            return False
        flat, z = _flat(some)
        elevation = _kernels.elevations(flat, z, *self.origin)
        far = is_far(elevation, np.sqrt(flat * flat + z * z))
        return _share_near(elevation[far], self.angles) >= MIN_NEAR_SHARE


def find_rings(xyz: Floats) -> Rings | None:
    """Find the rings of one turn of a spinning sensor; None if there are none.

    Parameters
    ----------
    xyz : (N, 3) float64
        Metres, finite, in the sensor's own frame, in any order.

    """
    if not MIN_RINGS * MIN_RING_RETURNS <= len(xyz) <= MAX_TURN_POINTS:
        return None
    flat, z = _flat(xyz)
    order = np.lexsort((flat, z))
    ordered = flat[order], z[order]
    # Without 1 % at either end.
    ends = np.quantile(_kernels.elevations(*ordered, 0.0, 0.0), [0.01, 0.99], method='lower')
    if ends[1] - ends[0] < MIN_SPAN_RAD:
        return None
    origin = find_origin(*ordered)
    rings = find_elevations(*ordered, origin)
    return None if rings is None else Rings(origin, rings)


def recover_rings(xyz: Floats) -> Ints | None:
    """Return the ring (N,) of each point of one turn, see :func:`find_rings`; None without."""
    rings = find_rings(xyz)
    return None if rings is None else rings.number(xyz)


def _flat(xyz: Floats) -> tuple[Floats, Floats]:
    """Return distances from the axis, and heights, metres."""
    return np.sqrt(xyz[:, 0] ** 2 + xyz[:, 1] ** 2), np.ascontiguousarray(xyz[:, 2])


MIN_ROW_RAD = 1.0  # rad that a row turns; flight lines of a map, far from its origin, turn less


def find_rows(points: Points, order: Ints) -> Ints | None:
    """Find rows of a range image: azimuths advance along each, and each lies above the one before.

    Parameters
    ----------
    points : valid ones, in the sensor's own frame
    order : that of :func:`.order_by_line`; if all are of one line, each turn of it is a row

    Returns
    -------
    (N,) int64 or None
        The ring of each point; 0 is the lowest. None if the points are no such rows.

    """
    if not MIN_RINGS * MIN_RING_RETURNS <= len(points) <= MAX_TURN_POINTS:
        return None
    azimuth: Floats = _kernels.times_of_turn(points.xyz[order]).astype(np.float64) * (TURN / SECOND)
    line = points.line[order]
    if line[0] == line[-1]:
        phase = np.cumsum(_steps(azimuth))
        line = np.maximum(np.floor(np.sign(phase[-1]) * phase / TURN), 0.0).astype(np.int64)
        inner = np.argsort(line, kind='stable')
        order, azimuth, line = order[inner], azimuth[inner], line[inner]
    first = line_starts(line)
    if not MIN_RINGS < len(first) <= MAX_RINGS + 1:
        return None
    step = _steps(azimuth)
    step[first[:-1]] = 0.0
    phase = np.cumsum(step if step.sum() > 0 else -step)
    turns = np.diff(phase[np.append(first[:-1], -1)])
    distance = points.range[order]
    up = np.divide(points.xyz[order, 2], distance, out=np.zeros(len(order)), where=distance > 0)
    full = [part for part in pairwise(first) if part[1] - part[0] >= MIN_RING_RETURNS]
    higher = np.sign(np.diff([np.median(up[begin:end]) for begin, end in full]))
    rises = abs(higher.sum()) == len(higher) >= MIN_RINGS - 1
    if not rises or np.median(turns) < MIN_ROW_RAD or not advances(phase, first):
        return None
    numbers = np.arange(len(first) - 1)
    ring = np.empty(len(order), np.int64)
    ring[order] = np.repeat(numbers if higher[0] > 0 else numbers[::-1], np.diff(first))
    return ring


def _steps(azimuth: Floats) -> Floats:
    """Return the angle from each azimuth to the next, the shorter way round; 0 at first."""
    step: Floats = np.diff(azimuth, prepend=azimuth[:1])
    return step - TURN * np.rint(step / TURN)


def as_turn(points: Points) -> Points:
    """Use recovered rings as lines, with times as of a steadily turning head.

    The turn begins behind the sensor, goes counter-clockwise and takes 1 s. Points without
    recovered rings stay as they are.
    """
    if points.ring is None:
        return points
    xyz = np.ascontiguousarray(points.in_own_frame.xyz)
    return replace(points, line=points.ring, t=_kernels.times_of_turn(xyz))


def find_elevations(flat: Floats, z: Floats, origin: Origin) -> Floats | None:
    """Find the elevations of rings, rad, ascending; None without rings.

    Parameters
    ----------
    flat, z : (N,) float64
        Distance from the axis, and height, metres.
    origin : where beams leave from

    """
    elevation = _kernels.elevations(flat, z, *origin)
    elevation = elevation[is_far(elevation, np.sqrt(flat * flat + z * z))]
    column = np.floor((elevation + TURN / 2) / COLUMN_RAD).astype(np.int64) + WIDTHS[-1]
    count = np.bincount(column, minlength=round(TURN / COLUMN_RAD) + 2 * WIDTHS[-1])
    best: Floats = np.empty(0)
    most = 0.0
    for width in WIDTHS:
        peaks = _kernels.find_peaks(_smooth(count, width), MIN_RING_POINTS * width)
        if not MIN_RINGS <= len(peaks) <= MAX_RINGS:
            continue
        rings = (peaks.astype(np.float64) - WIDTHS[-1] + 0.5) * COLUMN_RAD - TURN / 2
        share = _share_near(elevation, rings)
        if share > most - AS_GOOD:
            best, most = rings, max(share, most)
    return best if most >= MIN_NEAR_SHARE and best[-1] - best[0] >= MIN_SPAN_RAD else None


def is_far(elevation: Floats, distance: Floats) -> NDArray[np.bool_]:
    """Return which points are far among those of about their elevation."""
    band = np.floor(elevation / BAND_RAD).astype(np.int64)
    order = np.lexsort((distance, band))
    first = line_starts(band[order])
    quarter = distance[order[first[:-1] + np.diff(first) // 4]]
    least = np.repeat(np.minimum(quarter, FAR_M), np.diff(first))
    far = np.empty(len(band), np.bool_)
    far[order] = distance[order] >= least
    return far


def _smooth(count: Ints, width: int) -> Ints:
    """Add to each column those around it, with weights that fall to 0 ``width`` columns away."""
    weights = width - np.abs(np.arange(1 - width, width))
    return np.convolve(count, weights, 'same')


def _share_near(elevation: Floats, rings: Floats) -> float:
    """Return the share of points that are near a ring: of all, or the mean over rings if less."""
    between = np.diff(rings)
    nearer = np.minimum(np.append(between, np.inf), np.append(np.inf, between))
    nearest = np.searchsorted((rings[1:] + rings[:-1]) / 2.0, elevation)
    near = np.abs(elevation - rings[nearest]) < NEAR_PART * nearer[nearest]
    of_ring = np.bincount(nearest, minlength=len(rings))
    shares = np.bincount(nearest, near, len(rings)) / np.maximum(of_ring, 1)
    return min(float(near.mean()), float(shares.mean()))


# Scanners without rings draw rosettes or zigzags: what is next in time lies on one curve. Bands of
# elevation stand for their rings, as high as their points are apart: so a point's neighbours are
# those around it on all sides. Rad, 0.05° to 4.4°. Products are the same on every machine, powers
# are not.
HEIGHTS = TURN / 7200 * np.cumprod(np.full(92, 1.05))


def in_bands(points: Points) -> Points:
    """Take bands of elevation for the lines of valid points, and azimuths for their times."""
    xyz = points.in_own_frame.xyz
    turned = as_turn(replace(points, ring=np.zeros(len(points), np.int64)))
    flat, z = _flat(xyz)
    elevation = _kernels.elevations(flat, z, 0.0, 0.0)
    reach = points.range
    # What is so near that its square is 0 has an elevation of 0.
    level = np.divide(flat, reach, out=np.ones(len(points)), where=reach > 0)
    height = find_height(elevation, turned.t, level)
    return replace(turned, line=_bands(elevation, height), ring=None)


# Such a scanner is known by the curve that each laser draws from shot to shot. It is smooth, it
# fills an area, and bends no more where ranges jump: so it is only from the origin of the beams.
MAX_SPAN_NS = 2 * SECOND  # a block is shorter, a map takes longer
MAX_STEP = 1.5  # times the usual time from shot to shot: beyond, some have no return
MIN_BENDS, MAX_BENDS = 1 << 10, 1 << 13  # from shot to shot: fewer show nothing, more no more
MAX_BEND = 0.125  # of the way from the first of the three to the last; without curves it is 0.4
JUMPS = 100  # one in so many bends has the largest jumps of the range
# Metres that the origin of the beams is from that of the frame. It was 0.08 of a Bpearl, and what
# 0.15 would spoil is little.
MAX_OFF_M = 0.1
MIN_WIDTH = 0.07  # of the length of a curve: a Mid-40 has 0.09 and more, a ring 0.05 and less


def draws_curves(points: Points, order: Ints) -> bool:
    """Return whether points are of a scanner without rings, which is at the origin.

    Parameters
    ----------
    points : valid ones with times, and lasers as lines
    order : that of :func:`.order_by_line`

    """
    line = points.line[order]
    if len(line) < MIN_BENDS or len(line_starts(line)) > MIN_RINGS:
        return False
    t = points.t[order]
    if np.ptp(t) > MAX_SPAN_NS:
        return False
    shot = np.flatnonzero(
        (np.diff(t, prepend=t[0] - 1) != 0) | (np.diff(line, prepend=line[0] - 1) != 0)
    )
    step, line = np.diff(t[shot]), line[shot]
    same = np.diff(line) == 0
    near = same & (step <= MAX_STEP * np.median(step[same])) if same.any() else same
    begin = np.flatnonzero(near[1:] & near[:-1])
    if len(begin) < MIN_BENDS:
        return False
    begin = begin[:: -(-len(begin) // MAX_BENDS)]
    three = points.xyz[order[shot[np.arange(3)[:, None] + begin]]]
    distance = np.sqrt((three**2).sum(axis=2))
    nearness = np.divide(1.0, distance, out=np.zeros_like(distance), where=distance > 0)
    towards = three * nearness[..., None]
    part = step[begin] / (step[begin] + step[begin + 1])
    bend = _length(towards[1] - towards[0] - part[:, None] * (towards[2] - towards[0]))
    jump = np.abs(nearness[1] - nearness[0] - part * (nearness[2] - nearness[0]))
    largest = np.argsort(jump, kind='stable')[-(len(jump) // JUMPS) :]
    return bool(
        np.median(bend) < MAX_BEND * np.median(_length(towards[2] - towards[0]))
        and np.median(bend[largest] - MAX_OFF_M * jump[largest]) < 0.0
        and _width(towards[0], line_starts(line[begin])) > MIN_WIDTH
    )


def _length(vectors: Floats) -> Floats:
    length: Floats = np.sqrt((vectors**2).sum(axis=1))
    return length


def _width(towards: Floats, first: Ints) -> float:
    """Return how wide the curves of some lines are, typically, ÷ how long."""
    widths = []
    for begin, end in pairwise(first):
        about = towards[begin:end] - towards[begin:end].mean(axis=0)
        least, _, most = np.linalg.eigvalsh(np.einsum('ij,ik->jk', about, about))
        widths.append(math.sqrt(max(least, 0.0) / most) if most > 0 else 0.0)
    return float(np.median(widths))


def find_height(elevation: Floats, turned: Ints, level: Floats) -> float:
    """Return the least of ``HEIGHTS``, rad, that is not below the distance of points in a band.

    Parameters
    ----------
    elevation : (N,) of the points, rad
    turned : (N,) azimuth, 1e9 to a turn
    level : (N,) cosine of the elevation

    """
    low, high = 0, len(HEIGHTS) - 1
    while low < high:
        middle = (low + high) // 2
        if _apart(_bands(elevation, HEIGHTS[middle]), elevation, turned, level) <= HEIGHTS[middle]:
            high = middle
        else:
            low = middle + 1
    return float(HEIGHTS[low])


def _bands(elevation: Floats, height: float) -> Ints:
    return np.floor(elevation / height).astype(np.int64)


def _apart(band: Ints, elevation: Floats, turned: Ints, level: Floats) -> float:
    """Return the median angle between neighbours in a band, rad; inf where none has any."""
    order = np.lexsort((elevation, turned, band))
    same = np.flatnonzero(np.diff(band[order]) == 0)
    if not len(same):
        return np.inf
    angle = np.diff(turned[order])[same] * (TURN / SECOND) * level[order[same]]
    return float(np.median(angle))
