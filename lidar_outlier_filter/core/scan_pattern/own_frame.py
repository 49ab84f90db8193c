# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The own frame of a spinning sensor, estimated from points in another frame.

The head turns steadily, so the time of a point gives its azimuth, but for a constant that each ring
may have of its own. Seen from the sensor, every point is where its azimuth says, however far it is:

    (x - s_x) sin φ = (y - s_y) cos φ

That shows where the sensor s was at some moments, linearly between them, and how it turned. All
elevations of a ring are the same, which shows its height, and how it leaned.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.points.points import SECOND, Points
from lidar_outlier_filter.core.points.scan_lines import is_interleaved, line_starts, order_by_line

SAMPLE_POINTS = 64  # points of a ring that show where the sensor was
MIN_RING_RETURNS, MIN_RINGS = 32, 4  # points of a ring, and rings, fewer show nothing
MOMENT_S = 0.05  # seconds between the moments
MAX_STRETCH_S = 2.0  # seconds: longer stretches would have too many moments
MIN_WEIGHED_M = 0.5  # m: what is nearer does not weigh more
FITS, LAST_FITS, LEANS = 10, 20, 3
CONVERGED = 1e-5  # m and rad: a fit that changes less is done
MIN_UP_COSINE = 0.5  # cosine of the most that it may lean
MAX_OFF_STEPS = 0.5  # steps of the head that a typical return may be off its azimuth
RIDGE = 1e-9  # keeps unknowns that no point determines
HUBER = 3.0  # times the median residual, beyond which a point weighs less
POSITION_PARTS, LEAN_PARTS = 1024.0, 65536.0  # parts that positions and leans are rounded to


class _Some(NamedTuple):
    """S points of each of R rings: positions (R, S, 3), and how near to each moment (R, S, K)."""

    xyz: Floats
    at: Floats
    phase: Floats  # (R, S) rad turned, if the head turned as fast as it usually does


def find_own_frame(points: Points, order: Ints | None = None) -> Points | None:
    """Return points of a spinning sensor with their positions in its own frame.

    Parameters
    ----------
    points : valid ones, in any frame whose z points up
    order : that of :func:`.order_by_line`, where it is known

    Returns
    -------
    Points or None
        None where the own frame does not show: lines are measured one after the other, there are
        fewer than four rings, a stretch is longer than two seconds, it leans by more than 60°, or
        points do not lie where a steadily turning head sees them. The direction of its x axis is
        arbitrary.

    """
    order = order_by_line(points) if order is None else order
    first = line_starts(points.line[order])
    rings = np.flatnonzero(np.diff(first) >= MIN_RING_RETURNS)
    t = points.t[order]
    if len(rings) < MIN_RINGS or not is_interleaved(t, first):
        return None
    start, seconds = int(t.min()), float(np.ptp(t)) / SECOND
    if seconds > MAX_STRETCH_S:
        return None
    rows = order[
        first[rings, None] + np.arange(SAMPLE_POINTS) * np.diff(first)[rings, None] // SAMPLE_POINTS
    ]
    guess = _first_guess(points.xyz[rows])
    east, north, _ = (points.xyz[order] - guess).T
    rate = SECOND * _kernels.turning_rate(np.arctan2(north, east), t, first)
    if not abs(rate) > 0.0:
        return None
    elapsed = np.diff(t)
    step = abs(rate) * float(np.median(elapsed[elapsed > 0])) / SECOND  # of the head, rad
    when = (points.t - start) / SECOND
    # Where many moments leave too much open, an even motion may still do.
    for count in sorted({int(np.ceil(seconds / MOMENT_S)) + 1, 2}, reverse=True):
        moments = np.linspace(0.0, seconds, count)
        near = np.maximum(1.0 - np.abs(when[rows][..., None] - moments) / moments[1], 0.0)
        position, turn, off = _find(_Some(points.xyz[rows] - guess, near, rate * when[rows]))
        if off <= MAX_OFF_STEPS * step:
            break
    else:
        return None
    own, away = np.empty_like(points.xyz), (points.xyz - guess).T
    for axis in range(3):
        # One product after the other: sums of matrices depend on where a point stands.
        x, y, z = (turn[axis, k] * away[k] for k in range(3))
        own[:, axis] = x + y + z - np.interp(when, moments, position[:, axis])
    return replace(points, own=own)


def _find(some: _Some) -> tuple[Floats, Floats, float]:
    """Find positions (K, 3) of the sensor, upright; what puts it upright; how far points are off.

    How it leans is measured from where it is, and the other way round: by turns.
    """
    turn, seen = np.eye(3), some
    position = np.zeros((some.at.shape[2], 3))
    for _ in range(LEANS):
        position, _ = _fit(seen, position)
        position[:, 2], lean = _level(seen, position)
        up = turn.T @ lean
        if not up[2] > MIN_UP_COSINE * np.sqrt((up**2).sum()):
            return position, turn, np.inf
        before, turn = turn, _upright(np.rint(up * LEAN_PARTS) / LEAN_PARTS)
        position = position @ before @ turn.T
        seen = some._replace(xyz=np.einsum('rsj,ij->rsi', some.xyz, turn))
    position, off = _fit(seen, position, LAST_FITS)
    position[:, 2], _ = _level(seen, position)
    return np.rint(position * POSITION_PARTS) / POSITION_PARTS, turn, off


def _upright(up: Floats) -> Floats:
    """Return the shortest rotation that turns a direction up."""
    x, y, z = up / np.sqrt((up**2).sum())
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + z))


def _first_guess(xyz: Floats) -> Floats:
    """Estimate the sensor's position, metres: the centre of the smallest rings (R, S, 3)."""
    middle = np.median(xyz, axis=1)
    about = (xyz - middle[:, None])[:, :, :2]
    square = (about**2).sum(axis=2)
    small = np.argsort(np.median(square, axis=1), kind='stable')[: max(len(xyz) // 4, 1)]
    centres = []
    for ring in small:
        rows = np.column_stack([about[ring], np.ones(len(about[ring]))])
        east, north, _ = np.linalg.lstsq(rows, square[ring], rcond=None)[0] / 2.0
        centres.append(middle[ring] + np.array([east, north, 0.0]))
    return np.asarray(np.rint(np.median(centres, axis=0)))


def _fit(some: _Some, position: Floats, fits: int = FITS) -> tuple[Floats, float]:
    """Fit x and y of the sensor and its azimuth at each moment; return how far points are off.

    Rings have constants of their own: their beams may leave to one side.
    """
    count, position, off = len(position), position.copy(), np.inf
    east, north = np.moveaxis((some.xyz - some.at @ position)[:, :, :2], 2, 0)
    behind = np.exp(1j * (np.arctan2(north, east) - some.phase))
    phase = some.phase + np.angle(behind.mean())
    for _ in range(fits):
        east, north = np.moveaxis((some.xyz - some.at @ position)[:, :, :2], 2, 0)
        sine, cosine = np.sin(phase), np.cos(phase)
        beside, far = east * sine - north * cosine, east * cosine + north * sine
        angle = np.abs(np.arctan2(beside, far))
        off = float(np.median(angle))
        columns = (-sine[..., None], cosine[..., None], far[..., None])
        rows = np.concatenate([column * some.at for column in columns], axis=2)
        weight = _weights(angle, off) / np.maximum(np.abs(far), MIN_WEIGHED_M)
        change, constant = _solve(rows, far, -beside, weight)
        position[:, 0] += change[:count]
        position[:, 1] += change[count : 2 * count]
        phase = phase + some.at @ change[2 * count :] + constant[:, None]
        if np.abs(change).max() < CONVERGED:
            break
    return position, off


def _level(some: _Some, position: Floats) -> tuple[Floats, Floats]:
    """Fit the height of the sensor at each moment (K,), and the direction that is up for it."""
    count = len(position)
    about = (some.xyz - some.at @ position)[:, :, :2]
    flat = np.sqrt((about**2).sum(axis=2))
    far = np.maximum(flat, MIN_WEIGHED_M)
    rows, weight = np.concatenate([some.at, about], axis=2), 1.0 / far
    height = some.xyz[:, :, 2]
    found = np.zeros(count + 2)
    for _ in range(FITS):
        before = found
        found, slope = _solve(rows, flat, height, weight)
        angle = np.abs(height - rows @ found - slope[:, None] * flat) / far
        weight = _weights(angle, float(np.median(angle))) / far
        if np.abs(found - before).max() < CONVERGED:
            break
    return found[:count], np.array([-found[count], -found[count + 1], 1.0])


def _weights(angle: Floats, typical: float) -> Floats:
    """Let points that are far off count less (Huber); the square root of their weights."""
    least = np.finfo(float).tiny
    weight: Floats = np.sqrt(np.minimum(1.0, HUBER * typical / np.maximum(angle, least)))
    return weight


def _solve(rows: Floats, own: Floats, value: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Solve for U unknowns of all rings, and one of each: rows (R, S, U), own and value (R, S)."""
    rows, own, value = rows * weight[..., None], own * weight, value * weight
    size = np.maximum((own**2).sum(axis=1), np.finfo(float).tiny)
    shared = np.einsum('rs,rsu->ru', own, rows) / size[:, None]
    alone = (own * value).sum(axis=1) / size
    left = (rows - own[..., None] * shared[:, None]).reshape(-1, rows.shape[2])
    square = left.T @ left
    square[np.diag_indices(len(square))] += RIDGE * np.trace(square) + np.finfo(float).tiny
    found = np.linalg.solve(square, left.T @ (value - own * alone[:, None]).ravel())
    return found, alone - shared @ found
