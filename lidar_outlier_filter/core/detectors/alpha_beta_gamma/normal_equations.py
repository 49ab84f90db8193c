# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The predictions of the α-β-γ smoother: the normal equations of (14), summed and solved.

Two loops give the same figures. The one in tiles adds one offset of the window at a time to many
points at once, which processors do four or eight at a stroke; it needs windows without holes. The
other follows the links of one point at a time, past ends of segments and rejected points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma

CENTRED, BEFORE, AFTER = 0, 1, 2  # the windows of a point
T, X, WEIGHT, RATE = 0, 1, 4, 5  # rows of the columns
TILE = 128  # points at once, as in the .cpp file beside this one


@dataclass(frozen=True)
class Series:
    """The points of a block along their segments; rejected ones are taken out of the links.

    Attributes
    ----------
    columns : (6, M) float64
        Rows T to RATE of the N points: time after the first one in nanoseconds, x, y, z in metres,
        weight (one over the variance of a coordinate, 1/m²; 1 where σ is common to the line and
        found later), and one over the line's shot interval, which makes time differences small
        numbers. They begin at ``pad`` and have zeros around them.
    pad : int
        Room for the longest reach of a window.
    before, after : (N,) int64
        Neighbours in the segment, -1 at its ends.

    """

    columns: NDArray[np.float64]
    pad: int
    before: NDArray[np.int64]
    after: NDArray[np.int64]

    def __len__(self) -> int:
        """Count the points."""
        return len(self.before)

    def row(self, which: int | slice) -> NDArray[np.float64]:
        """View one or more of the rows, without the padding."""
        return self.columns[which, self.pad : self.pad + len(self)]


def empty_series(pad: int, before: NDArray[np.int64], after: NDArray[np.int64]) -> Series:
    """Allocate for points with these links, in whole tiles, and one tile of zeros behind them."""
    tiles = -(-len(before) // TILE)
    return Series(np.zeros((6, pad + tiles * TILE + pad + TILE)), pad, before, after)


def residuals(
    series: Series, which: NDArray[np.int64], parameters: AlphaBetaGamma
) -> NDArray[np.float64]:
    """Return the standardised differences (17), before division by a σ common to the line.

    Returns
    -------
    (3, 3, M) float64
        For each window (centred, before, after) the x, y and z of the M points ``which``; NaN where
        the window is not usable.

    """
    result = np.empty((3, 3, len(which)))
    before, after = series.before, series.after
    fewest, either = parameters.min_window, parameters.sides == 'either'
    windows = (parameters.before, parameters.after, fewest, parameters.order, either)
    reaches = {BEFORE: parameters.before, AFTER: parameters.after}
    reaches[CENTRED] = sum(reaches.values())
    for side, reach in reaches.items():
        if reach < fewest or not (either or side == CENTRED):
            result[side] = np.nan
    if len(which) == len(series):
        # All of them: nothing is rejected yet, and segments are without holes.
        _kernels.predict_in_tiles(series.columns, series.pad, windows, result)
        which = slots = _near_ends(before, after, parameters.before, parameters.after)
    else:
        slots = np.arange(len(which))
    _kernels.predict_one_by_one(
        series.columns, series.pad, before, after, which, slots, windows, result
    )
    return result


def _near_ends(
    before: NDArray[np.int64], after: NDArray[np.int64], reach_before: int, reach_after: int
) -> NDArray[np.int64]:
    """Find the points with fewer in front or behind, in segments without holes, than windows."""
    index = np.arange(len(before))
    begin = np.maximum.accumulate(np.where(before < 0, index, 0))
    end = np.minimum.accumulate(np.where(after < 0, index, len(index))[::-1])[::-1]
    return np.flatnonzero((index - begin < reach_before) | (end - index < reach_after))
