# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A sensor's intensities as reflectances, and back again, whatever their unit.

Makers give intensities in units of their own, with or without the range taken out. So what counts
is how bright a point is compared with what is usual at its range: the median there is a surface of
the reflectance ``TYPICAL``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Floats


TYPICAL = 0.25
DARKEST, BRIGHTEST = 0.02, 2.0  # reflectances; more than 1 is what sends light straight back
BINS = 12  # of the logarithm of the range
ENOUGH = 30  # points of a bin that show its median


class Brightness:
    """What is usual at each range, learnt from one cloud."""

    def __init__(self, distance: Floats, values: Floats) -> None:
        """Take the ranges (N,) of some points, metres, and their intensities (N,)."""
        position = np.log(distance)
        edges = np.linspace(position.min(), position.max() + 1e-9, BINS + 1)
        bins = np.digitize(position, edges) - 1
        known = [k for k in range(BINS) if (bins == k).sum() >= ENOUGH]
        median = [float(np.median(values[bins == k])) for k in known]
        pairs = [(edges[k : k + 2].mean(), m) for k, m in zip(known, median, strict=True) if m > 0]
        # Where nothing is bright, nothing can be said: all is alike.
        self._where = np.array([where for where, _ in pairs] or [0.0])
        self._usual = np.array([usual for _, usual in pairs] or [1.0])
        self._known = bool(pairs)

    def reflectance(self, distance: Floats, values: Floats) -> Floats:
        """Return reflectances (N,), cosine of incidence included, from intensities."""
        if not self._known:
            return np.full(len(values), TYPICAL)
        bright: Floats = TYPICAL * values / self._at(distance)
        return np.clip(bright, DARKEST, BRIGHTEST)

    def intensity(self, distance: Floats, reflectance: Floats) -> Floats:
        """Return the intensities (N,) of what sends back so much."""
        value: Floats = reflectance / TYPICAL * self._at(distance)
        return value

    def _at(self, distance: Floats) -> Floats:
        usual: Floats = np.interp(np.log(distance), self._where, self._usual)
        return usual
