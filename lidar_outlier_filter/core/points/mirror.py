# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The period of a profile scanner's mirror, recovered from times and positions alone.

At the right lag T, p(t) and p(t + T) lie on the same profile, a step of the vehicle apart, in the
map's frame as in the sensor's; at any other lag they lie somewhere else. The smallest lag at which
the median distance is about the least is the period. Where the sky or a blind sector leaves gaps,
folding the times at the period makes them coincide, which refines it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints

STRETCH_NS = 200_000_000  # of sensor time that decides
MIN_PERIOD_NS, MAX_PERIOD_NS = 1_500_000, 120_000_000
MIN_TURNS = 2.5  # of the stretch: fewer turns show no period
MIN_TURN_RETURNS = 24  # of a turn: fewer are no profile
LAG_RATIO = 1.002  # of neighbouring lags that are tried
SAMPLE_POINTS, ROUGH_SAMPLE_POINTS = 800, 160  # points that show how far apart two turns are
MIN_PAIRS = 40  # of them, with a return one lag later
MAX_BESIDE_SHOTS = 1.5  # shots between a sample's time, one lag later, and the return there
MAX_RESEMBLANCE = 0.3  # median distance at the period ÷ that at a typical lag
AS_NEAR = 1.5  # a lag whose distance is this many times the least may be the period
DIP_WIDTH = 0.03  # relative: so near, the lag of less distance is the better one
FLOOR_M = 0.01  # of distances that are compared: noise of ranges
MULTIPLES = 12  # a lag may be so many periods: a scanner that stands sees all of them alike
INTERLEAVED_SHOTS = 160  # shots in which those of one beam recur, where several beams take turns
FOLD_BINS = 128  # of a turn
FOLD_WIDTH = 0.006  # relative: how far folding may move the period to either side
TRIED_PERIODS = 121  # periods that are tried there
JUMP_STEPS = 5.0  # times the usual step: there the beam jumps
FACET_BINS = 128  # of a turn, one of which has the jump from one facet to the next
MIN_FACET_SHARE = 0.9  # of the turns have it
MIN_JUMP_SHARE = 0.3  # of the usual jump: what is less is none
GAP_BINS = 32  # of a turn, in which gaps are sought
GAP_SHARE = 0.5  # of the usual returns in a bin: fewer are a gap
REVERSAL_PHASES = 96  # phases of a turn, half of it, at which a mirror that swings may reverse
MAX_MIRRORED = 0.3  # median distance of points as long before and after a reversal ÷ their way


class Mirror(NamedTuple):
    """How the mirror of a profile scanner turns.

    Attributes
    ----------
    period : float
        Of a turn, nanoseconds; of a mirror that swings, from one end to the other.
    begin : int
        When some turn begins, nanoseconds: where few shots have a return, to cut no surface; of a
        mirror that swings, where it goes back.
    resemblance : float
        Median distance of points one turn apart ÷ that at a typical lag: far below 1.
    jump : float
        Of a mirror with facets, least distance of the last point of one from the first of the next,
        metres: the beam jumps back there, and a facet counts as a turn. 0: it has none.
    swings : bool
        Whether it swings to and fro: each way counts as a turn.

    """

    period: float
    begin: int
    resemblance: float
    jump: float = 0.0
    swings: bool = False

    @property
    def rate(self) -> float:
        """Turns per second."""
        return 1e9 / self.period

    @property
    def text(self) -> str:
        """The rate, and what it is of."""
        return f'{self.rate:.2f} {"swings" if self.swings else "turns"}/s, from time and geometry'


def find_mirror(t: Ints, xyz: Floats, period: float = 0.0) -> Mirror | None:
    """Find the period of the mirror; None where points do not show one.

    Parameters
    ----------
    t : (N,) int64
        Nanoseconds, ascending.
    xyz : (N, 3) float64
        Of the returns, metres, in the map's frame or in the sensor's.
    period : float
        Where it is known, nanoseconds; 0: it is sought.

    """
    if period > 0.0:
        return Mirror(period, int(t[0]) + round(_gap(t, period)), 0.0) if len(t) else None
    if len(t) < MIN_TURN_RETURNS * MIN_TURNS or not is_path(xyz):
        return None
    elapsed = np.diff(t)
    step = float(np.median(elapsed[elapsed > 0])) if (elapsed > 0).any() else 0.0
    least = max(MIN_PERIOD_NS, MIN_TURN_RETURNS * step)
    most = min(MAX_PERIOD_NS, float(t[-1] - t[0]) / MIN_TURNS)
    if not step > 0 or not least < most:
        return None
    pairs = _Pairs(t, xyz, step)
    count = int(np.log(most / least) / np.log(LAG_RATIO)) + 1
    lags = np.rint(least * LAG_RATIO ** np.arange(count))
    apart = pairs.apart(lags, ROUGH_SAMPLE_POINTS)
    known = np.isfinite(apart)
    typical = float(np.median(apart[known])) if known.any() else 0.0
    near = min(FLOOR_M + 2.0 * float(apart.min()), MAX_RESEMBLANCE * typical)
    refined = [_refine(pairs, lag) for lag in _dips(lags, apart, near)]
    if not refined:
        return None
    period, distance = _least_lag(pairs, refined, least)
    if not typical > 0.0 or distance > MAX_RESEMBLANCE * typical:
        return None
    mirror = Mirror(period, int(t[0]), distance / typical)
    return _find_reversals(pairs, mirror) or _find_begin(t, xyz, mirror)


def _find_reversals(pairs: '_Pairs', mirror: Mirror) -> Mirror | None:
    """Return the mirror as one that swings, if the beam comes back as it went; else None.

    It reverses twice in what was found to be a turn, half of it apart.
    """
    period = mirror.period
    tried = period * np.arange(REVERSAL_PHASES) / (2 * REVERSAL_PHASES)
    for width in (1.0, 1.0 / 8.0):
        apart = np.array([pairs.mirrored(at, period / 2.0) for at in tried])
        best = int(apart.argmin())
        if not apart[best] <= MAX_MIRRORED:
            return None
        at = float(tried[best])
        tried = at + period / (2 * REVERSAL_PHASES) * width * np.linspace(-1.0, 1.0, 17)
    return Mirror(period / 2.0, int(pairs.t[0]) + round(at), mirror.resemblance, swings=True)


def _find_begin(t: Ints, xyz: Floats, mirror: Mirror) -> Mirror:
    """Return the mirror with its exact period, and with a turn that cuts no surface."""
    counts = fold(t, mirror.period, GAP_BINS)
    if counts.min() > GAP_SHARE * np.median(counts):  # returns at all angles
        return _find_facets(t, xyz, mirror)
    period = _fold_best(t, mirror.period)
    return Mirror(period, int(t[0]) + round(_gap(t, period)), mirror.resemblance)


def _least_lag(
    pairs: '_Pairs', refined: list[tuple[float, float]], least: float
) -> tuple[float, float]:
    """Return the smallest lag whose points are about as near as any, and their distance."""
    limit = AS_NEAR * min(distance for _, distance in refined) + FLOOR_M
    period = min(one for one in refined if one[1] <= limit)[0]
    beside = [one for one in refined if abs(one[0] - period) <= DIP_WIDTH * period]
    period, distance = min(beside, key=lambda one: one[1])
    for parts in range(MULTIPLES, 1, -1):
        if period / parts >= least:
            part, its = _refine(pairs, period / parts)
            if its <= AS_NEAR * distance + FLOOR_M:
                return part, its
    return period, distance


def is_path(xyz: Floats) -> bool:
    """Return whether each point lies beside the one before it: of one beam, not of several."""
    return count_beams(xyz) == 1


def count_beams(xyz: Floats) -> int:
    """Count the beams that take turns, of points in order of time: the lag of least distance."""
    most = min(INTERLEAVED_SHOTS, len(xyz) - MIN_PAIRS)
    if most <= 1:
        return 1
    lags = np.arange(1, most)
    some = np.arange(SAMPLE_POINTS) * (len(xyz) - lags[:, None]) // SAMPLE_POINTS
    away = np.sqrt(((xyz[some + lags[:, None]] - xyz[some]) ** 2).sum(axis=2))
    return 1 + int(np.median(away, axis=1).argmin())


def nearest_returns(
    t: Ints, begin: Ints | int, elapsed: Floats, reach: float
) -> tuple[Ints, Bools]:
    """Return which returns are nearest to some times, and whether they are within reach; ns.

    ``t`` (N,) ascends, and has at least one time; times are so much ``elapsed`` since others.
    """
    when = begin + np.rint(elapsed).astype(np.int64)
    after = np.minimum(np.searchsorted(t, when), len(t) - 1)
    before = np.maximum(after - 1, 0)
    found: Ints = np.where(when - t[before] <= t[after] - when, before, after)
    return found, np.abs(t[found] - when) <= reach


class _Pairs:
    """Some points, and where their beam pointed one lag later."""

    def __init__(self, t: Ints, xyz: Floats, step: float) -> None:
        self.t, self.xyz, self.reach = t, xyz, MAX_BESIDE_SHOTS * step

    def apart(self, lags: Floats, samples: int = SAMPLE_POINTS) -> Floats:
        """Return the median distance (L,), metres, of points one lag (ns) apart; inf: too few."""
        found = [self._apart(some, samples) for some in np.array_split(lags, -(-len(lags) // 64))]
        return np.concatenate(found)

    def mirrored(self, at: float, swing: float) -> float:
        """Return how far apart points are as long before as after reversals, beside their way.

        The median distance ÷ that of points from where the beam reverses; inf: too few show it.
        Where that has no return, the way is that of points any time apart.

        One reversal is ``at`` so long after the first return, others before and after it by whole
        times of a ``swing``; both ns.
        """
        some = np.arange(SAMPLE_POINTS) * len(self.t) // SAMPLE_POINTS
        after = (self.t[some] - self.t[0] - at) % swing
        (end, reached), (other, there) = (
            nearest_returns(self.t, self.t[some], -times * after, self.reach) for times in (1, 2)
        )
        if np.count_nonzero(there) < MIN_PAIRS:
            return np.inf
        end = np.where(reached, end, np.roll(some, SAMPLE_POINTS // 3))
        apart, way = (
            float(np.median(np.sqrt(((self.xyz[some] - self.xyz[one]) ** 2).sum(axis=1)[there])))
            for one in (other, end)
        )
        return apart / max(way, FLOOR_M)

    def _apart(self, lags: Floats, samples: int) -> Floats:
        t, xyz = self.t, self.xyz
        last = np.searchsorted(t, t[-1] - lags, side='right')
        some = np.arange(samples) * last[:, None] // samples
        other, there = nearest_returns(t, t[some], lags[:, None], self.reach)
        away = np.sqrt(((xyz[other] - xyz[some]) ** 2).sum(axis=2))
        count = np.count_nonzero(there, axis=1)
        away = np.sort(np.where(there, away, np.inf), axis=1)
        median = np.take_along_axis(away, np.minimum(count // 2, samples - 1)[:, None], axis=1)[
            :, 0
        ]
        return np.where(count >= max(MIN_PAIRS, samples // 4), median, np.inf)


def _dips(lags: Floats, apart: Floats, near: float) -> Floats:
    """Return the lags of local minima not farther apart than ``near``, and much less than before.

    Without a turn, the longer the lag, the farther apart are points.
    """
    padded = np.concatenate([[0.0], apart, [0.0]])
    low = (padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:]) & (apart <= near)
    before = np.maximum.accumulate(np.where(np.isfinite(apart), apart, 0.0))
    return lags[low & (apart <= MAX_RESEMBLANCE * before)]


def _refine(pairs: _Pairs, lag: float) -> tuple[float, float]:
    """Return the lag, whole shots away, of the least distance nearby, and that distance."""
    reach: Floats = np.arange(-6.0, 7.0) * ((LAG_RATIO - 1.0) * lag / 4.0)
    least = np.inf
    for around in (reach, reach / 6.0):
        apart = pairs.apart(lag + around)
        lag, least = float(lag + around[apart.argmin()]), float(apart.min())
    return lag, least


def fold(t: Ints, period: float, bins: int = FOLD_BINS) -> NDArray[np.int64]:
    """Count the returns in each bin of a turn, from the first return on."""
    phase = (t - t[0]) / period
    return np.bincount(((phase - np.floor(phase)) * bins).astype(np.int64) % bins, minlength=bins)


def _fold_best(t: Ints, period: float) -> float:
    """Return the period near one at which gaps coincide best."""
    width = min(FOLD_WIDTH, period / float(t[-1] - t[0]))
    tried = period * (1.0 + width * np.linspace(-1.0, 1.0, TRIED_PERIODS))
    # Epoch folding (Leahy et al. 1983): the counts differ most where the period is right.
    power = np.array([(fold(t, one) ** 2).sum() for one in tried])
    good = np.flatnonzero(power >= power.max() - 0.02 * (power.max() - power.min()))
    return float(tried[good].mean())


def _find_facets(t: Ints, xyz: Floats, mirror: Mirror) -> Mirror:
    """Find where the beam jumps back in each turn; return the mirror as it is if it never does."""
    step = np.sqrt((np.diff(xyz, axis=0) ** 2).sum(axis=1))
    jumps = np.flatnonzero(step > JUMP_STEPS * np.median(step))
    begin = Mirror(mirror.period, int(t[0]) + round(_gap(t, mirror.period)), mirror.resemblance)
    if not len(jumps):
        return begin
    best = 0, 0.0, np.empty(0, np.int64)
    for period in mirror.period * (1.0 + FOLD_WIDTH * np.linspace(-1.0, 1.0, TRIED_PERIODS)):
        turned = (t[jumps + 1] - t[0]) / period
        place = ((turned - np.floor(turned)) * FACET_BINS).astype(np.int64) % FACET_BINS
        count = np.bincount(place, minlength=FACET_BINS)
        there = int(count.argmax())
        if count[there] > best[0]:
            best = int(count[there]), float(period), jumps[place == there]
    _, period, ends = best
    turns = float(t[-1] - t[0]) / period
    if len(np.unique(np.rint((t[ends + 1] - t[ends[0] + 1]) / period))) < MIN_FACET_SHARE * turns:
        return begin
    jump = float(np.median(step[ends])) * MIN_JUMP_SHARE
    return Mirror(period, int(t[ends[0] + 1]), mirror.resemblance, jump)


def _gap(t: Ints, period: float) -> float:
    """Return when a turn should begin, ns after the first return: amid the widest gap."""
    counts = fold(t, period).astype(np.float64)
    # The emptier around, the better: weights fall to 0 a quarter of a turn away.
    reach = FOLD_BINS // 4
    weights = (reach - np.abs(np.arange(1 - reach, reach))).astype(np.float64)
    around = np.concatenate([counts[-reach + 1 :], counts, counts[: reach - 1]])
    full = np.convolve(around, weights, 'valid')
    return float((int(full.argmin()) + 0.5) / FOLD_BINS * period)
