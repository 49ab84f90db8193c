# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Turns of a sensor with 16 rings above a flat road, far walls, and a vehicle on its left front."""

import numpy as np

from helpers.clouds import SECOND, STAMP
from lidar_outlier_filter.core.annotations import Rows

RINGS, COLUMNS = 16, 360
ROW = np.dtype([('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('t', 'u4'), ('ring', 'u2'), ('own', 'u1')])
ELEVATION = np.radians(np.linspace(-24, 6, RINGS))
HEIGHT, OWN_RANGE, TURN = 1.8, 1.5, SECOND // 10


def turn(number: int, *, place: int | None = None, rain: int = 0) -> Rows:
    """Measure a turn; ``place`` is where the vehicle is: by default each turn is elsewhere.

    The first ``rain`` shots of ring 15 are drops, 4 m away.
    """
    rng = np.random.default_rng([number, 1])
    walls = np.random.default_rng([number if place is None else place, 2])
    azimuth = np.tile(np.radians(np.arange(COLUMNS) + rng.uniform(0, 1)), (RINGS, 1))
    ranges = np.tile(np.repeat(walls.uniform(12, 60, COLUMNS // 10), 10), (RINGS, 1))
    down = np.radians(-3) > ELEVATION
    ground = HEIGHT / np.sin(-ELEVATION[down])
    ranges[down] = np.minimum(ranges[down], ground[:, np.newaxis])
    own = np.zeros(ranges.shape, np.bool_)
    own[2:12] = np.abs(np.degrees(azimuth[2:12]) - 40) < 20
    ranges[own] = OWN_RANGE
    ranges[15, :rain] = 4.0
    ranges += rng.normal(0, 0.01, ranges.shape)
    rows = np.zeros(ranges.shape, ROW)
    level = ranges * np.cos(ELEVATION)[:, np.newaxis]
    rows['x'], rows['y'] = level * np.cos(azimuth), level * np.sin(azimuth)
    rows['z'] = ranges * np.sin(ELEVATION)[:, np.newaxis]
    rows['t'] = (np.arange(COLUMNS) * (TURN // COLUMNS))[np.newaxis]
    rows['ring'], rows['own'] = np.arange(RINGS)[:, np.newaxis], own
    return rows.T.reshape(-1)  # in the order of time


def stamp(number: int) -> int:
    """Return the time of a turn, nanoseconds."""
    return STAMP + number * TURN
