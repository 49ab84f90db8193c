# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A spinning sensor that sees its own vehicle: bonnet, mirrors, a rack and an aerial."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lidar_outlier_filter.messages.truth import Kind
from lidar_outlier_lab.simulation.scenes.spinning_streets import DRY, SENSORS, plan
from lidar_outlier_lab.simulation.world.surfaces import Box, Tube
from lidar_outlier_lab.simulation.world.trajectory import Route

if TYPE_CHECKING:
    from lidar_outlier_lab.simulation.world.drive import Drive

# In the frame of the sensor, which sits 1.9 m above the road.
VEHICLE = (
    Box((0.6, -0.85, -1.5), (2.4, 0.85, -0.95), Kind.OWN, 0.3),  # bonnet
    Box((0.9, 0.9, -0.95), (1.1, 1.2, -0.7), Kind.OWN, 0.6),  # mirrors
    Box((0.9, -1.2, -0.95), (1.1, -0.9, -0.7), Kind.OWN, 0.6),
    Box((-2.2, -0.8, -0.6), (-1.0, 0.8, -0.5), Kind.OWN, 0.4),  # rack
    Tube((-1.5, 0.5, -0.5), (-1.5, 0.5, 0.6), 0.03, Kind.OWN),  # aerial
)


def drive(turns: int = 40, seed: int = 1, *, speed: float = 6.0, columns: int = 2000) -> Drive:
    """Plan a dry drive of a sensor with 32 rings along a street; at 0 m/s it stands."""
    bend = 0.1 if speed else 0.0
    knots = ((0.0, speed, 0.0), (2.0, speed, bend), (4.0, speed, -bend))
    route = Route(knots, (-2.0, -1.6, 0.0), bump=0.03, mount=(0.0, 0.0, 1.9))
    street = plan(32, seed)
    sensor = replace(SENSORS[32], columns=columns, column_time=50_016 * 2000 // columns // 32 * 32)
    return replace(
        street,
        scene=replace(street.scene, air=()),
        sensor=sensor,
        lines=turns,
        trajectory=route,
        disturbances=DRY,
        vehicle=VEHICLE,
    )
