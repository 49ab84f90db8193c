# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Bands of elevation in place of rings, for scanners that have none.

Where beams draw rosettes or zigzags, what is next in time lies on one curve. But seen from the
sensor points lie in all directions. So bands of elevation stand for rings. They are as high as
their points are apart: a point's neighbours are then those around it on all sides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.scan_pattern.recovered_rings import Origin, as_turn, elevations
from lidar_outlier_filter.core.scan_pattern.scan_pattern import TURN

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Floats, Ints
    from lidar_outlier_filter.core.points.points import Points

# Rad, 0.05° to 4.4°. Products are the same on every machine, powers are not.
HEIGHTS = TURN / 7200 * np.cumprod(np.full(92, 1.05))


def in_bands(points: Points) -> Points:
    """Take bands of elevation for the lines of valid points, and azimuths for their times."""
    xyz = points.in_own_frame.xyz
    turned = as_turn(replace(points, ring=np.zeros(len(points), np.int64)))
    flat = np.sqrt(xyz[:, 0] ** 2 + xyz[:, 1] ** 2)
    elevation = elevations(flat, np.ascontiguousarray(xyz[:, 2]), Origin(0.0, 0.0))
    reach = points.range
    # What is so near that its square is 0 has an elevation of 0.
    level = np.divide(flat, reach, out=np.ones(len(points)), where=reach > 0)
    height = find_height(elevation, turned.t, level)
    return replace(turned, line=_bands(elevation, height), ring=None)


def find_height(elevation: Floats, turned: Ints, level: Floats) -> float:
    """Return the least of ``HEIGHTS`` at which a band's points are no farther apart, rad.

    Parameters
    ----------
    elevation : (N,) of the points, rad
    turned : (N,) azimuth, in which a turn is a second of nanoseconds
    level : (N,) cosine of the elevation

    """
    low, high = 0, len(HEIGHTS) - 1
    while low < high:
        middle = (low + high) // 2
        if _apart(_bands(elevation, HEIGHTS[middle]), elevation, turned, level) <= HEIGHTS[middle]:
            high = middle
        else:
            low = middle + 1
    return float(HEIGHTS[low])


def _bands(elevation: Floats, height: float) -> Ints:
    return np.floor(elevation / height).astype(np.int64)


def _apart(band: Ints, elevation: Floats, turned: Ints, level: Floats) -> float:
    """Return the median angle between neighbours in a band, rad; inf where none has any."""
    order = np.lexsort((elevation, turned, band))
    same = np.flatnonzero(np.diff(band[order]) == 0)
    if not len(same):
        return np.inf
    angle = np.diff(turned[order])[same] * (TURN / SECOND) * level[order[same]]
    return float(np.median(angle))
