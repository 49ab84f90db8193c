# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the elevations."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class Elevation(Section):
    """Elevation against the mean of the neighbours on the map, or against the ground."""

    against: str = declare(
        'neighbours',
        'neighbours: their mean elevation (the paper); ground: a local ground surface.',
        choices=('neighbours', 'ground'),
    )
    height: float = declare(
        50.0, 'Height above the ground that a point may have, against: ground.', 'm', 1e-3, 1e6
    )
    depth_counts: float = declare(
        50.0,
        'Metres above the ground that one below it counts as: the depth allowed is height ÷ this.',
        '',
        1e-3,
        1e6,
    )
    cell: float = declare(
        2.0,
        'Side of the cells whose lowest points make the ground; some points lie in each.',
        'm',
        1e-3,
        1e4,
    )
    widest: float = declare(
        40.0, 'Width of the widest that stands on the ground: a building, a crown.', 'm', 0.0, 1e4
    )
    k: int = declare(30, 'Neighbours whose mean elevation counts; ties count too.', '', 1, 1000)
    multiplier: float = declare(
        3.0, 'Standard deviations of all differences that one may differ.', '', 1e-6, 1000.0
    )
    sides: str = declare(
        'both',
        'Points that are rejected: low or high ones, or both; low is the formula of the paper.',
        choices=('both', 'low', 'high'),
    )
    gap: float = declare(
        5.0,
        'Empty stretch of elevations that sets points above or below apart; 0: none does.',
        'm',
        0.0,
        1e6,
    )
