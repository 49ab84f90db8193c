# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds from the side or from above, before and after: points of truth and verdict in colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_lab.results.pictures import INK, LEFT, LOST, PAPER, add_legend, save

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

WIDTH, HEAD, DPI = 14.0, 0.5, 90  # inches, of the whole and of the legend; dots per inch
COLOURS = 48  # of the palette: keeps the file small
GOOD = '#8d9299'


class View(NamedTuple):
    """One panel.

    Attributes
    ----------
    title : str
    flat : (N, 2) float64
        To the right and up on the picture.
    bad : (N,) bool
        Outliers.
    kept : (N,) bool
        Points that are shown; good ones that are not are lost, and shown as such if ``marks``.
    marks : bool
        Whether lost points are marked.

    """

    title: str
    flat: Floats
    bad: Mask
    kept: Mask
    marks: bool = False


def draw(
    views: Sequence[Sequence[View]], path: Path, labels: tuple[str, str], row: float = 2.6
) -> None:
    """Draw rows of panels as PNG; those of a row have the same axes.

    Parameters
    ----------
    views : rows of panels
    path : of the picture
    labels : of the axes, with units
    row : height of a row, inches

    """
    height = HEAD + row * len(views)
    figure = Figure((WIDTH, height), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    for number, panels in enumerate(views):
        bottom = (height - HEAD - (number + 0.8) * row) / height
        limits = _limits(panels)
        for column, view in enumerate(panels):
            left = (column + 0.12) / len(panels)
            axes = figure.add_axes((left, bottom, 0.85 / len(panels), 0.64 * row / height))
            _panel(axes, view, limits)
            axes.set_xlabel(labels[0], fontsize=9, color=INK, labelpad=1)
            if column == 0:
                axes.set_ylabel(labels[1], fontsize=9, color=INK, labelpad=2)
    entries = [('good point', GOOD), ('outlier', LEFT)]
    if any(view.marks and (~view.kept & ~view.bad).any() for panels in views for view in panels):
        entries.append(('good point taken out', LOST))
    add_legend(figure, entries)
    save(canvas, path, COLOURS)


def _limits(panels: Sequence[View]) -> tuple[Floats, Floats]:
    flat = np.concatenate([view.flat for view in panels])
    low, high = flat.min(axis=0), flat.max(axis=0)
    return low - 0.02 * (high - low), high + 0.02 * (high - low)


def _panel(axes: Axes, view: View, limits: tuple[Floats, Floats]) -> None:
    lost = ~view.kept & ~view.bad if view.marks else np.zeros(len(view.bad), np.bool_)
    for some, colour, size in (
        (view.kept & ~view.bad, GOOD, 0.5),
        (lost, LOST, 1.5),
        (view.kept & view.bad, LEFT, 6.0),
    ):
        axes.scatter(view.flat[some, 0], view.flat[some, 1], s=size, c=colour, linewidths=0)
    axes.set_xlim(limits[0][0], limits[1][0])
    axes.set_ylim(limits[0][1], limits[1][1])
    axes.set_title(view.title, fontsize=11, color=INK, pad=3)
    axes.tick_params(labelsize=8, colors=INK, length=2, pad=1.5)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)
