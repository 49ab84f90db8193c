# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the default loses of clean sweeps of real sensors, and how fast it judges each.

    scripts/environment python benchmarks/clean_sweeps.py [--pictures FOLDER] [--write]

The sweeps are those that trees are trained on: the loss is that of the shipped trees on what they
saw. Speed is the best of three, of one sweep at a time, per second of processor time. A picture
shows a sweep from above and unrolled, by azimuth and elevation, with what was rejected in red.
``--write`` puts the table into ``doc/development/default.md``.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import table, write
from lidar_outlier_lab.training.scenes import known_recordings, read_sweeps
from lidar_outlier_lab.training.single_sweeps import read_single_sweeps

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points.points import Points

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / 'shared' / 'data'
PAGE = ROOT / 'doc' / 'development' / 'default.md'
SECTION = 'clean sweeps'
RUNS = 3
KEPT, REJECTED = '#b8bec6', '#d62728'


class Row(NamedTuple):
    """What is known of the sweeps of one sensor."""

    sensor: str
    sweeps: int
    points: int
    lost: int
    rate: float  # points per second of processor time


def sweeps(data: Path) -> Iterator[tuple[str, Sequence[Points]]]:
    """Read the clean sweeps by sensor."""
    for recording in known_recordings(data / 'bags'):
        yield recording.sensor, read_sweeps(recording)
    yield from read_single_sweeps(data)


def judge(chain: Chain, points: Points) -> tuple[NDArray[np.bool_], float]:
    """Return what is rejected, and the shortest processor time in seconds."""
    times = []
    for _ in range(RUNS):
        start = process_time()  # others may be at work on the machine
        rejected = chain.judge(points).rejected
        times.append(process_time() - start)
    return rejected, min(times)


def draw(points: Points, rejected: NDArray[np.bool_], title: str, path: Path) -> None:
    """Draw a sweep from above and unrolled."""
    x, y, z = points.xyz.T
    flat = np.hypot(x, y)
    views = (
        ('from above, m', x, y, (-60, 60), (-60, 60)),
        ('from above, near, m', x, y, (-12, 12), (-12, 12)),
        ('azimuth, elevation, °', *np.degrees([np.arctan2(y, x), np.arctan2(z, flat)]), None, None),
    )
    figure = Figure((21, 7), dpi=60, layout='constrained')
    FigureCanvasAgg(figure)
    for axes, (name, across, up, limits, heights) in zip(figure.subplots(1, 3), views, strict=True):
        axes.scatter(across[~rejected], up[~rejected], s=0.2, c=KEPT, linewidths=0)
        axes.scatter(across[rejected], up[rejected], s=14, c=REJECTED, linewidths=0)
        axes.set_title(name)
        if limits:
            axes.set(xlim=limits, ylim=heights, aspect='equal')
    figure.suptitle(f'{title}: {rejected.sum()} of {len(points)} rejected')
    figure.savefig(path)


def lay_out(rows: Sequence[Row]) -> str:
    """Lay out the rows in Markdown."""
    return table(
        ['sensor', 'points', 'rejected', 'million points/s of processor time'],
        [
            [
                f'{row.sensor}, {row.sweeps} sweep{"s"[: row.sweeps - 1]}',
                f'{row.points:,}',
                f'{100 * row.lost / row.points:.2g} %',
                f'{row.rate / 1e6:.2f}',
            ]
            for row in rows
        ],
    )


def main() -> int:
    """Judge all, print the table, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--data', type=Path, default=DATA, metavar='FOLDER')
    parser.add_argument('--pictures', type=Path, metavar='FOLDER')
    parser.add_argument('--write', action='store_true')
    options = parser.parse_args()
    chain = Chain(FilterParameters())
    chain.compile()
    rows = []
    for sensor, clouds in sweeps(options.data):
        lost, total, seconds = 0, 0, 0.0
        for number, points in enumerate(clouds):
            rejected, time = judge(chain, points)
            lost, total, seconds = lost + int(rejected.sum()), total + len(points), seconds + time
            if options.pictures:
                options.pictures.mkdir(parents=True, exist_ok=True)
                path = options.pictures / f'{sensor}_{number}.png'
                draw(points, rejected, f'{sensor} {number}', path)
        rows.append(Row(sensor, len(clouds), total, lost, total / seconds))
    print(lay_out(rows))
    if options.write:
        write(PAGE, SECTION, lay_out(rows), command='benchmarks/clean_sweeps.py --write')
    return 0


if __name__ == '__main__':
    sys.exit(main())
