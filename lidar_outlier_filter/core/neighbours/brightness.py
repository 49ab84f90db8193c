# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How bright returns are: intensity ÷ what is usual at their range, whatever its unit.

Makers give intensities in units of their own, with or without the range taken out. So the median
of the same points at about the same range is what counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.kernels import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Ints = NDArray[np.int64]
    Singles = NDArray[np.float32]

# Metres. Two to an octave, which single precision holds exactly.
EDGES = np.array([s * 2.0**k for k in range(-1, 8) for s in (1.0, 1.5)], np.float32)
EVERY = 4  # the part of the places that shows what is usual
ENOUGH = 30  # of them between two edges; fewer show nothing
BRIGHTEST = np.float32(8.0)
UNKNOWN = np.float32(-1.0)


@kernel
def write_brightness(order: Ints, reach: Singles, intensity: Singles, bright: Singles) -> None:
    """Write the brightness (M,) of each place; ``UNKNOWN`` where nothing is usual.

    Parameters
    ----------
    order : (M,) which of the N points is at each place; -1 for none
    reach : (M,) metres
    intensity : (N,) of the points; NaN and less than 0 are unknown
    bright : (M,) is written

    """
    usual = _usual(order, reach, intensity)
    for k in range(len(order)):
        i = order[k]
        bright[k] = UNKNOWN
        if i >= 0:
            median, value = usual[np.searchsorted(EDGES, reach[k])], intensity[i]
            if median > 0 and value >= 0:
                bright[k] = min(value / median, BRIGHTEST)


@kernel
def _usual(order: Ints, reach: Singles, intensity: Singles) -> Singles:
    """Return the median intensity between edges; 0 where there are too few."""
    count = np.zeros(len(EDGES) + 1, np.int64)
    values = np.empty((len(EDGES) + 1, len(order) // EVERY + 1), np.float32)
    for k in range(0, len(order), EVERY):
        i = order[k]
        if i >= 0 and intensity[i] >= 0:
            b = np.searchsorted(EDGES, reach[k])
            values[b, count[b]] = intensity[i]
            count[b] += 1
    usual = np.zeros(len(count), np.float32)
    for b in range(len(count)):
        if count[b] >= ENOUGH:
            usual[b] = np.median(values[b, : count[b]])
    return usual
