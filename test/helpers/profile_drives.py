# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of a profile scanner, and their scan pattern."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.profile_groups import (
    find_groups,
)
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared, prepare
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.scan_pattern.profile_pattern import find_profile_pattern

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Floats
    from lidar_outlier_filter.core.scan_pattern.placed_pattern import Pattern

PERIOD = 5_000_000  # nanoseconds of a line
AXES = np.array([[0.6, 0.8, 0.0], [0.16, -0.12, 0.98]])  # of the scan plane: level, and nearly up
SPEED = np.array([8.0, 1.0, 0.0])


class Drive:
    """A passage between walls, seen by some lines; returns are lost, and some strays hang there."""

    def __init__(
        self, seed: int, lost: float = 0.0, lines: int = 12, shots: int = 120, strays: float = 0.02
    ) -> None:
        rng = np.random.default_rng(seed)
        shot = np.arange(lines * shots)
        self.angle = 2 * np.pi * (shot % shots) / shots
        t = shot * (PERIOD // shots)
        eye = np.array([0.0, 0.5, 2.0]) + SPEED * (t * 1e-9)[:, None]
        beam = np.cos(self.angle)[:, None] * AXES[1] + np.sin(self.angle)[:, None] * AXES[0]
        beam /= np.linalg.norm(beam, axis=1)[:, None]
        walls = np.where(beam[:, 1:] > 0, [5.0, 9.0], [-6.0, 0.0])
        far = ((walls - eye[:, 1:]) / beam[:, 1:]).min(axis=1)
        far = far + 0.004 * rng.standard_normal(len(far))
        stray = rng.random(len(shot)) < strays
        far[stray] *= rng.uniform(0.2, 0.9, int(stray.sum()))
        kept = np.flatnonzero(rng.random(len(shot)) >= lost)
        self.t, self.line = t[kept], (shot // shots)[kept]
        self.eye, self.beam = eye[kept], beam[kept]
        self.far, self.angle, self.stray = far[kept], self.angle[kept], stray[kept]
        self.points = self.measured(self.far)

    def measured(self, far: Floats) -> Points:
        """Return points at other ranges."""
        return points_of(self.eye + far[:, None] * self.beam, self.t, self.line)


def points_of(xyz: Floats, t: NDArray[np.int64], line: NDArray[np.int64]) -> Points:
    """Make points, all of them valid."""
    return Points(xyz, t, line, np.ones(len(t), np.bool_))


def pattern_of(points: Points) -> Pattern:
    """Return the pattern that there must be."""
    pattern = find_profile_pattern(points)
    assert pattern is not None
    return pattern


def prepared(pattern: Pattern) -> Prepared:
    """Return the pattern with what its windows share."""
    found = prepare(pattern)
    return found._replace(groups=find_groups(pattern, found.near))
