# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Single sweeps of spinning sensors in files without times: rings and times are found."""

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_lab.training import more_sweeps
from lidar_outlier_lab.training.ring_tables import TABLES, TURN_NS, read_elevations

FULL = 36_000.0  # hundredths of a degree


class SingleSweeps(NamedTuple):
    """Files of sweeps of one sensor; ``table`` names its rings where files do not say them."""

    sensor: str
    pattern: str
    table: str = ''


SWEEPS = (
    SingleSweeps('Pandar64', '64_*.pcd', 'Pandar64'),
    SingleSweeps('Pandar40P', '40p_*.pcd', 'Pandar40P'),
    SingleSweeps('Helios', 'helios_*.pcd'),
    SingleSweeps('RubyPlus', 'rubyplus_*.pcd'),
    SingleSweeps('Bpearl', 'bpearl_*.pcd'),
)


def read_single_sweeps(folder: Path) -> list[tuple[str, Sequence[Points]]]:
    """Read the sweeps that a folder of real data has in ``clouds/sensors``, by sensor."""
    found: list[tuple[str, Sequence[Points]]] = []
    for sweeps in SWEEPS:
        paths = sorted((folder / 'clouds' / 'sensors').glob(sweeps.pattern))
        if paths:
            found.append((sweeps.sensor, [_read(path, sweeps, folder) for path in paths]))
    return found


def read_more_sweeps(folder: Path) -> list[tuple[str, Sequence[Points]]]:
    """Read the sweeps of ``more_sweeps`` that a folder has in ``clouds/more``, by sensor.

    Raises
    ------
    RecordingError
        If a file is another one than the table names.

    """
    found: dict[str, list[Points]] = {}
    for row in more_sweeps.SWEEPS:
        path = folder / 'clouds' / 'more' / row['file']
        if path.exists():
            if (got := sha256(path.read_bytes()).hexdigest()) != row['sha256']:
                raise RecordingError(f'the SHA-256 of {path}', row['sha256'], got)
            *xyz, intensity, ring, t = _columns(path, ['x', 'y', 'z', 'intensity', 'ring', 't'])
            place, valid = np.stack(xyz, axis=1).astype(np.float64), np.ones(len(t), np.bool_)
            rings, times = ring.astype(np.int64), t.astype(np.int64)
            points = Points(place, times, rings, valid, intensity=intensity)
            found.setdefault(row['sensor'], []).append(points)
    return [*found.items()]


def _columns(path: Path, names: list[str]) -> list[np.ndarray[tuple[int], Any]]:
    chunks = list(open_cloud(path).read(names))
    return [np.concatenate([np.asarray(chunk[k]) for chunk in chunks]) for k in range(len(names))]


def _read(path: Path, sweeps: SingleSweeps, folder: Path) -> Points:
    names = ['x', 'y', 'z'] if sweeps.table else ['x', 'y', 'z', 'channel', 'azimuth', 'intensity']
    columns = _columns(path, names)
    xyz = np.stack(columns[:3], axis=1).astype(np.float64)
    reach = np.sqrt((xyz**2).sum(axis=1))
    intensity = None
    if sweeps.table:
        elevations = read_elevations(folder / 'ring_tables' / TABLES[sweeps.table].file)
        up = np.arcsin(xyz[:, 2] / np.where(reach > 0, reach, 1.0))
        ring = np.abs(up[:, None] - elevations).argmin(axis=1)
        # Hesai's heads turn clockwise from y on.
        turned = np.arctan2(xyz[:, 0], xyz[:, 1]) / (2 * np.pi) % 1.0
    else:
        ring, turned = columns[3].astype(np.int64), columns[4].astype(np.float64) / FULL % 1.0
        intensity = columns[5].astype(np.float32)
    t = np.rint(turned * TURN_NS).astype(np.int64)
    valid = np.isfinite(reach) & (reach > 0)
    points = Points(xyz, t, ring.astype(np.int64), valid, intensity=intensity)
    return points.take(valid)
