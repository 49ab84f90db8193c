# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The forms in which sweeps are judged, and what is counted of a verdict."""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from real_snow_sweeps import SNOW

from lidar_outlier_filter.evaluation.confusion import Confusion, tally

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray
    from real_snow_sweeps import Integers, Mask, Sweep

RANGES = (0.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0)  # metres; the last has no end
SEED = 1  # of the order of points whose order is lost


@dataclass(frozen=True)
class Cloud:
    """A sweep of N points as a judge is given it.

    Attributes
    ----------
    name : of the sweep
    xyz : (N, 3) float32, metres
    intensity, label : (N,)
    ring, time : (N,), nanoseconds; None in a form without
    source : (N,) int64, the index of the point that it is a copy of; its own, if it is none

    """

    name: str
    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    label: NDArray[np.uint16]
    ring: NDArray[np.uint16] | None
    time: Integers | None
    source: Integers

    def __len__(self) -> int:
        """Count the points."""
        return len(self.label)

    @property
    def snow(self) -> Mask:
        """Whether a point is of falling snow."""
        found: Mask = self.label == SNOW
        return found

    @property
    def range(self) -> NDArray[np.float64]:
        """Distances from the sensor, metres."""
        found: NDArray[np.float64] = np.linalg.norm(self.xyz.astype(np.float64), axis=1)
        return found


class Form(NamedTuple):
    """What is given to a judge.

    ``title`` says it, ``points`` chooses them, and ``bare`` are those without rings, times and
    order. Peers, who use none of these, have the same figures in the form ``like`` it.
    """

    title: str
    points: Callable[[Sweep], Mask]
    bare: bool = False
    like: str = ''


def _last(sweep: Sweep) -> Mask:
    return ~sweep.second | (sweep.mate < 0)


FORMS = {
    'both': Form('both returns, with copies', lambda sweep: np.ones(len(sweep.label), np.bool_)),
    'once': Form('both returns, copies once', lambda sweep: ~sweep.copy),
    'last': Form('last return', _last),
    'xyzi': Form('last return, as x, y, z, intensity', _last, bare=True, like='last'),
}


def cloud(sweep: Sweep, form: Form) -> Cloud:
    """Give a sweep a form; of a bare one the order of the points is lost as well."""
    given = form.points(sweep)
    index = np.cumsum(given) - 1
    where = np.flatnonzero(given)
    source = index[np.where(sweep.copy, sweep.mate, np.arange(len(given)))[where]]
    if form.bare:  # which has no copies
        where = np.random.default_rng(SEED).permutation(where)
        source = np.arange(len(where))
    return Cloud(
        sweep.name,
        sweep.xyz[where],
        sweep.intensity[where],
        sweep.label[where],
        None if form.bare else sweep.ring[where],
        None if form.bare else sweep.time[where],
        source,
    )


class Verdict(NamedTuple):
    """What a judge says: which points of each cloud are rejected, how long it took, and how."""

    rejected: Sequence[Mask]
    seconds: float
    setting: str


@dataclass(frozen=True)
class Figures:
    """What is counted of a verdict.

    Attributes
    ----------
    sweeps : how many were judged
    seconds : what it took
    setting : what was chosen for these labels; empty: nothing
    classes : points, and rejected ones, by label
    ranges : found, missed, lost and kept points by range, as ``RANGES``

    """

    sweeps: int
    seconds: float
    setting: str
    classes: dict[int, tuple[int, int]]
    ranges: tuple[tuple[int, int, int, int], ...]

    @property
    def whole(self) -> Confusion:
        """Found, missed, lost and kept points."""
        return Confusion(*(sum(column) for column in zip(*self.ranges, strict=True)))

    @property
    def speed(self) -> float:
        """Million points per second."""
        return self.whole.total / self.seconds / 1e6


def count(clouds: Sequence[Cloud], verdict: Verdict) -> Figures:
    """Count what a verdict does to clouds of the same order."""
    label = np.concatenate([one.label for one in clouds])
    rejected = np.concatenate(verdict.rejected)
    distance = np.concatenate([one.range for one in clouds])
    part = np.digitize(distance, RANGES) - 1
    ranges = tally(label == SNOW, rejected, part, len(RANGES))
    classes = {
        int(one): (int((label == one).sum()), int(rejected[label == one].sum()))
        for one in np.unique(label)
    }
    rows = tuple((a, b, c, d) for a, b, c, d in ranges.tolist())
    return Figures(len(clouds), verdict.seconds, verdict.setting, classes, rows)
