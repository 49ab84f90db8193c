# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What sensors scan: sweeps of one that spins, drives of a profile scanner; their scan patterns."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import measure
from lidar_outlier_filter.core.detectors.boosted_trees.profile_features import find_of_block
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared, prepare
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern

TURN_NS = 100_000_000  # ten turns a second
RATE = -2 * np.pi / TURN_NS  # rad/ns: clockwise
RINGS = (-20.0, -14.0, -9.0, -6.0, -3.0, 0.0, 4.0, 9.0)  # degrees
PERIOD = 5_000_000  # nanoseconds of a line
AXES = np.array([[0.6, 0.8, 0.0], [0.16, -0.12, 0.98]])  # of the scan plane: level, and nearly up
SPEED = np.array([8.0, 1.0, 0.0])


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
    points = points_of(far[:, None] * flat, t, ring)
    return points.take(kept)


def edges() -> tuple[Points, Bools]:
    """Return a near wall, a far one and a pole, and the mixed points of every second ring."""
    columns, rings = 360, 8
    shot = np.arange(columns * rings)
    ring, column = shot % rings, shot // rings
    azimuth = -2 * np.pi * column / columns
    up = np.radians(np.linspace(-14.0, 14.0, rings))[ring]
    far = np.where(column < 180, 4.0 + 0.005 * column, 9.0)
    mixed, pole = (column == 180) & (ring % 2 > 0), (column == 250) | (column == 251)
    far[mixed], far[pole] = 6.5, 5.0
    level = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(up)], axis=1)
    return points_of(far[:, None] * level, column * 277_777 + ring, ring), mixed


def pattern_of(points: Points) -> Pattern:
    """Return the pattern that there must be."""
    pattern = find_pattern(points)
    assert pattern is not None
    return pattern


def measured(pattern: Pattern) -> Singles:
    """Return the features of all cells."""
    return measure(prepare(pattern))


class Mirror(NamedTuple):
    """A mirror that swings so far to either side, and back in the next line (``way`` -1)."""

    swing: float
    way: int
    pendulum: bool

    def angle(self, part: Floats, line: Ints) -> Floats:
        """Return the angle at each part of a line, rad."""
        wave = -np.cos(np.pi * part) if self.pendulum else 2.0 * part - 1.0
        return 2.0 + self.swing * wave * np.where(line % 2 == 1, self.way, 1)


class Drive:
    """A passage between walls, seen by some lines; returns are lost, and some strays hang there."""

    def __init__(  # noqa: PLR0913  what is drawn
        self,
        seed: int,
        lost: float = 0.0,
        lines: int = 12,
        shots: int = 120,
        strays: float = 0.02,
        mirror: Mirror | None = None,
        faster: float = 1.0,
    ) -> None:
        rng = np.random.default_rng(seed)
        shot = np.arange(lines * shots)
        part, line = (shot % shots) / shots, shot // shots
        self.angle = 2 * np.pi * part if mirror is None else mirror.angle(part, line)
        t = shot * (PERIOD // shots)
        eye = np.array([0.0, 0.5, 2.0]) + faster * SPEED * (t * 1e-9)[:, None]
        beam = np.cos(self.angle)[:, None] * AXES[1] + np.sin(self.angle)[:, None] * AXES[0]
        beam /= np.linalg.norm(beam, axis=1)[:, None]
        walls = np.where(beam[:, 1:] > 0, [5.0, 9.0], [-6.0, 0.0])
        far = ((walls - eye[:, 1:]) / beam[:, 1:]).min(axis=1)
        far = far + 0.004 * rng.standard_normal(len(far))
        stray = rng.random(len(shot)) < strays
        far[stray] *= rng.uniform(0.2, 0.9, int(stray.sum()))
        kept = np.flatnonzero(rng.random(len(shot)) >= lost)
        self.t, self.line = t[kept], line[kept]
        self.eye, self.beam = eye[kept], beam[kept]
        self.far, self.angle, self.stray = far[kept], self.angle[kept], stray[kept]
        self.points = self.measured(self.far)

    def measured(self, far: Floats) -> Points:
        """Return points at other ranges."""
        return points_of(self.eye + far[:, None] * self.beam, self.t, self.line)


def points_of(xyz: Floats, t: Ints | None = None, line: Ints | None = None) -> Points:
    """Make points, all of them valid; times and lines that are not given are 0."""
    zeros = np.zeros(len(xyz), np.int64)
    times, lines = (zeros if given is None else np.ascontiguousarray(given) for given in (t, line))
    return Points(np.ascontiguousarray(xyz), times, lines, np.ones(len(xyz), np.bool_))


def profile_pattern_of(points: Points) -> Pattern:
    """Return the pattern that there must be."""
    pattern = find_profile_pattern(points)
    assert pattern is not None
    return pattern


def prepared(pattern: Pattern) -> Prepared:
    """Return the pattern with what its windows share."""
    found = prepare(pattern)
    return found._replace(of_block=find_of_block(pattern, found.near))


def road(seed: int, lines: int = 20, shots: int = 40, strays: float = 0.02) -> tuple[Points, Bools]:
    """Measure a road, 2 m below, and a wall by a profile scanner; strays hang above it."""
    rng = np.random.default_rng(seed)
    angle = np.tile(np.linspace(-0.9, 0.9, shots), lines)
    y = np.minimum(2.0 * np.tan(angle), 2.0)
    z = np.where(y < 2.0, 0.0, 2.0 - 2.0 / np.tan(np.maximum(angle, 0.1)))
    xyz = np.stack([np.repeat(np.arange(lines) * 0.06, shots), y, z - 2.0], axis=1)
    xyz += rng.normal(0, 0.004, xyz.shape)
    stray = rng.random(len(xyz)) < strays
    xyz[stray, 2] += rng.uniform(0.2, 1.5, np.count_nonzero(stray))
    t = np.repeat(np.arange(lines) * shots * 2, shots) + np.tile(np.arange(shots), lines)
    return points_of(xyz, t * 5000, np.repeat(np.arange(lines), shots)), stray
