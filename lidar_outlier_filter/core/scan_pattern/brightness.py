# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How bright returns are: intensity ÷ what is usual at their range, whatever its unit.

Makers give intensities in units of their own, with or without the range taken out. So the median
of the same points at about the same range is what counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import inner_kernel, kernel

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Ints, Singles

# Metres. Two to an octave, which single precision holds exactly.
EDGES = np.array([s * 2.0**k for k in range(-1, 8) for s in (1.0, 1.5)], np.float32)
EVERY = 4  # the part of the cells that shows what is usual
ENOUGH = 30  # of them between two edges; fewer show nothing
CELLS_AT_ONCE = 16_384
BRIGHTEST = np.float32(8.0)
UNKNOWN = np.float32(-1.0)


def write_brightness(
    order: Ints, reach: Singles, intensity: Singles, bright: Singles, threads: int = 0
) -> None:
    """Write the brightness (M,) of each cell; ``UNKNOWN`` where nothing is usual.

    Parameters
    ----------
    order : (M,) which of the N points is at each cell; -1 for none
    reach : (M,) metres
    intensity : (N,) of the points; NaN and less than 0 are unknown
    bright : (M,) is written
    threads : at most so many at once; 0 for as many as there are cores

    """
    count = np.zeros(len(EDGES) + 1, np.int64)
    values = np.empty((len(count), len(order) // EVERY + 1), np.float32)
    _collect(order, reach, intensity, count, values)
    usual = np.zeros(len(count), np.float32)  # 0 where there are too few
    for b in np.flatnonzero(count >= ENOUGH):
        usual[b] = np.median(values[b, : count[b]])
    pool.run(
        lambda i, j: _compare(order, reach, intensity, usual, i, j, bright),
        *(len(order), CELLS_AT_ONCE, threads),
    )


@inner_kernel
def _bin(reach: np.float32) -> int:
    """Count the edges that are nearer."""
    count = 0
    for edge in range(len(EDGES)):
        count += EDGES[edge] < reach
    return count


@kernel
def _collect(order: Ints, reach: Singles, intensity: Singles, count: Ints, values: Singles) -> None:
    """Collect intensities between edges."""
    for k in range(0, len(order), EVERY):
        i = order[k]
        if i >= 0 and intensity[i] >= 0:
            b = _bin(reach[k])
            values[b, count[b]] = intensity[i]
            count[b] += 1


@kernel
def _compare(
    order: Ints,
    reach: Singles,
    intensity: Singles,
    usual: Singles,
    begin: int,
    end: int,
    bright: Singles,
) -> None:
    """Divide intensities by what is usual."""
    for k in range(begin, end):
        i = order[k]
        bright[k] = UNKNOWN
        if i >= 0:
            middle, value = usual[_bin(reach[k])], intensity[i]
            if middle > 0 and value >= 0:
                bright[k] = min(value / middle, BRIGHTEST)
