# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a detector finds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats


@dataclass(frozen=True)
class Scores:
    """What a detector finds of N points, in the order in which it sees them.

    Attributes
    ----------
    score : (N,) float64
        Statistic ÷ critical value: a point is rejected where it is greater than 1. NaN where the
        detector cannot decide.
    extra : (N,) uint16, optional
        Bits beside that of the detector, which say more of a rejected point and have no vote.
    passes : int
        Number of passes over the points, where the detector counts them.
    reason : (N,) uint8, optional
        Numbers that say why points are rejected; 0 for the others.
    scaled : bool
        Whether another threshold would divide the same statistics: nothing else depends on it.
    method : str
        Name of the method, if the detector has several.

    """

    score: Floats
    extra: NDArray[np.uint16] | None = None
    passes: int = 0
    reason: NDArray[np.uint8] | None = None
    scaled: bool = False
    method: str = ''
