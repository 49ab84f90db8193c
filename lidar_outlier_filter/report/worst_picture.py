# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of what is rejected of a file: a map, and the largest groups from the side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.disk.new_files import new_output
from lidar_outlier_filter.errors import CloudError

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from lidar_outlier_filter.files.judged_file import JudgedFile
    from lidar_outlier_filter.report.worst import RejectedGroup, Worst

BELOW, ABOVE, INK = '#0072b2', '#c8500a', '#30343a'
PANELS = 6  # groups from the side
MOST_DRAWN = 200_000  # kept points on the map
# Half the width, the thickness and the height of a panel, in distances to the eighth neighbour: at
# least.
AROUND, SLICE, TALL = 16.0, 8.0, 3.0
SIZE, DPI = (14.0, 9.0), 100  # inches, dots per inch


def draw(judged: JudgedFile, worst: Worst, path: Path) -> None:
    """Draw into a new PNG.

    Raises
    ------
    CloudError
        If it exists, or cannot be written.

    """
    figure = Figure(SIZE, dpi=DPI, facecolor='white', layout='constrained')
    canvas = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 4)
    _map(figure.add_subplot(grid[:, :2]), judged, worst)
    for number, group in enumerate(worst.groups[:PANELS]):
        axes = figure.add_subplot(grid[number // 2, 2 + number % 2])
        _side(axes, judged, worst, group, number + 1)
    count, total = int(judged.verdict.rejected.sum()), len(judged.file)
    title = f'{judged.file.path.name}: {count:,} of {total:,} points rejected'
    figure.suptitle(title, color=INK, fontsize=15)
    with new_output(path, error=CloudError) as built:
        canvas.print_png(str(built))  # type: ignore[no-untyped-call]


def _map(axes: Axes, judged: JudgedFile, worst: Worst) -> None:
    """Draw all from above: kept points by their height, rejected ones as dots, groups as rings."""
    xyz, verdict = judged.loaded.points.xyz, judged.verdict
    kept = np.flatnonzero(judged.loaded.points.valid & ~verdict.rejected)
    some = kept[:: max(1, len(kept) // MOST_DRAWN)]
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


def _side(axes: Axes, judged: JudgedFile, worst: Worst, group: RejectedGroup, number: int) -> None:
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
    _dots(axes, xyz[inside & verdict.rejected] - middle, along, ABOVE if group.high else BELOW, 14)
    axes.set_xlim(-wide[along], wide[along])
    bottom, top = axes.get_ylim()
    axes.set_ylim(min(bottom, -TALL * worst.near), max(top, TALL * worst.near))
    where = ', '.join(f'{value:.1f}' for value in group.middle)
    points = 'point' if group.count == 1 else 'points'
    axes.set_title(f'{number}: {group.count:,} {points} at {where}', fontsize=10, color=INK)
    axes.set_xlabel(f'{"xy"[along]}, m')
    axes.set_ylabel('z, m')


def _dots(axes: Axes, xyz: NDArray[np.float64], along: int, colour: str, size: float) -> None:
    axes.scatter(xyz[:, along], xyz[:, 2], s=size, color=colour, linewidths=0)


def _origin(judged: JudgedFile) -> NDArray[np.float64]:
    """Return a round position near the points, in their units, for short numbers."""
    origin, where = np.zeros(3), np.flatnonzero(judged.loaded.points.valid)
    if len(where):
        first = judged.loaded.points.xyz[where[0]] / judged.units
        origin[:2] = np.floor(first[:2] / 1000) * 1000
    return origin
