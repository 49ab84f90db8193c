# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sweeps of WADS, the forms in which they are judged, and what is counted of a verdict.

Rings, times and returns are found again from x, y, z in their order.

The files have x, y, z and intensity in the order in which the lasers fired, one byte order, and a
label of each point beside them. The sensor, a Pandar64, sends two returns. A *shot* is all that its
64 lasers fire in one direction. Its points come in two blocks: the last return of each laser, then
the one that is nearer. Where a laser saw one return only, the second block has a *copy* of it.
"""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Singles
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.confusion import Confusion, tally

SHOT_STEP, SHOT_TIME = 0.2, 55_560  # degrees and nanoseconds from shot to shot
SAME_SHOT = 0.01  # degrees between azimuths of one shot; they differ by less than 0.0001
TILT = -0.06  # degrees: elevations of WADS's sensor less the published ones
ON_RING = 0.02  # degrees from a ring; rings are 0.167 apart, and no point is 0.004 off
TURN = 100_000_000  # nanoseconds of a sweep that was left out
START = 1_700_000_000_000_000_000  # nanoseconds: the files have no times of their own
RANGES = (0.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0)  # metres; the last has no end
SNOW = 110
CLASSES = {
    0: 'without a label',
    10: 'cars',
    30: 'people',
    40: 'road',
    50: 'buildings',
    70: 'vegetation',
    80: 'poles',
    81: 'signs',
    99: 'other objects',
    SNOW: 'falling snow',
    111: 'snow that lies',
}


class Rings(NamedTuple):
    """Where lasers point, degrees, and when they fire, nanoseconds: (rings,) each."""

    elevation: Floats
    azimuth: Floats
    time: Ints


@dataclass(frozen=True)
class Sweep:
    """N points of a file, in their order: all of them, or as many as a judge is given.

    Attributes
    ----------
    xyz : (N, 3) float32, metres, as it is in the file
    intensity : (N,) float32
    label : (N,) uint16
    ring : (N,) uint16, from 0
    time : (N,) int64, nanoseconds
    last : (N,) bool, whether it is the last return of its shot and laser
    source : (N,) int64, the index of the point that it is a copy of; its own, if it is no copy

    """

    xyz: Singles
    intensity: Singles
    label: NDArray[np.uint16]
    ring: NDArray[np.uint16]
    time: Ints
    last: Bools
    source: Ints

    def __len__(self) -> int:
        """Count the points."""
        return len(self.label)

    @property
    def copy(self) -> Bools:
        """Points of a second block that repeat the point of the first one, (N,) bool."""
        return self.source != np.arange(len(self))

    @property
    def snow(self) -> Bools:
        """Whether a point is of falling snow."""
        return self.label == SNOW

    @property
    def range(self) -> Floats:
        """Distances from the sensor, metres."""
        return np.linalg.norm(self.xyz.astype(np.float64), axis=1)

    def take(self, given: Bools) -> Sweep:
        """Choose points; of a copy, that which it is a copy of is chosen, too."""
        some = {name: values[given] for name, values in vars(self).items()}
        return Sweep(**some | {'source': (np.cumsum(given) - 1)[self.source[given]]})


def read_rings(path: Path) -> Rings:
    """Read a table of lasers: number, elevation, azimuth, degrees, and nanoseconds of firing."""
    table = np.loadtxt(path, delimiter=',', skiprows=2, ndmin=2)
    return Rings(table[:, 1], table[:, 2], table[:, 3].astype(np.int64))


def read_sweeps(folder: Path, rings: Rings, every: int = 1) -> list[Sweep]:
    """Read sweeps, one after the other in time; those between that are left out take time, too.

    Raises
    ------
    RecordingError
        If a file is missing or broken, or its points do not lie on the rings.

    """
    files = sorted((folder / 'sequences' / '36' / 'velodyne').glob('*.bin'))
    if not files:
        raise RecordingError(str(folder), 'with files sequences/36/velodyne/*.bin', 'none')
    sweeps, begin = [], START
    for path in files[::every]:
        sweep, duration = read_sweep(path, rings, begin)
        sweeps.append(sweep)
        begin += duration + (every - 1) * TURN
    return sweeps


def read_sweep(path: Path, rings: Rings, begin: int = START) -> tuple[Sweep, int]:
    """Read a sweep whose first shot is fired at a time; return how long it took, nanoseconds, too.

    Raises
    ------
    RecordingError
        If a file is missing or broken, or its points do not lie on the rings.

    """
    beside = path.parent.parent / 'labels' / f'{path.stem}.label'
    points = _numbers(path, '<f4', 4)
    label = (_numbers(beside, '<u4', 1)[:, 0] & 0xFFFF).astype(np.uint16)
    if len(label) != len(points):
        raise RecordingError(f'the labels of {path.name}', f'{len(points)} of them', len(label))
    xyz = np.ascontiguousarray(points[:, :3])
    ring = find_rings(xyz, rings, path.name)
    shot, second = find_shots(xyz, ring, rings)
    mate = find_mates(shot, ring, second)
    time = begin + shot * SHOT_TIME + rings.time[ring]
    copy = second & (mate >= 0) & (xyz == xyz[mate]).all(axis=1)
    source, order = np.where(copy, mate, np.arange(len(mate))), ring.astype(np.uint16)
    last = ~second | (mate < 0)
    sweep = Sweep(xyz, points[:, 3].copy(), label, order, time, last, source)
    return sweep, int(shot[-1] + 1) * SHOT_TIME if len(shot) else TURN


def _numbers(path: Path, kind: str, columns: int) -> NDArray[np.generic]:
    """Read a file of plain numbers as so many columns."""
    data = path.read_bytes()
    step = columns * np.dtype(kind).itemsize
    if len(data) % step:
        raise RecordingError(f'the bytes of {path.name}', f'a multiple of {step}', len(data))
    return np.frombuffer(data, kind).reshape(-1, columns)


def find_rings(xyz: Singles, rings: Rings, name: str) -> Ints:
    """Return the ring of each point by its elevation.

    Raises
    ------
    RecordingError
        If a point lies on none.

    """
    x, y, z = xyz.astype(np.float64).T
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y)))
    tilted = rings.elevation + TILT
    order = np.argsort(tilted)
    middle = (tilted[order][1:] + tilted[order][:-1]) / 2
    ring: Ints = order[np.searchsorted(middle, elevation)]
    away = np.abs(elevation - tilted[ring])
    if not (away <= ON_RING).all():
        must_be = f'within {ON_RING} degrees of a ring'
        raise RecordingError(f'the elevations of {name}', must_be, f'{away.max():.3f} degrees')
    return ring


def find_shots(xyz: Singles, ring: Ints, rings: Rings) -> tuple[Ints, Bools]:
    """Return the shot of each point, from 0, and whether it is of the second block of it.

    A shot begins where the azimuth goes on. Its second block begins where the ring does not rise.
    Shots without any point are counted by the angle.
    """
    x, y, _ = xyz.astype(np.float64).T
    azimuth = np.degrees(np.arctan2(x, y)) - rings.azimuth[ring]
    step = (np.diff(azimuth, prepend=azimuth[:1]) + 180.0) % 360.0 - 180.0
    begins = np.abs(step) > SAME_SHOT
    ahead = np.maximum(np.rint(step / SHOT_STEP), 1.0).astype(np.int64)
    shot = np.cumsum(np.where(begins, ahead, 0))
    falls = (np.diff(ring, prepend=-1) <= 0) & ~begins
    block = np.cumsum(falls)
    first = np.searchsorted(shot, shot)  # the index of the first point of the same shot
    return shot, block > block[first]


def find_mates(shot: Ints, ring: Ints, second: Bools) -> Ints:
    """Return the index of the other return of the same shot and ring; -1: no other return."""
    width = int(ring.max(initial=0)) + 1
    key = shot * width + ring
    mate = np.full(len(key), -1)
    one, other = np.flatnonzero(~second), np.flatnonzero(second)
    _, mine, its = np.intersect1d(key[one], key[other], assume_unique=True, return_indices=True)
    mate[one[mine]], mate[other[its]] = other[its], one[mine]
    return mate


# What is given to a judge: a title, and the points of a sweep.
FORMS: dict[str, tuple[str, Callable[[Sweep], Bools]]] = {
    'both': ('both returns, with copies', lambda sweep: np.ones(len(sweep), np.bool_)),
    'last': ('last return', lambda sweep: sweep.last),
}


def cloud(sweep: Sweep, form: str) -> Sweep:
    """Give a sweep a form."""
    return sweep.take(FORMS[form][1](sweep))


class Verdict(NamedTuple):
    """What a judge says: which points of each cloud are rejected, how long it took, and how."""

    rejected: Sequence[Bools]
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
    ranges: Ints

    @property
    def whole(self) -> Confusion:
        """Found, missed, lost and kept points."""
        return Confusion(*self.ranges.sum(axis=0).tolist())

    @property
    def speed(self) -> float:
        """Million points per second."""
        return self.whole.total / self.seconds / 1e6


def count(clouds: Sequence[Sweep], verdict: Verdict) -> Figures:
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
    return Figures(len(clouds), verdict.seconds, verdict.setting, classes, ranges)
