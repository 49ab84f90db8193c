# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Panels of small cutouts of a cloud, each around one point that was judged wrongly."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_lab.results.pictures import FOUND, INK, LEFT, LOST, PAPER, add_legend, save

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]

COLUMNS = 5
# Inches, of the whole, a row, the legend and what is below; dots per inch.
WIDTH, ROW, HEAD, FOOT, DPI = 14.0, 2.5, 0.45, 0.12, 80
COLOURS = 48  # of the palette: keeps the file small
KEPT = '#8a9097'
LEAST = 0.05  # metres that a panel shows at least to each side


class Cutout(NamedTuple):
    """Points around one that is at 0 0.

    Attributes
    ----------
    flat : (N, 2) float64
        To the right and up on the picture, metres.
    bad, rejected : (N,) bool
        Truth and verdict.

    """

    flat: NDArray[np.float64]
    bad: Mask
    rejected: Mask


def draw(panels: Sequence[tuple[str, Cutout]], path: Path) -> None:
    """Draw cutouts with their titles, row by row, as PNG."""
    rows = max(-(-len(panels) // COLUMNS), 1)
    height = HEAD + ROW * rows + FOOT
    figure = Figure((WIDTH, height), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    for index, (title, cutout) in enumerate(panels):
        row, column = divmod(index, COLUMNS)
        left = (column + 0.2) / COLUMNS
        bottom = (height - HEAD - (row + 0.87) * ROW) / height
        axes = figure.add_axes((left, bottom, 0.77 / COLUMNS, 0.71 * ROW / height))
        axes.set_title(title, fontsize=9.5, color=INK, pad=3)
        _panel(axes, cutout)
        if column == 0:
            axes.set_ylabel('across, m', fontsize=9, color=INK, labelpad=1)
        if index + COLUMNS >= len(panels):
            axes.set_xlabel('along, m', fontsize=9, color=INK, labelpad=1)
    outliers = ('outlier, rejected', FOUND), ('outlier, missed', LEFT)
    add_legend(figure, [('good', KEPT), ('good, lost', LOST), *outliers])
    save(canvas, path, COLOURS)


def _panel(axes: Axes, cutout: Cutout) -> None:
    flat, bad, rejected = cutout
    for some, colour, size in (
        (~bad & ~rejected, KEPT, 4),
        (bad & rejected, FOUND, 10),
        (bad & ~rejected, LEFT, 10),
        (~bad & rejected, LOST, 10),
    ):
        axes.scatter(flat[some, 0], flat[some, 1], s=size, c=colour, linewidths=0)
    axes.scatter([0.0], [0.0], s=90, facecolors='none', edgecolors=INK, linewidths=1.0)
    reach = np.maximum(1.08 * np.abs(flat).max(axis=0), LEAST)
    axes.set_xlim(-reach[0], reach[0])
    axes.set_ylim(-reach[1], reach[1])
    axes.tick_params(labelsize=7, colors=INK, length=2, pad=1.5)
    axes.locator_params(nbins=5)
    for side in axes.spines.values():
        side.set_color(KEPT)
