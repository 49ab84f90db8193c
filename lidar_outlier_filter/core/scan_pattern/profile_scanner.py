# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where a profile scanner was, and the angle of its mirror, as its points show them.

The mirror turns evenly, or it swings in each line, evenly or as a pendulum. So the angle of each
shot is known from its time, up to a constant; and seen from the scanner, all points of a line are
where these angles say, however far they are. How far a mirror swings is tried: the best fit counts.
The scanner's position then shows which way it swings in a line.

With x and y in the plane of a line, the scanner at s and a mirror angle φ + δ, each point says

    (x - s_x) sin(φ + δ) = (y - s_y) cos(φ + δ)

which is linear in sin δ, cos δ and two products of them with s.

The first returns of lines drift with what is scanned, and so does a period taken from them. But a
period that is wrong turns δ by as much in each line: that corrects it. The positions of lines show
the velocity of the scanner, by which points of a line are moved to where they would be if it stood.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

SAMPLE_RETURNS = 64  # returns of a line that show where the scanner is
MIN_RETURNS = 32  # returns of a line, fewer show nothing
MIN_KNOWN_SHARE = 0.5  # share of the lines whose own returns must show the scanner's position
# Turns after which the drift of a wrong period is measured, one fit after the other.
LAGS = (4, 16)
SURE_SIGMAS = 2.0  # standard deviations: a smaller drift is none
MOTION_LINES = 32  # lines that show one velocity
MAD_TO_SIGMA = 1.4826
# Steps of the mirror that a typical return may be off its angle: of a mirror that swings, or turns.
MAX_OFF_SWING_STEPS, MAX_OFF_STEPS = 0.5, 1.0
# From so many on, the position shows angles better than times do, unless it is this far off, rad.
GEOMETRIC_FROM_STEPS, MAX_GEOMETRIC_RAD = 0.15, 0.2
MAX_OFF_PLANE_RAD = 0.02  # rad that a typical return of a typical line may be off its plane
MAX_SIGMA_M = 0.2  # m: standard deviation of the scanner's position
POSITION_PARTS = 1024.0  # of a metre, and of m/s, that positions and velocities are rounded to
PERIOD_PARTS = 16.0  # parts of a nanosecond that the period is rounded to
EVENLY = np.arange(SAMPLE_RETURNS) / SAMPLE_RETURNS  # of a line
UNEVENLY = (np.arange(SAMPLE_RETURNS) + np.arange(SAMPLE_RETURNS) * 0.618 % 1.0) / SAMPLE_RETURNS
LINES_AT_ONCE = 256  # that a thread fits
# Rad to either side that are tried, and then those between the two beside the best. From the air a
# mirror swings less: there trees on the neighbours, which know such clouds, judge better.
SWINGS = np.geomspace(0.8, 2.5, 25)
SWING_LINES = 5  # the longest ones show how far a mirror swings
ANGLE_PARTS = 2.0**30  # parts of a rad that angles of a swing are rounded to


class Scanner(NamedTuple):
    """Where a profile scanner was.

    Attributes
    ----------
    position : (L, 3) float64
        Of each line, metres.
    turned : (N,) float64
        Mirror angle of each point, sorted by line and time, since the same constant, rad.
    moved : (N, 3) float64
        How far the scanner was from the position of its line, metres.

    """

    position: Floats
    turned: Floats
    moved: Floats


class TimedLines(NamedTuple):
    """N points of L lines.

    Attributes
    ----------
    xyz : (N, 3) as given, metres
    t : (N,) of points in order, nanoseconds
    order : (N,) by line and time
    first : (L + 1,) where lines begin
    rank : (L,) the order of the lines in time

    """

    xyz: Floats
    t: Ints
    order: Ints
    first: Ints
    rank: Ints

    @property
    def sizes(self) -> Ints:
        """Count the returns of each line."""
        return self.first[1:] - self.first[:-1]

    @property
    def begins(self) -> Ints:
        """Return when lines begin, nanoseconds, in the order of time."""
        return self.t[self.first[:-1]][self.rank]

    @property
    def ends(self) -> Ints:
        """Return when lines end, nanoseconds, in the order of time."""
        return self.t[self.first[1:] - 1][self.rank]

    def indices(self, part: Floats) -> Ints:
        """Return where the returns at some parts (S,) of each line are in order (L, S)."""
        return self.first[:-1, None] + (part * self.sizes[:, None]).astype(np.int64)


class Fit(NamedTuple):
    """The scanner's position, as some returns of each of L lines show it.

    Attributes
    ----------
    position : (L, 3) float64
        Metres.
    off : (L,) float64
        Median angle between a return and where the mirror pointed, rad; infinite where the returns
        all lie where the scanner is.
    unsure : (L,) float64
        Standard deviation of the position, metres.
    beam : (L, 2, 3) float64
        Directions of the mirror at angles 0 and π/2.

    """

    position: Floats
    off: Floats
    unsure: Floats
    beam: Floats


class _Mirror(NamedTuple):
    """How the mirror of a scanner turned, and how that moved.

    Attributes
    ----------
    angle : (N,) of shots, rad
    since : (N,) from the middle of a turn to each shot, ns
    step : the usual angle between shots, rad
    turns : (L,) the turn of each line
    velocity : (L, 3) m/s
    swings : whether it may go back

    """

    angle: Floats
    since: Floats
    step: float
    turns: Floats
    velocity: Floats
    swings: bool


def find_scanner(lines: TimedLines, threads: int = 0) -> Scanner | None:
    """Estimate where the scanner was; None where the points do not determine it.

    ``threads``: maximum number of threads; 0: all cores.
    """
    if np.count_nonzero(lines.sizes >= MIN_RETURNS) < MIN_KNOWN_SHARE * len(lines.sizes):
        return None
    for find in (_turning_mirror, _swinging_mirror):
        mirror = find(lines, threads)
        scanner = None if mirror is None else _locate(lines, mirror, threads)
        if scanner is not None:
            return scanner
    return None


def _turning_mirror(lines: TimedLines, threads: int) -> _Mirror | None:
    """Return the angles of a mirror that turns once in a line."""
    # Where points are cut out of a stream, the first line begins late, and the last one ends early.
    elapsed = np.sort(np.concatenate([np.diff(lines.begins), np.diff(lines.ends)]))
    period, velocity = float(elapsed[len(elapsed) // 2]), np.zeros((len(lines.rank), 3))
    some = lines.indices(EVENLY)
    for lag in LAGS:
        if not period > 0.0:
            return None
        turns = _turns(lines, period)
        since = _since(lines, some, turns[:, None], period)
        fit = fit_all(
            still(lines, some, since, velocity[:, None]), since * (TURN / period), threads
        )
        known = _shown(lines, fit)
        period *= 1.0 - _drift(fit.beam[known], turns[known], lag) / TURN
        period = float(np.rint(period * PERIOD_PARTS) / PERIOD_PARTS)
        velocity = velocities(fit.position[known], turns[known], turns, period)
    turns = _turns(lines, period)
    since = _since(lines, slice(None), np.repeat(turns, lines.sizes), period)
    turned, step = since * (TURN / period), _usual_step(lines) * (TURN / period)
    return _Mirror(turned - turned.min(), since, step, turns, velocity, swings=False)


def _drift(beam: Floats, turns: Floats, lag: int) -> float:
    """Return how far the mirror is ahead of its angle after each turn, rad; 0 if that is not sure.

    ``beam`` (L, 2, 3) are the directions of angles 0 and π/2 in lines, in order of time.
    """
    lag = min(lag, len(turns) // 2)
    if lag == 0:
        return 0.0
    (here, onward), there = np.moveaxis(beam[:-lag], 1, 0), beam[lag:, 0]
    ahead = np.arctan2((there * onward).sum(axis=1), (there * here).sum(axis=1))
    ahead /= turns[lag:] - turns[:-lag]
    drift = median_of(ahead)
    unsure = MAD_TO_SIGMA * median_of(np.abs(ahead - drift)) / np.sqrt(len(ahead))
    return drift if abs(drift) > SURE_SIGMAS * unsure else 0.0


def velocities(position: Floats, when: Floats, turns: Floats, period: float) -> Floats:
    """Return the velocity (L, 3) at turns (L,), m/s, by positions (K, 3) at some of them."""
    second = period / SECOND
    found, middle = [], []
    for begin in range(0, max(len(when) - MOTION_LINES // 2, 1), MOTION_LINES):
        # The last stretch is the longest, rather than too short to show anything.
        end = begin + MOTION_LINES
        part = slice(begin, end if end + MOTION_LINES // 2 < len(when) else None)
        at, time = position[part], when[part] * second
        lag = len(at) // 2
        if lag > 0:
            speed = (at[lag:] - at[:-lag]) / (time[lag:] - time[:-lag])[:, None]
            found.append(np.median(speed, axis=0))
            middle.append(float(time.mean()))
    if not found:
        return np.zeros((len(turns), 3))
    columns = [np.interp(turns * second, middle, column) for column in zip(*found, strict=True)]
    return np.rint(np.stack(columns, axis=1) * POSITION_PARTS) / POSITION_PARTS


def still(lines: TimedLines, some: Any, since: Floats, velocity: Floats) -> Floats:
    """Return where some returns would be, had the scanner been where it is amid their turns."""
    moved: Floats = lines.xyz[lines.order[some]] - velocity * (since / SECOND)[..., None]
    return moved


def _shown(lines: TimedLines, fit: Fit) -> Ints:
    """Return the lines that show the scanner's position, in order of time."""
    shown = (lines.sizes >= MIN_RETURNS) & np.isfinite(fit.off)
    return lines.rank[shown[lines.rank]]


def _swinging_mirror(lines: TimedLines, threads: int) -> _Mirror | None:
    """Return the angles of a mirror that swings once in a line, as if always the same way."""
    # Where one end has no returns, every second line begins late.
    period = median_of(lines.begins[2:] - lines.begins[:-2]) / 2.0
    if not period > 0.0:
        return None
    turns, some = _turns(lines, period), lines.indices(EVENLY)
    since = _since(lines, slice(None), np.repeat(turns, lines.sizes), period)
    xyz = lines.xyz[lines.order[some]]
    longest = np.argsort(-lines.sizes, kind='stable')[:SWING_LINES]
    middle, usual = (since.min() + since.max()) / 2.0, _usual_step(lines)
    for centred in (False, True):
        swung = (since - middle) * (np.pi / period)
        waves = np.sin(swung), swung * (2.0 / np.pi)
        found = [find_swing(xyz[longest], wave[some[longest]]) for wave in waves]
        swing, off = found[k := int(np.argmin([off / swing for swing, off in found]))]
        if off > MAX_OFF_SWING_STEPS * (step := usual * (2.0 * swing / period)):
            return None
        angle = swing * waves[k]
        if centred:
            break
        fit = fit_all(xyz, angle[some], threads)
        # Ahead of its angle one way, the mirror is behind it on the way back.
        ahead = _drift(fit.beam[known := _shown(lines, fit)], turns[known], 1) / 2.0
        if abs(ahead) <= step:  # few lines may show less where there is nothing
            break
        middle += ahead * period / (swing * (np.pi, 2.0)[k])
    angle = np.rint(angle * ANGLE_PARTS) / ANGLE_PARTS
    return _Mirror(angle, since, step, turns, np.zeros((len(turns), 3)), swings=True)


def find_swing(xyz: Floats, wave: Floats, tried: Floats = SWINGS) -> tuple[float, float]:
    """Find how far a mirror swings (L, S) at returns (L, S, 3); and how far off they are, then.

    Both as an angle, rad, as are those ``tried``; the less a mirror swings, the nearer are all
    returns to its angles.
    """
    for _ in range(3):
        angles = (tried[:, None, None] * wave).reshape(-1, SAMPLE_RETURNS)
        fit = fit_lines(np.tile(xyz, (len(tried), 1, 1)), angles)
        off = np.median(fit.off.reshape(len(tried), -1), axis=1) / tried
        k = int(off.argmin())
        swing, least = float(tried[k]), float(off[k])
        tried = np.geomspace(tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)], len(tried))
    return swing, least * swing


def _turns(lines: TimedLines, period: float) -> Floats:
    """Return which turn each line (L,) is."""
    middle = lines.t[lines.first[:-1] + lines.sizes // 2][lines.rank]
    # A line without returns leaves out a turn.
    turns = np.empty(len(lines.rank))
    turns[lines.rank] = np.cumsum([0.0, *np.maximum(np.rint(np.diff(middle) / period), 1.0)])
    return turns


def _since(lines: TimedLines, some: Any, turns: Floats, period: float) -> Floats:
    """Return how long after the middle of their turns some returns are, ns."""
    elapsed = (lines.t[some] - lines.begins[0]).astype(np.float64)
    since: Floats = elapsed - (turns + 0.5) * period
    return since


def median_of(values: NDArray[Any]) -> float:
    """Return the median of values, none of them NaN; 0 of none."""
    return float(np.median(values.astype(np.float64))) if len(values) else 0.0


def _usual_step(lines: TimedLines) -> float:
    """Return the median time between two shots, ns."""
    elapsed = np.diff(lines.t)
    return median_of(elapsed[elapsed > 0])


def fit_lines(xyz: Floats, angle: Floats) -> Fit:
    """Fit the scanner's position to S returns (L, S, 3) of each line, at mirror angles (L, S)."""
    return Fit(*_kernels.fit_lines(xyz, angle))


def fit_all(xyz: Floats, angle: Floats, threads: int) -> Fit:
    """Fit the returns (L, S, 3) of all lines, at mirror angles (L, S)."""
    parts = pool.run(lambda i, j: fit_lines(xyz[i:j], angle[i:j]), len(xyz), LINES_AT_ONCE, threads)
    return Fit(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _locate(lines: TimedLines, mirror: _Mirror, threads: int) -> Scanner | None:
    """Estimate where the scanner was; None where points do not lie at the mirror's angles."""
    rank, velocity, count = lines.rank, mirror.velocity[:, None], len(lines.rank)
    some = lines.indices(EVENLY)
    fit = fit_all(still(lines, some, mirror.since[some], velocity), mirror.angle[some], threads)
    limit = MAX_OFF_SWING_STEPS if mirror.swings else MAX_OFF_STEPS
    good = (
        (fit.off <= limit * mirror.step)
        & (fit.unsure <= MAX_SIGMA_M)
        & (lines.sizes >= MIN_RETURNS)
    )
    if np.count_nonzero(good) < MIN_KNOWN_SHARE * count:
        return None
    # Unevenly taken, because of rings in turn even steps would take always the same one.
    some = lines.indices(UNEVENLY)
    rays = still(lines, some, mirror.since[some], velocity) - fit.position[:, None]
    away = pool.run(
        lambda i, j: _kernels.off_plane(rays[i:j], mirror.angle[some[i:j]]),
        count,
        LINES_AT_ONCE,
        threads,
    )
    if median_of(np.concatenate(away)[good]) > MAX_OFF_PLANE_RAD:
        return None
    known, when = good[rank], mirror.turns[rank]
    found = np.empty((count, 3))
    found[rank] = positions_at(when, when[known], fit.position[rank][known])
    moved = np.repeat(mirror.velocity, lines.sizes, axis=0) * (mirror.since / SECOND)[:, None]
    if not mirror.swings:
        angle = mirror.angle
        if median_of(fit.off[good]) > GEOMETRIC_FROM_STEPS * mirror.step:
            nearest = np.interp(mirror.turns, when[known], np.arange(np.count_nonzero(known)))
            beam = fit.beam[rank[known][np.rint(nearest).astype(np.int64)]]
            angle = _see(lines, found, moved, beam, angle)
        return Scanner(found, angle, moved)
    sense = _sense(lines.xyz[lines.order[lines.indices(EVENLY)]] - found[:, None], rank)
    return Scanner(found, mirror.angle * np.repeat(sense, lines.sizes), moved)


def positions_at(when: Floats, known: Floats, position: Floats) -> Floats:
    """Return where the scanner was (L, 3) at some times, by the positions (K, 3) at others."""
    found = np.stack([np.interp(when, known, column) for column in position.T], axis=1)
    rounded: Floats = np.rint(found * POSITION_PARTS) / POSITION_PARTS
    return rounded


def _see(lines: TimedLines, position: Floats, moved: Floats, beam: Floats, angle: Floats) -> Floats:
    """Return the angle (N,) at which the scanner sees each return; ``angle`` where that is far off.

    ``beam`` (L, 2, 3) are the directions of angles 0 and π/2 in lines.
    """
    sizes = lines.sizes
    rays = lines.xyz[lines.order] - moved - np.repeat(position, sizes, axis=0)
    here, onward = ((rays * np.repeat(beam[:, k], sizes, axis=0)).sum(axis=1) for k in range(2))
    off = np.arctan2(onward, here) - angle
    off -= TURN * np.rint(off / TURN)
    seen = angle + np.where(np.abs(off) < MAX_GEOMETRIC_RAD, off, 0.0)
    rounded: Floats = np.rint(seen * ANGLE_PARTS) / ANGLE_PARTS
    return rounded


def _sense(xyz: Floats, rank: Ints) -> Floats:
    """Return which way the mirror turns in each line, 1 or -1, by its returns (L, S, 3)."""
    ray = xyz / np.maximum(np.sqrt((xyz**2).sum(axis=2, keepdims=True)), _kernels.MIN_RANGE_M)
    axis = np.cross(ray[:, :-1], ray[:, 1:]).sum(axis=1)[rank]
    sense = np.ones(len(rank))
    sense[rank[1:]] = np.cumprod(np.where((axis[1:] * axis[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    return sense
