# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Poses that turn."""

import math

import numpy as np

from lidar_outlier_filter.core.points.points import Points

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
LEVEL = (0.0, 0.0, 0.0, 1.0)


def turned(degrees: float) -> tuple[float, ...]:
    """Return the quaternion of a turn to the left."""
    half = math.radians(degrees) / 2
    return (0.0, 0.0, math.sin(half), math.cos(half))


def points(*rows: tuple[float, float, float, float]) -> Points:
    """Make points of (seconds after the start, x, y, z)."""
    t, *xyz = np.array(rows).T
    whole = START + np.rint(t * SECOND).astype(np.int64)
    return Points(np.stack(xyz, axis=1), whole, np.zeros(len(t), int), np.ones(len(t), bool))
