# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of figures against a parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from lidar_outlier_filter.evaluation import plots

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


def draw_lines(  # noqa: PLR0913  all that a plain picture needs
    series: Mapping[str, Sequence[float]],
    x: Sequence[float],
    path: Path,
    *,
    x_label: str,
    y_label: str,
    from_zero: bool = False,
    colours: Mapping[str, str] | None = None,
) -> list[Path]:
    """Draw figures against a parameter: area under the curve against k, time against points.

    Parameters
    ----------
    series : values at each x, by the name that the legend gives them; NaN leaves a gap
    x : ascending
    path : without suffix
    x_label, y_label : with units
    from_zero : let both axes begin at 0, as where a straight line through it is claimed
    colours : '#rrggbb' by name; None: one after the other of :data:`COLOURS`

    """
    plots.check(series)
    figure = Figure((6.4, 4.4), facecolor='white', layout='constrained')
    axes = figure.subplots()
    for number, (name, values) in enumerate(series.items()):
        look = (
            plots.look_of(number)
            if colours is None
            else plots.look_of(0) | {'color': colours[name]}
        )
        axes.plot(x, values, label=name, marker='o', markersize=4, **look)
    plots.dress(axes, x_label, y_label)
    if from_zero:
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
    plots.legend(figure, axes, 'best')
    return plots.save(figure, path)
