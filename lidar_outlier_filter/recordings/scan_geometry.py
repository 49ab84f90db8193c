# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the scan lines of a cloud lie: how many, how far apart, how dense."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.core.points.scan_lines import line_starts, order_by_line

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.points.points import Points

LEVEL = math.radians(1)  # deviation in elevation up to which a line is a ring
EVEN = 0.1  # of the median step, up to which rings are evenly spaced
FEWEST = 3  # points of a line that says where it lies


@dataclass(frozen=True)
class ScanGeometry:
    """What one cloud shows.

    Attributes
    ----------
    lines : scan lines
    per_line : points of a line, the median
    seconds : between its first and its last point
    near, far : the nearest 1 % of the points, and the farthest, are beyond; m
    invalid : share of the points without a return
    low, high : elevation of the rings, degrees; nan where lines are not level around the sensor
    step, even : between rings, the median, degrees; and whether all are alike
    azimuth : between two points of a ring, the median, degrees

    """

    lines: int
    per_line: float
    seconds: float
    near: float
    far: float
    invalid: float
    low: float = math.nan
    high: float = math.nan
    step: float = math.nan
    even: bool = False
    azimuth: float = math.nan

    @property
    def is_spinning(self) -> bool:
        """Whether the lines are rings around the sensor."""
        return not math.isnan(self.low)


def scan_geometry(points: Points) -> ScanGeometry | None:
    """Look at the points of a cloud; None where none is valid."""
    invalid = 1 - float(points.valid.mean()) if len(points) else 1.0
    points = points.take(points.valid)
    if not len(points):
        return None
    points = points.take(order_by_line(points))
    bounds = line_starts(points.line)
    near, far = np.percentile(points.range, (1, 99))
    found = ScanGeometry(
        len(bounds) - 1,
        float(np.median(np.diff(bounds))),
        int(points.t.max() - points.t.min()) / SECOND,
        float(near),
        float(far),
        invalid,
    )
    return _with_rings(found, points, bounds)


def _with_rings(found: ScanGeometry, points: Points, bounds: NDArray[np.int64]) -> ScanGeometry:
    """Add the angles of rings, if lines are rings."""
    x, y, z = points.xyz.T
    elevation, azimuth = np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)
    lines = [slice(begin, end) for begin, end in pairwise(bounds) if end - begin >= FEWEST]
    if not lines:
        return found
    middles = np.array([np.median(elevation[line]) for line in lines])
    spread = [np.median(abs(elevation[line] - m)) for line, m in zip(lines, middles, strict=True)]
    if np.median(spread) > LEVEL or np.ptp(azimuth) < math.pi / 8:
        return found
    steps = np.diff(np.sort(middles))
    turns = np.concatenate([np.diff(azimuth[line]) for line in lines])
    turns = abs((turns + math.pi) % (2 * math.pi) - math.pi)
    return replace(
        found,
        low=math.degrees(middles.min()),
        high=math.degrees(middles.max()),
        step=math.degrees(np.median(steps)) if len(steps) else math.nan,
        even=bool(len(steps) and np.ptp(steps) <= EVEN * np.median(steps)),
        azimuth=math.degrees(np.median(turns)),
    )
