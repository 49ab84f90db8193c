# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the filter is, and how fast a peer on the same cloud in the same run.

Answers are compared first: what is fast and wrong has no speed.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table
from scipy.spatial import cKDTree

from lidar_outlier_filter.cloud import structured
from lidar_outlier_filter.core import scanlines
from lidar_outlier_filter.core.detectors import alpha_beta_gamma
from lidar_outlier_filter.core.points import Points, is_return
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.simulate import clouds, to_message
from lidar_outlier_filter.evaluation.street import SENSOR, demo_drive
from lidar_outlier_filter.parameters import FilterParameters
from lidar_outlier_filter.pipeline import CloudFilter

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from rich.console import Console

LINES, SHOTS = 300, 1000
BLOCK = 20  # lines that the stream hands over at once: 0.1 s at 200 lines/s
NEIGHBOURS, MULTIPLIER = 20, 2.0  # of the peer's statistical outlier removal
RUNS = 9
SIDES = ('both', 'either')
FORM = 'alpha_beta_gamma.sides'


@dataclass(frozen=True)
class Timing:
    """Median time of some work on a number of points."""

    name: str
    points: int
    seconds: float

    @property
    def speed(self) -> float:
        """Million points per second."""
        return self.points / self.seconds / 1e6


def run(console: Console) -> int:
    """Compare, measure and print a table; returns the exit status."""
    compare_engines()
    messages = [to_message(stamp, points) for stamp, points in clouds(demo_drive())]
    cloud = _coordinates(messages)
    peer = time_peer(cloud)
    timings = [
        *(time_smoother(sides) for sides in SIDES),
        *(time_stream(messages, sides) for sides in SIDES),
        peer,
    ]
    table = Table('work', 'points', 'million points/s', '× peer')
    for column in table.columns[1:]:
        column.justify = 'right'
    for timing in timings:
        ratio = timing.speed / peer.speed
        table.add_row(timing.name, f'{timing.points:,}', f'{timing.speed:.2f}', f'{ratio:.1f}')
    console.print(table)
    cores = f'{os.cpu_count()} cores; the filter uses one, the peer all. Medians of {RUNS} runs.'
    console.print(cores, highlight=False)
    return 0


def compare_engines() -> None:
    """Refuse to time kernels whose answer is not that of the Kalman filter (if installed)."""
    if find_spec('filterpy') is None:
        return
    points = profile_lines(2)
    answers = []
    for engine in ('kernel', 'filterpy'):
        parameters = FilterParameters().changed({'alpha_beta_gamma.engine': engine})
        answers.append(_smooth(points, parameters))
    if not np.array_equal(answers[0], answers[1]):
        differing = int(np.count_nonzero(answers[0] != answers[1]))
        raise FilterError("the kernel's answer", "the Kalman filter's", f'{differing} others')


def profile_lines(count: int, seed: int = 1) -> Points:
    """Make scan lines of a profile scanner over a flat road: 8 mm noise, 1 % outliers above."""
    dice = np.random.default_rng(seed)
    across = np.tile(2.5 * np.tan(np.linspace(-1.2, 1.2, SHOTS)), count)
    along = np.repeat(0.05 * np.arange(count), SHOTS)
    xyz = np.stack([along, across, np.zeros(count * SHOTS)], axis=1)
    xyz += dice.normal(0.0, 0.008, xyz.shape)
    stray = dice.random(len(xyz)) < 0.01  # noqa: PLR2004  the share of outliers
    xyz[stray, 2] += dice.uniform(0.2, 2.0, np.count_nonzero(stray))
    t = 5000 * np.arange(count * SHOTS)
    line = np.repeat(np.arange(count), SHOTS)
    return Points(xyz, t, line, np.ones(len(xyz), np.bool_))


def time_smoother(sides: str) -> Timing:
    """Time the smoother alone: lines, segments, predictions, tests, all passes, block by block."""
    points = profile_lines(LINES)
    size = BLOCK * SHOTS
    blocks = [points.take(slice(i, i + size)) for i in range(0, len(points), size)]
    parameters = FilterParameters().changed({FORM: sides})
    seconds = _median_time(lambda: [_smooth(block, parameters) for block in blocks])
    return Timing(f'smoother on lines of {SHOTS} points, sides: {sides}', len(points), seconds)


def _smooth(points: Points, parameters: FilterParameters) -> NDArray[np.bool_]:
    lines = scanlines.find_lines(points, parameters.gap_factor)
    return alpha_beta_gamma.detect(points, lines, parameters.alpha_beta_gamma).rejected


def time_stream(messages: list[Any], sides: str) -> Timing:
    """Time the whole way of the simulated drive: decode, verdict, split."""
    parameters = FilterParameters().changed({**SENSOR, FORM: sides})

    def stream() -> None:
        cloud_filter = CloudFilter(parameters)
        answers = sum(len(cloud_filter.push(msg)) for msg in messages)
        answers += len(cloud_filter.flush())
        if answers != len(messages):
            raise FilterError('the answers', f'{len(messages)}', answers)

    points = sum(msg.width * msg.height for msg in messages)
    seconds = _median_time(stream)
    return Timing(f'decode → verdict → split, sides: {sides}', points, seconds)


def time_peer(xyz: NDArray[np.float64]) -> Timing:
    """Time the peer's statistical outlier removal on the same points."""
    if find_spec('open3d') is not None:
        open3d = import_module('open3d')
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz))
        name = f'peer: Open3D remove_statistical_outlier({NEIGHBOURS}, {MULTIPLIER})'
        work = lambda: cloud.remove_statistical_outlier(NEIGHBOURS, MULTIPLIER)  # noqa: E731
    else:
        name = f'peer: SOR({NEIGHBOURS}, {MULTIPLIER}) on scipy cKDTree (no Open3D installed)'
        work = lambda: _scipy_sor(xyz)  # noqa: E731
    return Timing(name, len(xyz), _median_time(work))


def _scipy_sor(xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
    distance, _ = cKDTree(xyz).query(xyz, NEIGHBOURS, workers=-1)
    mean = distance.mean(axis=1)
    rejected: NDArray[np.bool_] = mean > mean.mean() + MULTIPLIER * mean.std(ddof=1)
    return rejected


def _coordinates(messages: list[Any]) -> NDArray[np.float64]:
    parts = [structured(msg).reshape(-1) for msg in messages]
    xyz = np.concatenate([np.stack([part[axis] for axis in 'xyz'], axis=1) for part in parts])
    exact = xyz.astype(np.float64)
    return exact[is_return(exact)]


def _median_time(work: Callable[[], object]) -> float:
    """Return the median of some runs, after one that does not count."""
    work()
    times = []
    for _ in range(RUNS):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return median(times)
