# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Profiles along a street before and after each method, as figure 3 of Leslar et al. (2010)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_lab.results.pictures import INK, LEFT, LOST, PAPER, add_legend, save

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from lidar_outlier_lab.results.samples import Sample

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

LENGTH = 14.0  # metres of a profile
HALF = 2.5  # metres to both sides of the middle of the outliers
LOW, HIGH = -0.15, 2.2  # metres
WIDTH, ROW, HEAD, DPI = 16.0, 2.2, 0.5, 90  # inches, of the whole, a row and the legend; per inch
COLOURS = 48  # of the palette: keeps the file small
ASPHALT = '#8d9299'
TITLES = {'a': '(a)', 'b': '(b)', 'c': '(c)', 'ab': '(a), then (b)'}


class Strip(NamedTuple):
    """A stretch of a road seen from the side.

    Attributes
    ----------
    flat : (M, 2) float64
        Along the street and up, metres.
    bad : (M,) bool
    rejected : verdicts (M,) by method

    """

    flat: Floats
    bad: Mask
    rejected: Mapping[str, Mask]


def strip(sample: Sample, rejected: Mapping[str, Mask]) -> Strip:
    """Cut out the stretch of a street that has the most outliers: the road and what is above it.

    The street runs along x; what stands beside the road is left out.
    """
    (xyz,) = sample.clouds
    bad = sample.data.bad
    on_road = bad if sample.surface is None else sample.surface == Kind.ROAD
    outliers = xyz[bad]
    starts = np.arange(xyz[:, 0].min(), max(xyz[:, 0].max() - LENGTH, xyz[:, 0].min()) + 1.0)
    inside = [
        np.count_nonzero((outliers[:, 0] >= x) & (outliers[:, 0] < x + LENGTH)) for x in starts
    ]
    begin = starts[int(np.argmax(inside))]
    along = (xyz[:, 0] >= begin) & (xyz[:, 0] < begin + LENGTH)
    middle = float(np.median(xyz[along & bad, 1])) if (along & bad).any() else 0.0
    shown = along & (np.abs(xyz[:, 1] - middle) < HALF) & (bad | on_road)
    flat = np.stack([xyz[shown, 0] - begin, xyz[shown, 2]], axis=1)
    return Strip(flat, bad[shown], {name: one[shown] for name, one in rejected.items()})


def draw(strips: Sequence[tuple[str, Strip]], path: Path) -> None:
    """Draw a row for each cloud: before, and after each method."""
    height = HEAD + ROW * len(strips)
    figure = Figure((WIDTH, height), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    for row, (name, one) in enumerate(strips):
        nothing = np.zeros(len(one.bad), np.bool_)
        panels = [('before', nothing), *one.rejected.items()]
        bottom = (height - HEAD - (row + 0.85) * ROW) / height
        for column, (title, rejected) in enumerate(panels):
            left = (column + 0.16) / len(panels)
            axes = figure.add_axes((left, bottom, 0.8 / len(panels), 0.67 * ROW / height))
            text = TITLES.get(title, title.partition(',')[0])
            axes.set_title(f'{name[-1].upper()}: {text}', fontsize=11, color=INK, pad=3)
            _panel(axes, one, rejected)
    entries = [('road', ASPHALT), ('outlier that is left', LEFT), ('road taken out', LOST)]
    add_legend(figure, entries)
    save(canvas, path, COLOURS)


def _panel(axes: Axes, one: Strip, rejected: Mask) -> None:
    for some, colour, size in (
        (~one.bad & ~rejected, ASPHALT, 0.4),
        (one.bad & ~rejected, LEFT, 5),
        (~one.bad & rejected, LOST, 5),
    ):
        axes.scatter(one.flat[some, 0], one.flat[some, 1], s=size, c=colour, linewidths=0)
    axes.set_xlim(0.0, LENGTH)
    axes.set_ylim(LOW, HIGH)
    axes.tick_params(labelsize=8, colors=INK, length=2, pad=1.5)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)
