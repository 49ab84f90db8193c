# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the local outlier factor."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class Lof(Section):
    """Local outlier factor: density against that of the neighbours."""

    min_pts: int = declare(20, 'Neighbours that make the density; ties count too.', '', 1, 1000)
    threshold: float = declare(
        1.2, 'Rejected above this factor; lof2: above this difference.', '', 1e-6, 1e9
    )
    statistic: str = declare(
        'lof',
        'lof: the factor; lof2: its absolute difference from the median of all.',
        choices=('lof', 'lof2'),
    )
