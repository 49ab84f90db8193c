# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the quadric surfaces."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Section, declare


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
    surfaces: int = declare(3, 'Most surfaces looked for in one window: 1 is the paper.', '', 1, 10)
    start: str = declare(
        'robust',
        'First surface: robust: of the half that agrees best; all: of all points (the paper).',
        choices=('robust', 'all'),
    )
    model: str = declare(
        'lowest',
        'lowest: a plane or a paraboloid where it will do; always: all ten parameters, of whatever '
        'the window holds (the paper); letter: the same with its norm (19), along the axes of the '
        'cloud. Both need start: all and surfaces: 1.',
        choices=('lowest', 'always', 'letter'),
    )
    min_points: int = declare(
        12, 'Fewest points that make a surface; with fewer a point stays untested.', '', 11, 1000
    )
    sigma_floor: float = declare(
        0.005, 'Least standard deviation that an estimate may give.', 'm', 1e-6, 100.0
    )

    @property
    def list_length(self) -> int:
        """Length of the neighbour lists that the windows need."""
        return self.k if self.window == 'patch' else 1

    def check(self) -> None:
        """Refuse a robust start of quadrics that nothing may lower."""
        if self.model != 'lowest' and (self.start, self.surfaces) != ('all', 1):
            got = f'start: {self.start} and surfaces: {self.surfaces}'
            name = f'quadric.model {self.model}'
            raise ParameterError(name, 'with start: all and surfaces: 1', got)
