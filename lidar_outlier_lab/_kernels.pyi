# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
# The compiled loops over rays, see module.cpp; arrays as in lidar_outlier_filter.core._kernels.

from lidar_outlier_filter.core.annotations import Floats, Ints

# simulation/world/caster.cpp: codes of shapes, where numbers are in a row, and parts that are met.
GROUND: int
BOX: int
BUILDING: int
TUBE: int
ARM: int
BALL: int
LID: int
CROWN: int
LOW: int
HIGH: int
VELOCITY: int
REST: int
WIDTH: int
ROUND: int
PANE: int

def cast_rays(
    table: Floats, origin: Floats, direction: Floats, t: Floats, reach: float
) -> tuple[Floats, Floats, Ints, Ints]: ...

# simulation/world/landscape.cpp, sensors.cpp
def view_top(
    top: Floats, owner: Ints, cell: float, x: Floats, y: Floats, found: Ints
) -> Floats: ...
def descend(
    fields: tuple[Floats, Floats, Ints, Floats],
    cell: float,
    side: float,
    origin: Floats,
    direction: Floats,
    depth: Floats,
    bottom: float,
    found: Ints,
) -> Floats: ...
def strongest(distance: Floats, pulse: float) -> tuple[Floats, Floats]: ...
