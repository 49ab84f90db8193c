# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of a report as SVG and PNG, for papers and tickets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.disk.new_files import FOLDER, new_output
from lidar_outlier_filter.evaluation.confusion import Confusion
from lidar_outlier_filter.evaluation.curves import curve
from lidar_outlier_filter.evaluation.plots import FRAME, INK, draw_roc, dress, save
from lidar_outlier_filter.report.frames import cut
from lidar_outlier_filter.report.header import near_origin
from lidar_outlier_filter.report.tally import LARGEST_SCORE, RANGES, SCORE_BINS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from lidar_outlier_filter.report.gather import Gathered

REJECTED, GROUND, OUTLIER = '#c8500a', '#9aa3ad', '#0072b2'
MOST_DRAWN = 200_000  # points of a picture that are not rejected
SIZE = (7.0, 4.2)  # inches
TICKS = (0.35, 0.5, 0.7, 1, 1.5, 2, 3)


def write_figures(gathered: Gathered, folder: Path) -> list[str]:
    """Draw all figures into a new folder, which appears whole or not at all; return their names.

    Raises
    ------
    RecordingError
        If the folder exists, or cannot be written.

    """
    with new_output(folder, FOLDER) as built:
        _draw_all(gathered, built)
        return sorted(path.name for path in built.iterdir())


def _draw_all(gathered: Gathered, folder: Path) -> None:
    drawings: dict[str, Callable[[Axes, Gathered], None]] = {
        'map': _top,
        'side': _side,
        'scores': _scores,
        'thresholds': _thresholds,
    }
    if near_origin(gathered):
        drawings['ranges'] = _ranges
    if gathered.has_frames:
        drawings['over_time'] = _over_time
    for name, draw in drawings.items():
        figure = Figure(SIZE, facecolor='white', layout='constrained')
        draw(figure.subplots(), gathered)
        save(figure, folder / name)
    score, bad = gathered.tally.truth()
    if bad.any() and not bad.all():
        whole = gathered.tally.all
        now = gathered.tally.at[0][gathered.sliders[0].given]
        setting = Confusion(now.bad, whole.bad - now.bad, now.good, whole.good - now.good)
        draw_roc({'score': curve(bad, score)}, folder / 'roc', {'score': setting})


def _top(axes: Axes, gathered: Gathered) -> None:
    _plan(axes, gathered, 0, 1, ('x, m', 'y, m'))


def _side(axes: Axes, gathered: Gathered) -> None:
    _plan(axes, gathered, 0, 2, ('x, m', 'z, m'))


def _plan(axes: Axes, gathered: Gathered, u: int, v: int, labels: tuple[str, str]) -> None:
    """Draw the points from one side, as long as wide in metres; rejected ones on top."""
    kept = gathered.kept
    others = np.flatnonzero(~kept.rejected)
    few = others[np.argsort(kept.order[others], kind='stable')[:MOST_DRAWN]]
    look: Any = {'linewidths': 0, 'rasterized': True}  # as vectors they would be megabytes
    xyz, rejected = kept.xyz[few], kept.xyz[kept.rejected]
    axes.scatter(xyz[:, u], xyz[:, v], s=0.3, color=GROUND, **look)
    axes.scatter(rejected[:, u], rejected[:, v], s=3, color=REJECTED, label='rejected', **look)
    axes.set_aspect('equal', adjustable='box')
    dress(axes, *labels)
    if len(xyz):
        for limit, column in ((axes.set_xlim, u), (axes.set_ylim, v)):
            low, high = np.percentile(xyz[:, column], [0.5, 99.5])
            limit(low - 1.0, high + 1.0)
    axes.legend(loc='upper right', fontsize=9, labelcolor=INK, markerscale=3)


def _scores(axes: Axes, gathered: Gathered) -> None:
    edges = np.linspace(0, LARGEST_SCORE, SCORE_BINS + 1)
    good, bad = gathered.tally.scores
    _bars(axes, edges, good + bad, GROUND, 'all')
    if gathered.tally.has_truth:
        _bars(axes, edges, bad, OUTLIER, 'outliers in truth')
    axes.axvline(1.0, color=REJECTED, linestyle='--', label='threshold')
    _counted(axes, f'score; the last bin holds all from {edges[-2]:g} on')


def _ranges(axes: Axes, gathered: Gathered) -> None:
    edges = np.array([*RANGES, 1.25 * RANGES[-1]])
    now = gathered.tally.at[0][gathered.sliders[0].given]
    _bars(axes, edges, gathered.tally.all.by_range, GROUND, 'all')
    _bars(axes, edges, now.by_range, REJECTED, 'rejected')
    last = np.flatnonzero(gathered.tally.all.by_range)
    axes.set_xlim(0, edges[last[-1] + 1] if len(last) else edges[-1])
    _counted(axes, 'range, m; the last bin holds what is farther, too')


def _thresholds(axes: Axes, gathered: Gathered) -> None:
    """Draw what every step of every slider rejects."""
    total = max(gathered.tally.all.points, 1)
    for slider, counts in zip(gathered.sliders, gathered.tally.at, strict=True):
        share = [100 * one.points / total for one in counts]
        axes.plot(slider.limits, share, 'o-', markersize=3.5, label=slider.name)
    axes.set_xscale('log')
    axes.set_xticks(TICKS, [f'{tick:g}' for tick in TICKS])
    axes.minorticks_off()
    axes.set_yscale('symlog', linthresh=max(100 / total, 1e-4))
    axes.set_ylim(bottom=0)
    axes.axvline(1.0, color=REJECTED, linestyle='--', linewidth=1)
    dress(axes, 'critical value ÷ that of the given threshold', 'points rejected, %')
    axes.legend(fontsize=9, labelcolor=INK)


def _over_time(axes: Axes, gathered: Gathered) -> None:
    frames, tally = cut(gathered), gathered.tally
    slider = gathered.sliders[0]
    points = [sum(tally.clouds[int(one)] for one in clouds) for clouds in frames.clouds]
    rejected = [
        int(tally.of_clouds(0, slider.given, clouds.tolist()).sum()) for clouds in frames.clouds
    ]
    if not points:
        return
    seconds = (frames.start - frames.start[0]) / SECOND
    share: NDArray[np.float64] = 100 * np.array(rejected) / np.maximum(points, 1)
    axes.plot(seconds, share, color=REJECTED)
    axes.set_ylim(bottom=0)
    dress(axes, 'time, s', 'points rejected, %')


def _bars(
    axes: Axes, edges: NDArray[np.float64], counts: NDArray[np.int64], colour: str, label: str
) -> None:
    axes.stairs(counts, edges, fill=True, color=colour, label=label)


def _counted(axes: Axes, label: str) -> None:
    axes.set_yscale('symlog', linthresh=1)
    axes.set_ylim(bottom=0)
    dress(axes, label, 'points')
    axes.legend(fontsize=9, labelcolor=INK, edgecolor=FRAME)
