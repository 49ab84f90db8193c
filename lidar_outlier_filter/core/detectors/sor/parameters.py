# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the distances to neighbours."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class Sor(Section):
    """Distance to the nearest neighbours."""

    k: int = declare(20, 'Neighbours whose mean distance counts, the point left out.', '', 1, 1000)
    statistic: str = declare(
        'sor',
        'sor: mean distance against mean + multiplier × standard deviation of all; sor2: its '
        'absolute difference from the median against limit; radius: min_neighbors within radius.',
        choices=('sor', 'sor2', 'radius'),
    )
    multiplier: float = declare(2.0, 'Standard deviations above the mean of all.', '', 0.0, 1000.0)
    limit: float = declare(
        0.1, 'Largest absolute difference from the median (sor2).', 'm', 1e-6, 1e6
    )
    radius: float = declare(
        0.5, 'Radius in which min_neighbors others must be (radius).', 'm', 1e-6, 1e6
    )
    min_neighbors: int = declare(3, 'Fewest others within the radius (radius).', '', 1, 1000)
    range_scaled: bool = declare(
        default=False,
        text='Let the limit grow with the distance from the origin: sor, sor2: the limit × '
        'range_factor × range (DSOR); radius: at least range_factor × range (DROR).',
    )
    range_factor: float = declare(0.05, 'Growth of the limit with the range.', '1/m', 1e-9, 1e3)

    @property
    def list_length(self) -> int:
        """Length of the neighbour lists that the statistic needs."""
        return self.min_neighbors if self.statistic == 'radius' else self.k
