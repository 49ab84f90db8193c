# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of a mask: as the sensor sees its vehicle, and from above."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.core.points.mask import COLUMNS
from lidar_outlier_filter.evaluation.plots import DPI, FRAME, dress

if TYPE_CHECKING:
    from pathlib import Path

    from lidar_outlier_filter.core.points.mask import Mask


def draw_mask(mask: Mask, path: Path) -> None:
    """Draw a mask as a PNG: ranges by azimuth and ring, and the vehicle from above."""
    figure = Figure((10.5, 4.0), facecolor='white', layout='constrained')
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
