# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A road with a barrier arm, and sweeps of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.points.points import Points

if TYPE_CHECKING:
    from lidar_outlier_filter.core.annotations import Bools, Floats


def points_of(xyz: Floats, t: Any, line: Any) -> Points:
    """Make points."""
    return Points(xyz, t.astype(np.int64), line.astype(np.int64), np.ones(len(xyz), np.bool_))


def road(seed: int, lines: int = 20, shots: int = 40, strays: float = 0.02) -> tuple[Points, Bools]:
    """Measure a road and a wall by lines of a profile scanner; strays hang above it."""
    rng = np.random.default_rng(seed)
    angle = np.tile(np.linspace(-0.9, 0.9, shots), lines)
    y = np.minimum(2.0 * np.tan(angle), 2.0)
    z = np.where(y < 2.0, 0.0, 2.0 - 2.0 / np.tan(np.maximum(angle, 0.1)))
    xyz = np.stack([np.repeat(np.arange(lines) * 0.06, shots), y, z], axis=1)
    xyz += rng.normal(0, 0.004, xyz.shape)
    stray = rng.random(len(xyz)) < strays
    xyz[stray, 2] += rng.uniform(0.2, 1.5, np.count_nonzero(stray))
    t = np.repeat(np.arange(lines) * shots * 2, shots) + np.tile(np.arange(shots), lines)
    return points_of(xyz, t * 5000, np.repeat(np.arange(lines), shots)), stray


def sweep(seed: int, rings: int = 32, columns: int = 600) -> tuple[Points, Bools]:
    """Measure the ground and a wall around by a spinning sensor, in snow."""
    rng = np.random.default_rng(seed)
    ring, column = np.tile(np.arange(rings), columns), np.repeat(np.arange(columns), rings)
    down, azimuth = 0.1 + 0.4 * ring / rings, column * (2 * np.pi / columns)
    distance = np.minimum(1.8 / np.sin(down), 9.0 / np.cos(down)) + rng.normal(0, 0.02, len(ring))
    snow = rng.random(len(ring)) < 0.03
    distance[snow] *= rng.uniform(0.2, 0.8, np.count_nonzero(snow))
    flat = distance * np.cos(down)
    xyz = [flat * np.cos(azimuth), flat * np.sin(azimuth), -distance * np.sin(down)]
    return points_of(np.stack(xyz, axis=1), column * 50_000, ring), snow


def arm(seed: int, *, beside: bool = False) -> tuple[Points, Bools]:
    """Hang a slanted tube above a road, where lines cross it, or with its end beside a panel."""
    points, _ = road(seed, lines=24, strays=0.0)
    rng = np.random.default_rng(seed)
    shot, count = np.arange(len(points)) % 40, len(points)
    slanted = (shot >= 14) & (shot < 17)
    along = points.line / 8 + (shot - 14) * 0.03
    xyz = points.xyz.copy()
    xyz[slanted, 1] = -1.2 + 0.8 * along[slanted]
    xyz[slanted, 2] = 1.0 + 0.6 * along[slanted]
    panel = beside & (shot >= 20) & (shot < 28) & (points.line >= 18)
    xyz[panel, 1], xyz[panel, 2] = 1.35, 2.5 + 0.05 * (shot[panel] - 20)
    moved = slanted | panel
    xyz[moved] += rng.normal(0, 0.004, (count, 3))[moved]
    return points_of(xyz, points.t, points.line), slanted
