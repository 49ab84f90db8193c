# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a report, of rejected groups of a file, and of a mask, drawn by Matplotlib."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.points.mask import COLUMNS, Mask
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.evaluation.confusion import Confusion, curve
from lidar_outlier_filter.evaluation.plots import DPI, FRAME, INK, draw_roc, dress, save
from lidar_outlier_filter.files.judged_file import JudgedFile
from lidar_outlier_filter.report.gather import Gathered
from lidar_outlier_filter.report.page import near_origin
from lidar_outlier_filter.report.steps import MAX_SCORE, RANGE_EDGES_M, SCORE_BINS, Counts
from lidar_outlier_filter.report.worst import RejectedGroup, Worst

REJECTED, GROUND, OUTLIER = '#c8500a', '#9aa3ad', '#0072b2'  # pages: assets/style.css
BELOW, ABOVE = OUTLIER, REJECTED
MAX_DRAWN = 200_000  # kept points of a picture
SIZE, WORST_SIZE, MASK_SIZE = (7.0, 4.2), (14.0, 9.0), (10.5, 4.0)  # inches
WORST_DPI = 100
TICKS = (0.35, 0.5, 0.7, 1, 1.5, 2, 3)
PANELS = 6  # groups from the side
# Least half width, thickness and height of a panel, in distances to the eighth neighbour.
AROUND, SLICE, TALL = 16.0, 8.0, 3.0


def draw_all(gathered: Gathered, folder: Path) -> None:
    """Draw all figures into a folder."""
    drawings: dict[str, Callable[[Axes, Gathered], None]] = {
        'map': _plan_of(1),
        'side': _plan_of(2),
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
        whole, now = gathered.all, _now(gathered)
        setting = Confusion(now.bad, whole.bad - now.bad, now.good, whole.good - now.good)
        draw_roc({'score': curve(bad, score)}, folder / 'roc', {'score': setting})


def _plan_of(axis: int) -> Callable[[Axes, Gathered], None]:
    """Return what draws the points from above or from the side, rejected ones on top."""

    def draw(axes: Axes, gathered: Gathered) -> None:
        points, found = gathered.points, gathered.found
        xyz, rejected = points['xyz'] / np.array(found.units), points['rejected']
        kept = xyz[~rejected]
        kept = kept[:: max(1, len(kept) // MAX_DRAWN)]
        style: Any = {'linewidths': 0, 'rasterized': True}  # as vectors they would be megabytes
        axes.scatter(kept[:, 0], kept[:, axis], s=0.3, color=GROUND, **style)
        u, v = xyz[rejected][:, [0, axis]].T
        axes.scatter(u, v, s=3, color=REJECTED, label='rejected', **style)
        axes.set_aspect('equal', adjustable='box')
        dress(axes, f'x, {found.unit}', f'{"xyz"[axis]}, {found.unit}')
        if len(kept):
            for limit, column in ((axes.set_xlim, 0), (axes.set_ylim, axis)):
                low, high = np.percentile(kept[:, column], [0.5, 99.5])
                limit(low - 1.0, high + 1.0)
        axes.legend(loc='upper right', fontsize=9, labelcolor=INK, markerscale=3)

    return draw


def _scores(axes: Axes, gathered: Gathered) -> None:
    edges = np.linspace(0, MAX_SCORE, SCORE_BINS + 1)
    good, bad = gathered.tally.scores
    axes.stairs(good + bad, edges, fill=True, color=GROUND, label='all')
    if bad.any():
        axes.stairs(bad, edges, fill=True, color=OUTLIER, label='outliers in truth')
    axes.axvline(1.0, color=REJECTED, linestyle='--', label='threshold')
    _counted(axes, f'score; the last bin holds all from {edges[-2]:g} on')


def _ranges(axes: Axes, gathered: Gathered) -> None:
    edges = np.array([*RANGE_EDGES_M, 1.25 * RANGE_EDGES_M[-1]])
    every = gathered.all.by_range
    axes.stairs(every, edges, fill=True, color=GROUND, label='all')
    axes.stairs(_now(gathered).by_range, edges, fill=True, color=REJECTED, label='rejected')
    last = np.flatnonzero(every)
    axes.set_xlim(0, edges[last[-1] + 1] if len(last) else edges[-1])
    _counted(axes, 'range, m; the last bin holds what is farther, too')


def _thresholds(axes: Axes, gathered: Gathered) -> None:
    """Draw what every step of every slider rejects."""
    total = max(gathered.all.points, 1)
    for slider, counts in zip(gathered.sliders, gathered.counts, strict=True):
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
    frames, every, now = gathered.frames, gathered.all, _now(gathered)
    if not len(frames):
        return
    clouds = [one.tolist() for one in frames.clouds]
    share = [100 * now.of_clouds(one) / max(every.of_clouds(one), 1) for one in clouds]
    axes.plot((frames.start - frames.start[0]) / SECOND, share, color=REJECTED)
    axes.set_ylim(bottom=0)
    dress(axes, 'time, s', 'points rejected, %')


def _now(gathered: Gathered) -> Counts:
    """Count the points that are rejected at the given settings."""
    return gathered.counts[0][gathered.sliders[0].given]


def _counted(axes: Axes, label: str) -> None:
    axes.set_yscale('symlog', linthresh=1)
    axes.set_ylim(bottom=0)
    dress(axes, label, 'points')
    axes.legend(fontsize=9, labelcolor=INK, edgecolor=FRAME)


def draw_worst(judged: JudgedFile, worst: Worst, path: Path) -> None:
    """Draw a map and the largest groups from the side into a PNG."""
    figure = Figure(WORST_SIZE, dpi=WORST_DPI, facecolor='white', layout='constrained')
    canvas = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 4)
    _map(figure.add_subplot(grid[:, :2]), judged, worst)
    for number, group in enumerate(worst.groups[:PANELS]):
        axes = figure.add_subplot(grid[number // 2, 2 + number % 2])
        _from_the_side(axes, judged, worst, group, number + 1)
    count, total = int(judged.verdict.rejected.sum()), len(judged.file)
    title = f'{judged.file.path.name}: {count:,} of {total:,} points rejected'
    figure.suptitle(title, color=INK, fontsize=15)
    canvas.print_png(str(path))  # type: ignore[no-untyped-call]


def _map(axes: Axes, judged: JudgedFile, worst: Worst) -> None:
    """Draw all from above: kept points by their height, rejected ones as dots, groups as rings."""
    xyz, verdict = judged.loaded.points.xyz, judged.verdict
    kept = np.flatnonzero(judged.loaded.points.valid & ~verdict.rejected)
    some = kept[:: max(1, len(kept) // MAX_DRAWN)]
    unit = np.array(judged.units)
    origin = _origin(judged)
    if len(some):
        x, y, z = (xyz[some] / unit - origin).T
        low, high = np.percentile(z, [2, 98])
        axes.scatter(x, y, s=1, c=z, cmap='Greys_r', vmin=low, vmax=high + 5)
    rejected = np.flatnonzero(verdict.rejected)
    for side, colour, name in ((judged.high, ABOVE, 'above'), (~judged.high, BELOW, 'below')):
        points = xyz[rejected[side]] / unit - origin
        label = f'{len(points):,} {name} what is kept around'
        axes.scatter(points[:, 0], points[:, 1], s=14, color=colour, label=label)
    for number, group in enumerate(worst.groups[:PANELS], 1):
        middle = group.middle - origin
        axes.annotate(
            str(number),
            (middle[0], middle[1]),
            (8, 8),
            textcoords='offset points',
            color=INK,
            fontsize=13,
        )
    axes.set_aspect('equal')
    east, north = (f' − {start:.0f}' if round(start) else '' for start in origin[:2])
    axes.set_xlabel(f'x{east}, as in the file')
    axes.set_ylabel(f'y{north}, as in the file')
    axes.legend(loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)


def _from_the_side(
    axes: Axes, judged: JudgedFile, worst: Worst, group: RejectedGroup, number: int
) -> None:
    """Draw a group and what is around it from the side, along the longer side of its box."""
    xyz, verdict = judged.loaded.points.xyz, judged.verdict
    own = xyz[group.members]
    low, high = own.min(axis=0), own.max(axis=0)
    along = int((high - low)[1] > (high - low)[0])
    wide = np.maximum((high - low) / 2, AROUND * worst.near)
    wide[1 - along] = max((high - low)[1 - along] / 2, SLICE * worst.near)
    middle = (low + high) / 2
    inside = np.ones(len(xyz), np.bool_)
    for axis in range(2):
        inside &= np.abs(xyz[:, axis] - middle[axis]) <= wide[axis]
    inside &= judged.loaded.points.valid
    kept = inside & ~verdict.rejected
    _dots(axes, xyz[kept] - middle, along, '#8a929c', 3)
    rejected = np.flatnonzero(verdict.rejected)
    for side, colour in ((judged.high, ABOVE), (~judged.high, BELOW)):
        one = rejected[side & inside[rejected]]
        _dots(axes, xyz[one] - middle, along, colour, 14)
    axes.set_xlim(-wide[along], wide[along])
    bottom, top = axes.get_ylim()
    axes.set_ylim(min(bottom, -TALL * worst.near), max(top, TALL * worst.near))
    where = ', '.join(f'{value:.1f}' for value in group.middle)
    points = 'point' if group.count == 1 else 'points'
    axes.set_title(f'{number}: {group.count:,} {points} at {where}', fontsize=10, color=INK)
    axes.set(xlabel=f'{"xy"[along]}, m', ylabel='z, m')


def _dots(axes: Axes, xyz: Floats, along: int, colour: str, size: float) -> None:
    axes.scatter(xyz[:, along], xyz[:, 2], s=size, color=colour, linewidths=0)


def _origin(judged: JudgedFile) -> Floats:
    """Return a round position near the points, in their units, for short numbers."""
    origin, where = np.zeros(3), np.flatnonzero(judged.loaded.points.valid)
    if len(where):
        first = judged.loaded.points.xyz[where[0]] / judged.units
        origin[:2] = np.floor(first[:2] / 1000) * 1000
    return origin


def draw_mask(mask: Mask, path: Path) -> None:
    """Draw a mask as a PNG: ranges by azimuth and ring, and the vehicle from above."""
    figure = Figure(MASK_SIZE, facecolor='white', layout='constrained')
    image, above = figure.subplots(1, 2, width_ratios=(3, 1))
    seen = mask.is_seen
    shown = np.where(seen, mask.near, np.nan)
    rings = max(len(shown), 1)
    drawn = image.imshow(
        shown if len(shown) else np.full((1, COLUMNS), np.nan),
        origin='lower',
        aspect='auto',
        extent=(0, 360, -0.5, rings - 0.5),
        interpolation='nearest',
        cmap='viridis',
    )
    dress(image, 'azimuth, degrees', 'ring')
    image.grid(visible=False)
    figure.colorbar(drawn, ax=image, label='range, m')
    azimuth = (np.nonzero(seen)[1] + 0.5) * 2 * np.pi / COLUMNS
    above.scatter(mask.near[seen] * np.cos(azimuth), mask.near[seen] * np.sin(azimuth), s=2)
    above.plot(0, 0, '+', color=FRAME, markersize=12)
    dress(above, 'x at level, m', 'y at level, m')
    above.set_aspect('equal', 'datalim')
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=DPI, format='png')
