# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of points in panels side by side, and of range images, as the papers have them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.evaluation import plots
from lidar_outlier_lab.results.pictures import INK, LEFT, LOST, PAPER, add_legend, save

Limits = tuple[tuple[float, float], tuple[float, float]]  # of x and of y

WIDTH, DPI = 14.0, 90  # inches; dots per inch
COLOURS = 64  # of the palette: keeps the file small
FEW = 5000  # points of a panel: of so few each is drawn larger
GOOD, EDGE = '#8d9299', '#9aa0a6'
NO_VALUE = '#20304a'  # of a range image


class Layer(NamedTuple):
    """Points (N, 2) of one colour and size, and what they are."""

    flat: Floats
    colour: str
    size: float
    name: str


class PointPanel(NamedTuple):
    """One panel: layers over each other, over ``edges`` (E, 2, 2), lines between points."""

    title: str
    layers: Sequence[Layer]
    edges: Floats | None = None


def view(
    title: str, flat: Floats, bad: Bools, kept: Bools, edges: Floats | None = None
) -> PointPanel:
    """Show points (N, 2): good ones, outliers that are kept, and good ones that are not."""
    fine = 0.5 if len(flat) > FEW else 6.0
    layers = (
        Layer(flat[kept & ~bad], GOOD, fine, 'good point'),
        Layer(flat[~kept & ~bad], LOST, 3 * fine, 'good point taken out'),
        Layer(flat[kept & bad], LEFT, max(6.0, 2 * fine), 'outlier'),
    )
    return PointPanel(title, layers, edges)


def draw(
    rows: Sequence[Sequence[PointPanel]],
    path: Path,
    labels: tuple[str, str],
    row: float = 2.6,
    limits: Limits | None = None,
) -> None:
    """Draw rows of panels as PNG; those of a row have the same axes.

    A row is ``row`` inches high. ``limits`` are of all axes; None: each row has its points'.
    """
    figure = Figure((WIDTH, 0.5 + row * len(rows)), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    # The legend is above the panels.
    figure.set_layout_engine('constrained', rect=(0, 0, 1, 1 - 0.4 / (0.5 + row * len(rows))))
    every = figure.subplots(len(rows), max(map(len, rows)), squeeze=False)
    for panels, line in zip(rows, every, strict=True):
        (left, right), (bottom, top) = limits or _limits(panels)
        for panel, axes in zip(panels, line, strict=True):
            if panel.edges is not None:
                axes.add_collection(LineCollection([*panel.edges], colors=EDGE, linewidths=0.7))
            for layer in panel.layers:
                axes.scatter(*layer.flat.T, s=layer.size, c=layer.colour, linewidths=0, zorder=2)
            _dress(axes, panel.title)
            axes.set_xlim(left, right)
            axes.set_ylim(bottom, top)
            axes.set_xlabel(labels[0], fontsize=9, color=INK)
        line[0].set_ylabel(labels[1], fontsize=9, color=INK)
    layers = (layer for panels in rows for panel in panels for layer in panel.layers)
    names = {layer.name: layer.colour for layer in layers if len(layer.flat)}
    add_legend(figure, [*names.items()])
    save(canvas, path, COLOURS)


def _limits(panels: Sequence[PointPanel]) -> Limits:
    flat = np.concatenate([layer.flat for panel in panels for layer in panel.layers])
    low, high = flat.min(axis=0), flat.max(axis=0)
    left, bottom = (low - 0.02 * (high - low)).tolist()
    right, top = (high + 0.02 * (high - low)).tolist()
    return (left, right), (bottom, top)


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=11, color=INK, loc='left')
    axes.tick_params(labelsize=8, colors=INK, length=2)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)


class GreyImage(NamedTuple):
    """Values (rows, columns), NaN where none is; black at low, white at high."""

    title: str
    pixels: Floats
    low: float
    high: float


def draw_images(images: Sequence[GreyImage], path: Path) -> None:
    """Draw range images side by side, as PNG."""
    ratio = images[0].pixels.shape[0] / images[0].pixels.shape[1]
    figure = Figure((WIDTH, WIDTH / len(images) * ratio + 0.7), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    figure.set_layout_engine('constrained')
    for axes, one in zip(figure.subplots(1, len(images), squeeze=False)[0], images, strict=True):
        axes.set_facecolor(NO_VALUE)
        axes.imshow(one.pixels, cmap='gray', vmin=one.low, vmax=one.high, aspect='auto')
        axes.set_xlabel('column', fontsize=9, color=INK)
        axes.set_ylabel('row', fontsize=9, color=INK)
        _dress(axes, one.title)
    save(canvas, path, COLOURS)


def draw_lines(
    series: Mapping[str, Sequence[float]],
    counts: Sequence[int],
    path: Path,
    label: str,
    *,
    from_zero: bool = False,
) -> None:
    """Draw figures against numbers of neighbours, such as the area under the ROC curve.

    ``counts`` ascend; ``series`` has values at each, NaN for a gap; ``path`` is without suffix.
    """
    plots.check(series)
    figure = Figure((6.4, 4.4), facecolor='white', layout='constrained')
    axes = figure.subplots()
    for number, (name, values) in enumerate(series.items()):
        axes.plot(counts, values, label=name, marker='o', markersize=4, **plots.style_of(number))
    plots.dress(axes, 'k, neighbours', label)
    if from_zero:
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
    plots.legend(figure, axes, 'best')
    plots.save(figure, path)
