# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of values: of range images, pixel by pixel, and of clouds from above, point by point."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_lab.results.pictures import INK, PAPER, save

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

WIDTH, DPI = 12.0, 90  # inches; dots per inch
COLOURS = 64  # of the palette: keeps the file small
NONE = '#20304a'  # where there is no value


class Grey(NamedTuple):
    """A range image: values (rows, columns), NaN where none is; black at low, white at high."""

    title: str
    pixels: Floats
    low: float
    high: float


def draw_images(panels: Sequence[Grey], path: Path) -> None:
    """Draw range images side by side, as PNG."""
    count = len(panels)
    ratio = panels[0].pixels.shape[0] / panels[0].pixels.shape[1]
    figure = Figure((WIDTH, 0.9 * WIDTH / count * ratio + 0.7), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    figure.set_layout_engine('constrained')
    several = figure.subplots(1, count, squeeze=False)
    for axes, one in zip(several[0], panels, strict=True):
        axes.set_facecolor(NONE)
        axes.imshow(
            one.pixels,
            cmap='gray',
            vmin=one.low,
            vmax=one.high,
            interpolation='nearest',
            aspect='auto',
        )
        axes.set_title(one.title, fontsize=10, color=INK, loc='left')
        axes.tick_params(labelsize=8, colors=INK)
        axes.set_xlabel('column', fontsize=9, color=INK)
    several[0][0].set_ylabel('row', fontsize=9, color=INK)
    save(canvas, path, COLOURS)


class Classes(NamedTuple):
    """Points (N, 2), metres, with a class each (N,); colours and names of the classes."""

    title: str
    flat: Floats
    code: NDArray[np.int64]
    colours: Sequence[str]
    names: Sequence[str]


def draw_classes(panels: Sequence[Classes], path: Path) -> None:
    """Draw maps of points side by side, as PNG; later classes lie over earlier ones."""
    figure = Figure((WIDTH, 1.05 * WIDTH / len(panels)), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    figure.set_layout_engine('constrained')
    several = figure.subplots(1, len(panels), squeeze=False)
    for axes, one in zip(several[0], panels, strict=True):
        for number, (colour, name) in enumerate(zip(one.colours, one.names, strict=True)):
            some = one.code == number
            axes.scatter(
                one.flat[some, 0], one.flat[some, 1], s=0.8, c=colour, linewidths=0, label=name
            )
        axes.set_title(one.title, fontsize=11, color=INK, loc='left')
        axes.set_aspect('equal')
        axes.set_xlabel('x, m', fontsize=9, color=INK)
        axes.set_ylabel('y, m', fontsize=9, color=INK)
        axes.tick_params(labelsize=8, colors=INK)
        axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.08), ncols=2, markerscale=8)
    save(canvas, path, COLOURS)
