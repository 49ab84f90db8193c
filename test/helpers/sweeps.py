# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sweeps of a spinning sensor, and their scan pattern."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.detectors.boosted_trees.pattern_values import measure
from lidar_outlier_filter.core.detectors.boosted_trees.window import prepare
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern

TURN_NS = 100_000_000  # ten turns a second
RATE = -2 * np.pi / TURN_NS  # rad/ns: clockwise
RINGS = (-20.0, -14.0, -9.0, -6.0, -3.0, 0.0, 4.0, 9.0)  # degrees


def sweep(  # noqa: PLR0913
    seed: int,
    lost: float,
    turns: float = 1.0,
    *,
    columns: int = 90,
    staggered: bool = False,
    elevations: Sequence[float] = RINGS,
) -> Points:
    """Return a room seen by some rings, some of whose returns are lost or anywhere."""
    rng = np.random.default_rng(seed)
    rings, step = len(elevations), round(1e8 / columns)
    columns = round(columns * turns)
    shot = np.arange(columns * rings)
    ring, column = shot % rings, shot // rings
    # No head turns so evenly that a return is exactly as far as windows reach.
    uneven = rng.integers(0, step // 25, columns)[column]
    t = column * step + uneven + (0 if staggered else ring * 1000)
    offset = 0.03 * (ring % 4) if staggered else 0.0
    azimuth = 2.0 + RATE * t + offset
    up = np.radians(np.array(elevations))[ring]
    far = np.minimum(
        8.0 / np.maximum(np.abs(np.cos(azimuth)), 1e-9),
        5.0 / np.maximum(np.abs(np.sin(azimuth)), 1e-9),
    )
    far = far + 0.01 * rng.standard_normal(len(shot))
    stray = rng.random(len(shot)) < 0.05
    far[stray] *= rng.uniform(0.2, 0.9, int(stray.sum()))
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(up)], axis=1)
    kept = rng.random(len(shot)) >= lost
    points = Points(far[:, None] * flat, t, ring, np.ones(len(shot), np.bool_))
    return points.take(kept)


def pattern_of(points: Points) -> Pattern:
    """Return the pattern that there must be."""
    pattern = find_pattern(points)
    assert pattern is not None
    return pattern


def measured(pattern: Pattern) -> NDArray[np.float32]:
    """Return the features of all cells."""
    return measure(prepare(pattern))
