# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the time grows with the cloud, as in figure 6 of Sotoodeh (2006): in proportion."""

from __future__ import annotations

from time import process_time
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import concatenate
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.colours import colour
from lidar_outlier_lab.results.lines_picture import draw_lines
from lidar_outlier_lab.results.markdown import image, number, paragraphs, table
from lidar_outlier_lab.results.samples import simulated

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.annotations import Progress
    from lidar_outlier_filter.core.points.points import Points

PARTS = 8  # sizes, evenly apart
ROUNDS = 3
PICTURE = 'results_run_time'


def growth(
    points: Points, sizes: Sequence[int], detectors: Sequence[str], progress: Progress
) -> dict[str, list[float]]:
    """Time each detector on the first so many points, seconds: the quickest of a few rounds.

    The processor's time of one thread, as other work on the machine does not count in it.
    """
    chains = {
        name: Chain(FilterParameters().changed({'chain': [name], 'threads': 1}))
        for name in detectors
    }
    parts = [points.take(slice(size)) for size in sizes]
    seconds = {name: [np.inf] * len(sizes) for name in detectors}
    for chain in chains.values():
        chain.judge(parts[0])
    for turn in range(ROUNDS):
        for name, chain in chains.items():
            progress(turn, ROUNDS, f'timing {name}')
            for i, part in enumerate(parts):
                begin = process_time()
                chain.judge(part)
                seconds[name][i] = min(seconds[name][i], process_time() - begin)
    return seconds


def exponent(sizes: Sequence[int], seconds: Sequence[float]) -> float:
    """Return b of the least squares fit of time = a · points**b: 1 where it is in proportion."""
    slope, _ = np.polyfit(np.log(sizes), np.log(seconds), 1)
    return float(slope)


def section(preset: str, seed: int, folder: Path, progress: Progress) -> str:
    """Write up and draw the run time on ever more lines of one recording."""
    progress(0, 1, f'simulating {preset}')
    (sample,) = simulated(preset, seed)
    points = concatenate(sample.data.clouds)
    sizes = [len(points) * part // PARTS for part in range(1, PARTS + 1)]
    seconds = growth(points, sizes, tuple(DETECTORS), progress)
    draw_lines(
        seconds,
        [size / 1000 for size in sizes],
        folder / PICTURE,
        x_label='thousand points',
        y_label='seconds',
        from_zero=True,
        colours={name: colour(name, one.bit) for name, one in DETECTORS.items()},
    )
    return paragraphs(
        '## Run time',
        'As Sotoodeh (2006) in his figure 6, where the time of LOF is in proportion to the points: '
        f'the first part of `{preset}`, seed {seed}, judged as a whole by each detector with its '
        f'defaults on one core; processor time, the least of {ROUNDS} rounds. The exponent b of '
        'time = a · points^b is 1 where it is in proportion.',
        table(*_rows(sizes, seconds)),
        image(f'{PICTURE}.png', 'Run time against points'),
    )


def _rows(
    sizes: Sequence[int], seconds: Mapping[str, Sequence[float]]
) -> tuple[list[str], list[list[str]]]:
    head = ['seconds', *(f'{size:,}' for size in sizes), 'b']
    rows = [
        [f'`{name}`', *(number(one) for one in times), number(exponent(sizes, times), 2)]
        for name, times in seconds.items()
    ]
    return head, rows
