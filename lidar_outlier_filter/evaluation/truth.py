# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the fields of a labelled cloud say: why a point is where it is, and what reflected it."""

from enum import IntEnum


class Cause(IntEnum):
    """Why a point is where it is; the code in the field ``label``."""

    GOOD = 0
    REFLECTION = 1
    EXHAUST = 2
    BARRIER = 3
    NEAR_SURFACE = 4
    MIXED = 5
    GHOST = 6  # mirrored by glass
    RAIN = 7
    SNOW = 8
    SPRAY = 9
    BIRD = 10
    SINGLE = 11  # anywhere, alone
    CLUSTER = 12  # anywhere, with a few others
    DETOUR = 13  # off the route of a bus
    FOG = 14
    DUST = 15


class Kind(IntEnum):
    """What a shot was reflected by; the code in the field ``surface``."""

    AIR = 0
    ROAD = 1
    KERB = 2
    SIDEWALK = 3
    FACADE = 4
    POLE = 5
    CAR = 6
    ARM = 7
    MANHOLE = 8
    FOLIAGE = 9
    GLASS = 10
    SIGN = 11
    WIRE = 12
    TERRAIN = 13
    ROOF = 14
    ROUTE = 15  # of a bus
    OWN = 16  # the vehicle that carries the sensor
    FENCE = 17
