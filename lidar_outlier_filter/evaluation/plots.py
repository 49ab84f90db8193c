# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of curves, as PNG and SVG: the same curves give the same bytes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.errors import FilterError, RecordingError, refusing
from lidar_outlier_filter.evaluation.confusion import Confusion, Curve

INK, FRAME, GRID = '#30343a', '#9aa0a6', '#e4e6e9'
# Okabe and Ito: distinguished by everybody, and in grey.
COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#000000')
DASHES = ('-', '--', '-.', ':')
ABOUT_DOT = ', dot: as it was run'
PICTURE_SUFFIXES = ('.png', '.svg')
DPI = 130
MAX_DECADES = 6
MAX_CURVES_INSIDE = 5  # curves that a legend can name without hiding them
BESIDE = 2.2  # inches for the legend of more


def draw_roc(
    curves: Mapping[str, Curve], path: Path, settings: Mapping[str, Confusion] | None = None
) -> list[Path]:
    """Draw ROC curves twice: over linear, and over logarithmic false rejections.

    Parameters
    ----------
    curves : by the name that the legend gives them
    path : without suffix; what is written is ``.png`` and ``.svg``
    settings : what the threshold in use gave, for some of the curves: a dot on each

    """
    check(curves)
    settings = settings or {}
    figure = Figure((10.5, 4.8), facecolor='white', layout='constrained')
    plain, close = figure.subplots(1, 2)
    fewest = min(1 / curve.lost[-1] for curve in curves.values())
    left = max(10.0 ** np.floor(np.log10(fewest)), 10.0**-MAX_DECADES)
    for number, (name, whole) in enumerate(curves.items()):
        curve, style = whole.thinned(), style_of(number)
        text = f'{name}  AUC {whole.auc:.4f}' + ABOUT_DOT * (name in settings)
        plain.plot(curve.false_rejections, curve.recall, label=text, **style)
        # A logarithm has no 0: the curve enters at the left edge with what it had there.
        shown = np.maximum(curve.false_rejections, left)
        close.plot(shown, curve.recall, label=text, drawstyle='steps-post', **style)
        if dot := settings.get(name):
            for axes in (plain, close):
                where = max(dot.false_rejections.ratio, left)
                _mark(axes, where, dot.recall.ratio, style['color'])
    plain.plot([0, 1], [0, 1], color=FRAME, linewidth=0.8, linestyle=':')
    close.set_xscale('log')
    close.set_xlim(left, 1)
    plain.set_xlim(-0.01, 1)
    for axes in (plain, close):
        dress(axes, 'share of the good points rejected', 'share of the outliers rejected')
        axes.set_ylim(0, 1.01)
    legend(figure, plain, 'lower right')
    return save(figure, path)


def draw_precision_recall(
    curves: Mapping[str, Curve], path: Path, settings: Mapping[str, Confusion] | None = None
) -> list[Path]:
    """Draw precision–recall curves; see :func:`draw_roc`."""
    check(curves)
    settings = settings or {}
    figure = Figure((6.4, 4.8), facecolor='white', layout='constrained')
    axes = figure.subplots()
    for number, (name, whole) in enumerate(curves.items()):
        curve, style = whole.thinned(), style_of(number)
        text = f'{name}  average {whole.average_precision:.4f}' + ABOUT_DOT * (name in settings)
        axes.plot(curve.recall, curve.precision, label=text, drawstyle='steps-pre', **style)
        if dot := settings.get(name):
            _mark(axes, dot.recall.ratio, dot.precision.ratio, style['color'])
    dress(axes, 'recall: share of the outliers rejected', 'precision: outliers among the rejected')
    axes.set_xlim(0, 1.01)
    axes.set_ylim(0, 1.01)
    legend(figure, axes, 'best')
    return save(figure, path)


def check(series: Mapping[str, Any]) -> None:
    """Refuse a picture without curves."""
    if not series:
        raise FilterError('what is to be drawn', 'at least one curve', 'none')


def style_of(number: int) -> dict[str, Any]:
    """Return colour and dashes of a curve, by its number."""
    return {
        'color': COLOURS[number % len(COLOURS)],
        'linestyle': DASHES[number // len(COLOURS) % len(DASHES)],
        'linewidth': 1.7,
    }


def _mark(axes: Axes, x: float, y: float, colour: str) -> None:
    """Mark what the threshold in use gave; without anything rejected there is no precision."""
    if np.isfinite([x, y]).all():
        axes.plot([x], [y], 'o', markersize=7, color=colour, markeredgecolor='white', clip_on=False)


def dress(axes: Axes, x_label: str, y_label: str) -> None:
    """Name the axes, and apply the common style."""
    axes.set_xlabel(x_label, fontsize=11, color=INK)
    axes.set_ylabel(y_label, fontsize=11, color=INK)
    axes.tick_params(labelsize=10, colors=INK, length=3)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)
    for side in ('left', 'bottom'):
        axes.spines[side].set_color(FRAME)


def legend(figure: Figure, axes: Axes, where: str) -> None:
    """Name the curves within the picture, or, if they are many, beside it."""
    handles, labels = axes.get_legend_handles_labels()
    style: dict[str, Any] = {'fontsize': 9, 'labelcolor': INK, 'framealpha': 0.9}
    if len(handles) > MAX_CURVES_INSIDE:
        figure.set_figwidth(figure.get_figwidth() + BESIDE)
        box = figure.legend(handles, labels, loc='outside right upper', **style)
    else:
        corner: Any = where
        box = axes.legend(handles, labels, loc=corner, **style)
    box.get_frame().set_edgecolor(GRID)


def save(figure: Figure, path: Path) -> list[Path]:
    """Write the picture in all forms; without a date and with fixed names inside."""
    FigureCanvasAgg(figure)
    files = [path.with_name(path.name + suffix) for suffix in PICTURE_SUFFIXES]
    with (
        refusing(RecordingError, f'the picture {path}', 'written', OSError),
        rc_context({'svg.hashsalt': path.name}),
    ):
        for file in files:
            extra: dict[str, Any] = {'Date': None} if file.suffix == '.svg' else {}
            figure.savefig(file, dpi=DPI, metadata=extra)
    return files
