# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of rings as makers publish them, and sensors simulated with such rings."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_lab.simulation.world.sensors import SpinningScanner

TURN_NS = 100_000_000  # ten turns a second


class RingTable(NamedTuple):
    """The file of a sensor's table, and how many shots each ring has in a turn."""

    file: str
    columns: int


# By the names that real recordings of these sensors have, too: both are left out together.
TABLES = {
    'Pandar64': RingTable('Pandar64.csv', 1800),
    'Pandar40P': RingTable('Pandar40P.csv', 1800),
    'VLP-32C': RingTable('VLP32.yaml', 1800),
    'HDL-64E': RingTable('HDL64e_s3.yaml', 2000),
    'QT128': RingTable('PandarQT128.csv', 900),
    'VLS-128': RingTable('VLS128.yaml', 1800),
    'Pandar128': RingTable('Pandar128E4X.csv', 1200),
}


def read_elevations(path: Path) -> Floats:
    """Read the elevations of a table's rings, rad, ascending.

    CSV with a column ``Elevation`` in degrees, or YAML with ``lasers`` and their
    ``vert_correction`` in rad.

    Raises
    ------
    RecordingError
        If the file cannot be read as either.

    """
    try:
        text = path.read_text(encoding='utf-8')
        if path.suffix == '.csv':
            rows = csv.DictReader(text.splitlines())
            found = np.radians([float(row['Elevation']) for row in rows])
        else:
            lasers = yaml.safe_load(text)['lasers']
            found = np.array([float(laser['vert_correction']) for laser in lasers])
    except (OSError, KeyError, TypeError, ValueError, yaml.YAMLError) as err:
        raise RecordingError(f'the table of rings {path}', 'one of elevations', err) from err
    elevations: Floats = np.sort(found)
    return elevations


def scanner(table: RingTable, folder: Path) -> SpinningScanner:
    """Simulate a sensor with the rings of a table."""
    elevations = read_elevations(folder / table.file)
    interval = TURN_NS // (table.columns * len(elevations))
    return SpinningScanner(
        elevation=tuple(elevations.tolist()),
        columns=table.columns,
        column_time=interval * len(elevations),
    )


def known_scanners(folder: Path) -> dict[str, SpinningScanner]:
    """Simulate the sensors of ``TABLES`` that a folder has the tables of."""
    return {
        name: scanner(table, folder)
        for name, table in TABLES.items()
        if (folder / table.file).exists()
    }
