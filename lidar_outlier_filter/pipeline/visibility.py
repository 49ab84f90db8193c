# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""View of a sensor: rejected and missing returns by sector and range, and the visibility.

The usual returns of a sector are learnt at run time: dirt or fog that is present at the start is
not detected.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Bools, Floats, Ints
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.parameters.node import HealthLimits

SECTORS = 24  # from the x axis on, against the clock
BANDS = (0.0, 5.0, 15.0, 30.0)  # metres: begin there
MAX_RINGS = 1024
STEP, STEPS = 1.15, 45  # ranges from 1 m on, each so many times the one before
MIN_SAMPLES = 10  # before anything is usual
MEMORY = 60.0  # samples that the usual counts are the mean of
MIN_RETURNS = 3.0  # of a ring in a sector and a cloud, to say anything
STEADY = 0.15  # of the returns: a ring whose number changes by less in a sector always returns
LOST = 0.05  # of all returns: where less is missing, only the scene has changed
GONE = 0.3  # of the usual returns are left beyond a range, where surfaces vanish
MIN_SHARE_BEYOND = 0.003  # of the returns are usually beyond a range, to say anything
# The contrast that is left at the visibility is 5 % (Koschmieder).
CONTRAST = -math.log(0.05)


@dataclass(frozen=True)
class SensorView:
    """One sample of the sensor's view.

    Attributes
    ----------
    rejected : (SECTORS, BANDS) float64
        Share of the points there; NaN without points.
    no_return : (SECTORS,) float64
        Share of the sector's usual returns that are missing; NaN if unknown.
    visibility : float
        Metres; inf if it is not reduced, NaN if the usual returns are not known yet.

    """

    rejected: Floats
    no_return: Floats
    visibility: float

    def complaints(self, limits: HealthLimits) -> list[str]:
        """Say which sectors are blind, and that the visibility falls."""
        found = []
        haze = 0.0
        if self.visibility < limits.visibility:
            found.append(f'the visibility is {self.visibility:.0f} m')
            haze = _usual_share(self.no_return)
        blind = np.flatnonzero(self.no_return - haze > limits.blind)
        if len(blind):
            where = ', '.join(sector_name(sector) for sector in blind.tolist())
            found.append(f'no return where there usually is one: dirt on the window at {where}?')
        return found

    def values(self) -> dict[str, str]:
        """Return all values by name, for /diagnostics."""
        found = {'visibility, m': f'{self.visibility:.0f}'}
        for sector in range(SECTORS):
            name = sector_name(sector)
            found[f'missing at {name}'] = f'{100 * self.no_return[sector]:.1f} %'
            shares = ', '.join(f'{100 * share:.1f} %' for share in self.rejected[sector].tolist())
            found[f'rejected at {name}, from {", ".join(f"{b:g}" for b in BANDS)} m'] = shares
        return found

    def plotted(self) -> tuple[float, ...]:
        """Return the values of ``VIEWED``."""
        rejected = self.rejected.reshape(-1).tolist()
        return (self.visibility, *self.no_return.tolist(), *rejected)


def sector_name(sector: int) -> str:
    """Name a sector by its azimuths."""
    width = 360 // SECTORS
    return f'{sector * width}° to {(sector + 1) * width}°'


# Of one sample, in this order, in the message of its own.
VIEWED = (
    'visibility',
    *(f'missing {sector_name(sector)}' for sector in range(SECTORS)),
    *(
        f'rejected {sector_name(sector)} from {begin:g} m'
        for sector in range(SECTORS)
        for begin in BANDS
    ),
)
UNSEEN = (math.nan,) * len(VIEWED)


class SensorWatch:
    """Counts returns in the filter's thread, and compares them in another."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._lock = threading.Lock()
        self._tally = _ViewTally.nothing(0)
        self._clouds = 0
        self._samples = 0
        self._usual = self._change = np.zeros((0, SECTORS))  # returns of a cloud, and their change
        self._usual_steps = np.zeros((SECTORS, STEPS))

    def add(self, cloud: StreamCloud, *, has_rings: bool) -> None:
        """Count the points of a judged cloud."""
        points = cloud.points.in_own_frame
        line = points.line if has_rings else np.zeros(len(points), np.int64)
        rings = min(int(line.max(initial=-1)) + 1, MAX_RINGS)
        with self._lock:
            self._clouds += 1
            if rings > len(self._tally.kept):
                self._tally = self._tally._replace(kept=_grown(self._tally.kept, rings))
            rejected = cloud.verdict.rejected[cloud.where]
            _kernels.count_view(points.xyz, line, rejected, CELLS, self._tally)

    def sample(self, limits: HealthLimits, *, is_whole: bool = True) -> SensorView | None:
        """Return the view since the last sample; None: no cloud.

        Unless it ``is_whole``, clouds are missing: the sectors that they show would seem dirty. So
        nothing is said of missing returns and of the visibility, and nothing is learnt.
        """
        with self._lock:
            tally, clouds = self._tally, self._clouds
            self._tally, self._clouds = _ViewTally.nothing(len(tally.kept)), 0
        if not clouds:
            return None
        now, steps = tally.kept / clouds, tally.steps / clouds
        now = _grown(now, len(self._usual))
        self._usual, self._change = (_grown(one, len(now)) for one in (self._usual, self._change))
        no_return = self._no_return(now) if is_whole else np.full(SECTORS, math.nan)
        # NaN is no number that is above a limit: sectors that nothing is known of count, too.
        open_ = ~(no_return - _usual_share(no_return) > limits.blind)
        visibility = math.nan
        if is_whole:
            visibility = self._visibility(steps[open_].sum(axis=0), open_)
        with np.errstate(invalid='ignore'):
            view = SensorView(tally.rejected / tally.points, no_return, visibility)
        learns = self._samples < MIN_SAMPLES or not view.complaints(limits)
        if is_whole and now.any() and learns:
            self._learn(now, steps)
        return view

    def _no_return(self, now: Floats) -> Floats:
        """Return the missing share of the usual returns, by sector, over rings that are steady."""
        known = (self._samples >= MIN_SAMPLES) & (self._usual >= MIN_RETURNS)
        steady = known & (self._change <= STEADY * self._usual)
        usual = np.where(steady, self._usual, 0.0).sum(axis=0)
        there = np.where(steady, np.minimum(now, self._usual), 0.0).sum(axis=0)
        return np.where(usual > 0, 1 - there / np.maximum(usual, 1e-9), np.nan)

    def _visibility(self, steps: Floats, open_: Bools) -> float:
        """Estimate the visibility from the range at which surfaces vanish.

        Surfaces vanish where their echo is too weak. An echo weakens with the square of the range;
        fog weakens it further both ways, so that they vanish nearer.
        """
        if self._samples < MIN_SAMPLES or not steps.any():
            return math.nan
        usual = self._usual_steps[open_].sum(axis=0)
        # Without those that only moved from near to far or back.
        if steps.sum() > (1 - LOST) * usual.sum():
            return math.inf
        beyond, before = np.cumsum(steps[::-1])[::-1], np.cumsum(usual[::-1])[::-1]
        vanish = np.flatnonzero(
            (beyond < GONE * before) & (before > MIN_SHARE_BEYOND * usual.sum())
        )
        clear = np.flatnonzero(before > MIN_SHARE_BEYOND * usual.sum())
        if not len(vanish):
            return math.inf
        far, clearly = STEP ** (vanish[0] + 0.5), STEP ** (clear[-1] + 0.5)
        return float(CONTRAST * far / np.log(clearly / far)) if far < clearly else math.inf

    def _learn(self, now: Floats, steps: Floats) -> None:
        """Update the usual counts."""
        weight = 1 / min(self._samples + 1, MEMORY)
        self._samples += 1
        if self._samples > 1:
            self._change = self._change + weight * (np.abs(now - self._usual) - self._change)
        self._usual = self._usual + weight * (now - self._usual)
        self._usual_steps = self._usual_steps + weight * (steps - self._usual_steps)


class _ViewTally(NamedTuple):
    """Counts by sector: points and rejected ones by band; kept ones by ring and by range."""

    points: Ints
    rejected: Ints
    kept: Ints
    steps: Ints

    @classmethod
    def nothing(cls, rings: int) -> _ViewTally:
        """Start with all counts at 0."""
        shapes = (SECTORS, len(BANDS)), (SECTORS, len(BANDS)), (rings, SECTORS), (SECTORS, STEPS)
        return cls(*(np.zeros(shape, np.int64) for shape in shapes))


class _ViewCells(NamedTuple):
    """Where the cells of a tally begin and end."""

    edges: Floats  # of the sectors: unit vectors, the first again at the end
    bands: Floats  # squares of the ranges at which bands begin, but for the first
    ends: Floats  # squares of the ranges at which steps end


CELLS = _ViewCells(
    np.array(
        [
            (math.cos(k * 2 * math.pi / SECTORS), math.sin(k * 2 * math.pi / SECTORS))
            for k in (*range(SECTORS), 0)
        ]
    ),
    np.array([begin * begin for begin in BANDS[1:]]),
    np.array([*(STEP ** (2 * (k + 1)) for k in range(STEPS - 1)), math.inf]),
)


def _usual_share(no_return: Floats) -> float:
    """Return the median missing share: fog affects all sectors, dirt a few."""
    known = no_return[~np.isnan(no_return)]
    return float(np.median(known)) if len(known) else 0.0


def _grown(table: NDArray[Any], rows: int) -> NDArray[Any]:
    """Add rows of zeros to a table that has less."""
    return np.pad(table, ((0, max(0, rows - len(table))), (0, 0)))
