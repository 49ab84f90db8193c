# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The two settings of Kang, Huang and Yang (2018), Table 1, on real airborne clouds.

python benchmarks/elevation.py CLOUD.laz...
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from rich.console import Console
from rich.table import Table

from lidar_outlier_filter.core.detectors.elevation import detector as elevation
from lidar_outlier_filter.core.detectors.elevation.parameters import Elevation
from lidar_outlier_filter.files.cleaning import points
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters

RUNS = 5
# Share eliminated and seconds; how many points there were is not said.
PAPER = {
    'Kang 2018, urban': {30: (0.00047, 88.0), 60: (0.00051, 191.0)},
    'Kang 2018, mountain': {30: (0.00022, 176.0), 60: (0.00024, 340.0)},
}


def run(console: Console, paths: list[Path]) -> None:
    """Print shares and times for both settings."""
    table = Table(
        'cloud', 'points', 'share, k = 30', 'k = 60', 'ratio', 'seconds, k = 30', 'k = 60'
    )
    for column in table.columns[1:]:
        column.justify = 'right'
    for path in paths:
        xyz = points.load(open_cloud(path), 'xyz', FilterParameters(), timed=False).points.xyz
        _add(table, path.name, f'{len(xyz):,}', {k: measure(xyz, k) for k in (30, 60)})
    for name, figures in PAPER.items():
        _add(table, name, '', figures)
    console.print(table)


def measure(xyz: np.ndarray[tuple[int, int], np.dtype[np.float64]], k: int) -> tuple[float, float]:
    """Return the share of points rejected, and the median time in seconds."""
    parameters = Elevation(k=k)
    elevation.detect(xyz, parameters)
    times = []
    for _ in range(RUNS):
        begin = perf_counter()
        score = elevation.detect(xyz, parameters)
        times.append(perf_counter() - begin)
    return float(np.mean(score > 1)), median(times)


def _add(table: Table, name: str, points: str, figures: dict[int, tuple[float, float]]) -> None:
    share, seconds = zip(*figures.values(), strict=True)
    cells = (*(f'{one:.3%}' for one in share), f'{share[1] / share[0]:.2f}')
    table.add_row(name, points, *cells, *(f'{one:.3f}' for one in seconds))


if __name__ == '__main__':
    run(Console(), [Path(one) for one in sys.argv[1:]])
