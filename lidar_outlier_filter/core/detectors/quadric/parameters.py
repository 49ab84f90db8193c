# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the quadric surfaces."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.parameters.declaration import Section, declare

MIN_POINTS = 12  # of a surface


@dataclass(frozen=True)
class Quadric(Section):
    """Quadric surfaces through the neighbourhood."""

    window: str = declare(
        'section',
        'section: all points of a section of the cloud are tested against its surface; patch: each '
        'point against that of its own neighbours, slow.',
        choices=('section', 'patch'),
    )
    section: int = declare(
        64, 'Most points that a section judges; those around it support them.', '', 16, 10_000
    )
    k: int = declare(30, 'Neighbours in the patch around each point.', '', 10, 1000)
    significance: float = declare(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    surfaces: int = declare(
        3, 'Most surfaces looked for in one window, under model: lowest.', '', 1, 10
    )
    model: str = declare(
        'lowest',
        'lowest: a plane or a paraboloid where it will do, of the half that agrees best; always: '
        'all ten parameters, fitted to all points of the window, and one surface (the paper).',
        choices=('lowest', 'always'),
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )

    @property
    def list_length(self) -> int:
        """Length of the neighbour lists that the windows need."""
        return self.k if self.window == 'patch' else 1
