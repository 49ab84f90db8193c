# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What chains that differ in a threshold only see of the same points: it is looked at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.detector_input import DetectorInput

if TYPE_CHECKING:
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.parameters.filter import FilterParameters

BLOCKS = 4  # that are remembered: chains judge a block one after the other, or some


class SharedSight:
    """Gives the chains that share it the same ``DetectorInput`` of the same points."""

    def __init__(self) -> None:
        """Remember nothing yet."""
        self._known: list[tuple[int, DetectorInput]] = []

    def __call__(
        self, points: Points, parameters: FilterParameters, neighbours: int, *, whole: bool
    ) -> DetectorInput:
        """Find what is known of points, or look at them."""
        for most, seen in self._known:
            if (most, seen.whole) == (neighbours, whole) and _are_equal(seen.points, points):
                return seen
        seen = DetectorInput(points, parameters, neighbours, whole=whole)
        self._known = [(neighbours, seen), *self._known[: BLOCKS - 1]]
        return seen


def _are_equal(one: Points, other: Points) -> bool:
    """Return whether points are the same to all detectors."""
    if len(one) != len(other):
        return False
    for name in ('t', 'line', 'xyz', 'sigma', 'own', 'intensity', 'ring'):
        a, b = getattr(one, name), getattr(other, name)
        if (a is None) != (b is None):
            return False
        if a is not None and not np.array_equal(a, b, equal_nan=a.dtype.kind == 'f'):
            return False
    return True
