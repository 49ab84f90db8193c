# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sweeps of WADS: rings, times and returns are found again from x, y, z in their order.

The files have x, y, z and intensity in the order in which the lasers fired, one byte order, and a
label of each point beside them. The sensor, a Pandar64, sends two returns. A *shot* is all that its
64 lasers fire in one direction. Its points come in two blocks: the last return of each laser, then
the one that is nearer. Where a laser saw one return only, the second block has a *copy* of it.
"""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]
    Mask = NDArray[np.bool_]

SHOT_STEP, SHOT_TIME = 0.2, 55_560  # degrees and nanoseconds from shot to shot
SAME_SHOT = 0.01  # degrees between azimuths of one shot; they differ by less than 0.0001
TILT = -0.06  # degrees: elevations of WADS's sensor less the published ones
ON_RING = 0.02  # degrees from a ring; rings are 0.167 apart, and no point is 0.004 off
TURN = 100_000_000  # nanoseconds of a sweep that was left out
START = 1_700_000_000_000_000_000  # nanoseconds: the files have no times of their own
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
    time: Integers


@dataclass(frozen=True)
class Sweep:
    """The N points of a file, in their order.

    Attributes
    ----------
    name : of the file
    xyz : (N, 3) float32, metres, as it is in the file
    intensity : (N,) float32
    label : (N,) uint16
    ring : (N,) uint16, from 0
    time : (N,) int64, nanoseconds
    second : (N,) bool, whether it is of the second block of its shot
    mate : (N,) int64, the index of the other return of the same shot and laser; -1: there is none

    """

    name: str
    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    label: NDArray[np.uint16]
    ring: NDArray[np.uint16]
    time: Integers
    second: Mask
    mate: Integers

    @property
    def copy(self) -> Mask:
        """Points of a second block that repeat the point of the first one, (N,) bool."""
        same = (self.xyz == self.xyz[self.mate]).all(axis=1)
        found: Mask = self.second & (self.mate >= 0) & same
        return found


def read_rings(path: Path) -> Rings:
    """Read a table of lasers: number, elevation, azimuth, degrees, and nanoseconds of firing.

    Raises
    ------
    RecordingError
        If it is no such table.

    """
    try:
        table = np.loadtxt(path, delimiter=',', skiprows=2, ndmin=2)
    except (OSError, ValueError) as err:
        raise RecordingError(str(path), 'a table of lasers', err) from err
    if table.shape[1:] != (4,):
        raise RecordingError(f'the columns of {path}', '4', table.shape[-1])
    return Rings(table[:, 1], table[:, 2], table[:, 3].astype(np.int64))


def list_files(folder: Path, every: int) -> list[Path]:
    """List every so many-th sweep of a folder, the first one among them.

    Raises
    ------
    RecordingError
        If there is none.

    """
    files = sorted((folder / 'sequences' / '36' / 'velodyne').glob('*.bin'))
    if not files:
        raise RecordingError(str(folder), 'with files sequences/36/velodyne/*.bin', 'none')
    return files[::every]


def read_sweeps(folder: Path, rings: Rings, every: int = 1) -> list[Sweep]:
    """Read sweeps, one after the other in time; those between that are left out take time, too.

    Raises
    ------
    RecordingError
        If a file is missing or broken, or its points do not lie on the rings.

    """
    sweeps, begin = [], START
    for path in list_files(folder, every):
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
    order = ring.astype(np.uint16)
    sweep = Sweep(path.name, xyz, points[:, 3].copy(), label, order, time, second, mate)
    return sweep, int(shot[-1] + 1) * SHOT_TIME if len(shot) else TURN


def _numbers(path: Path, kind: str, columns: int) -> NDArray[np.generic]:
    """Read a file of plain numbers as so many columns."""
    try:
        data = path.read_bytes()
    except OSError as err:
        raise RecordingError(str(path), 'readable', err) from err
    step = columns * np.dtype(kind).itemsize
    if len(data) % step:
        raise RecordingError(f'the bytes of {path.name}', f'a multiple of {step}', len(data))
    return np.frombuffer(data, kind).reshape(-1, columns)


def find_rings(xyz: NDArray[np.float32], rings: Rings, name: str) -> Integers:
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
    ring: Integers = order[np.searchsorted(middle, elevation)]
    away = np.abs(elevation - tilted[ring])
    if not (away <= ON_RING).all():
        must_be = f'within {ON_RING} degrees of a ring'
        raise RecordingError(f'the elevations of {name}', must_be, f'{away.max():.3f} degrees')
    return ring


def find_shots(xyz: NDArray[np.float32], ring: Integers, rings: Rings) -> tuple[Integers, Mask]:
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


def find_mates(shot: Integers, ring: Integers, second: Mask) -> Integers:
    """Return the index of the other return of the same shot and ring; -1: there is none."""
    width = int(ring.max(initial=0)) + 1
    key = shot * width + ring
    mate = np.full(len(key), -1)
    one, other = np.flatnonzero(~second), np.flatnonzero(second)
    _, mine, its = np.intersect1d(key[one], key[other], assume_unique=True, return_indices=True)
    mate[one[mine]], mate[other[its]] = other[its], one[mine]
    return mate
