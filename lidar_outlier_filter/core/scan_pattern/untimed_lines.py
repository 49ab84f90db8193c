# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where a profile scanner was whose times do not tell the angles of its shots.

Where hundreds of shots share a time, their order is known, and most follow each other without a
miss. So the angles of a tick's returns are known up to their beginning and their step, which is
tried: the step by which all ticks fit best. The positions that ticks show then tell the angle of
each return as it is seen from there.
"""

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.scan_pattern.profile_scanner import (
    ANGLE_PARTS,
    EVENLY,
    MAX_OFF_SWING_STEPS,
    MAX_SIGMA_M,
    MIN_KNOWN_SHARE,
    Fit,
    Scanner,
    TimedLines,
    find_swing,
    fit_all,
    positions_at,
    still,
    velocities,
)
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

MAX_TICKS = 8  # of a line: with more, times tell angles
MIN_PART_RETURNS, MAX_PART_RETURNS = 64, 256  # of a part of a tick that shows a position
HALVES = np.geomspace(0.25, 2.0, 24)  # rad of half a part, which are tried
NEAR_SWING = np.geomspace(0.98, 1.02, 7)  # times that, in the second round
MAX_UNSURE = 4.0  # times the usual standard deviation of a position
STEP_PARTS = 21  # the longest ones show the step
ROUNDS = 2  # fits: the first shows the velocity
MAX_STEP_OFF = 0.25  # median difference of two angles in succession from the step, ÷ step


def find_by_order(lines: TimedLines, time: Ints, threads: int = 0) -> Scanner | None:
    """Estimate where the scanner was by the order of its shots; None where points do not show it.

    Parameters
    ----------
    lines : whose times are spread
    time : (N,) of points in order as the clock tells it, nanoseconds
    threads : maximum number of threads; 0: all cores

    """
    begins = np.append([True], time[1:] != time[:-1])
    begins[lines.first[:-1]] = True
    count = len(lines.rank)
    if np.count_nonzero(begins) > MAX_TICKS * count:
        return None
    first = _part(begins)
    long = np.flatnonzero(np.diff(first) >= MIN_PART_RETURNS)
    if len(long) < MIN_KNOWN_SHARE * count:
        return None
    place = np.arange(len(time)) - np.repeat(first[:-1], np.diff(first))
    size = np.diff(first)[long]
    some = first[long][:, None] + (EVENLY * size[:, None]).astype(np.int64)
    at = place[some] - size[:, None] / 2.0
    line = np.searchsorted(lines.first, some, side='right') - 1
    middle = (lines.t[lines.first[:-1]] + lines.t[lines.first[1:] - 1]) // 2
    since = (lines.t - np.repeat(middle, lines.sizes)).astype(np.float64)
    when = (middle - middle.min()) / SECOND
    velocity = np.zeros((count, 3))
    usual, tried = float(np.median(size)) / 2.0, HALVES
    for _ in range(ROUNDS):
        xyz = still(lines, some, since[some], velocity[line])
        longest = np.argsort(-size, kind='stable')[:STEP_PARTS]
        swing, _ = find_swing(xyz[longest], at[longest] / usual, tried)
        step, tried = swing / usual, swing * NEAR_SWING
        fit = fit_all(xyz, at * step, threads)
        good = (fit.off <= MAX_OFF_SWING_STEPS * step) & (fit.unsure <= MAX_SIGMA_M)
        if np.count_nonzero(good) < MIN_KNOWN_SHARE * count:
            return None
        known = _surest(fit, np.flatnonzero(good), line[:, 0])
        known = known[np.argsort(when[line[known, 0]], kind='stable')]
        if not (np.diff(when[line[known, 0]]) > 0).all():
            return None  # time does not pass
        velocity = velocities(fit.position[known], when[line[known, 0]], when, SECOND)
    position = positions_at(when, when[line[known, 0]], fit.position[known])
    moved = np.repeat(velocity, lines.sizes, axis=0) * (since / SECOND)[:, None]
    rays = lines.xyz[lines.order] - moved - np.repeat(position, lines.sizes, axis=0)
    turned = _see(lines, rays, fit, known)
    follows = np.flatnonzero(~begins)
    off = np.abs(turned[follows] - turned[follows - 1] - step)
    if not float(np.median(off)) <= MAX_STEP_OFF * step:
        return None
    return Scanner(position, turned, moved)


def _part(begins: Bools) -> Ints:
    """Part ticks (N,) evenly where they are long: a miss spoils the part of a tick it is in.

    Return where parts begin, then the number of points.
    """
    first = np.append(np.flatnonzero(begins), len(begins))
    size = np.diff(first)
    parts = -(-size // MAX_PART_RETURNS)
    part = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = part * np.repeat(size, parts) // np.repeat(parts, parts)
    return np.append(np.repeat(first[:-1], parts) + inner, len(begins))


def _surest(fit: Fit, good: Ints, line: Ints) -> Ints:
    """Choose of the good parts of each line the surest, and leave out lines without a sure one."""
    order = good[np.lexsort((fit.unsure[good], line[good]))]
    best = order[np.append([True], line[order[1:]] != line[order[:-1]])]
    sure: Ints = best[fit.unsure[best] <= MAX_UNSURE * np.median(fit.unsure[best])]
    return sure


def _see(lines: TimedLines, rays: Floats, fit: Fit, known: Ints) -> Floats:
    """Return the angle (N,) at which the scanner sees each return; it rises along lines."""
    axes = np.cross(fit.beam[known, 0], fit.beam[known, 1])
    axis = np.median(axes, axis=0)
    axis /= np.sqrt((axis**2).sum())
    here = fit.beam[known[0], 0]
    here = here - (here * axis).sum() * axis
    here /= np.sqrt((here**2).sum())
    angle = np.arctan2((rays * np.cross(axis, here)).sum(axis=1), (rays * here).sum(axis=1))
    first = lines.first[:-1]
    # The first returns of lines are near each other, and others follow them.
    start = np.arctan2(np.median(np.sin(angle[first])), np.median(np.cos(angle[first])))
    step = np.diff(angle, prepend=start)
    step[first] = angle[first] - start
    step -= TURN * np.rint(step / TURN)
    total = np.cumsum(step)
    turned = total - np.repeat((total - step)[first], lines.sizes)
    rounded: Floats = np.rint((turned - turned.min()) * ANGLE_PARTS) / ANGLE_PARTS
    return rounded
