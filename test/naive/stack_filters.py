# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Filters of vehicle stacks, ported line by line: ours must reject the same points.

Nothing of the package is imported here. Each works on one scan line, a list of points in the order
of measurement, and returns the indices of the points that it removes.
"""

from collections.abc import Sequence
from math import acos, atan2, cos, degrees, dist, isnan, nan, radians, sin, tan

import numpy as np

Point = Sequence[float]
Line = Sequence[Point]


def norm(point: Point) -> float:
    """Distance from the sensor."""
    return dist(point, (0.0, 0.0, 0.0))


def between(one: Point, other: Point) -> float:
    """Angle between two beams, rad; nan for a missing return."""
    if isnan(one[0] + other[0]):
        return nan
    cosine = sum(a * b for a, b in zip(one, other, strict=True)) / norm(one) / norm(other)
    return acos(max(-1.0, min(1.0, cosine)))


def is_shadow(r1: float, r2: float, included: float, min_angle: float, max_angle: float) -> bool:
    """``ScanShadowDetector::isShadow`` of laser_filters 905f5e9 (scan_shadow_detector.h)."""
    min_tangent, max_tangent = abs(tan(radians(min_angle))), -abs(tan(radians(max_angle)))
    y, x = r2 * sin(included), r1 - r2 * cos(included)
    tangent = abs(y) / x if x else float('inf')
    if tangent > 0:
        return tangent < min_tangent
    return tangent > max_tangent


def scan_shadows(
    line: Line, min_angle: float, max_angle: float, neighbors: int, window: int
) -> set[int]:
    """``ScanShadowsFilter::update`` of laser_filters 905f5e9 (scan_shadows_filter.h).

    The angle between two beams is that of the points instead of a multiple of an increment. A
    missing return is a point of nan. Ranges are of single precision.
    """
    removed = set()
    ranges = [float(np.float32(norm(point))) for point in line]
    for i in range(len(line)):
        for y in range(-window, window + 1):
            j = i + y
            if j < 0 or j >= len(line) or i == j:
                continue
            if is_shadow(ranges[i], ranges[j], between(line[i], line[j]), min_angle, max_angle):
                for index in range(max(i - neighbors, 0), min(i + neighbors, len(line) - 1) + 1):
                    if ranges[i] < ranges[index]:
                        removed.add(index)
    return removed


def is_same_walk(one: Point, next_one: Point, ratio: float, sense: float) -> bool:
    """Whether the next point of a ring goes on with a walk; azimuths grow by ``sense``."""
    turned = sense * degrees(atan2(next_one[1], next_one[0]) - atan2(one[1], one[0]))
    turned = turned + 360.0 if turned < 0.0 else turned
    turned = turned - 360.0 if turned >= 360.0 else turned
    low, high = sorted([norm(one), norm(next_one)])
    return high < low * ratio and turned < 1.0


def ring_outlier(line: Line, ratio: float, length: float, points: int, sense: float) -> set[int]:
    """``RingOutlierFilterComponent`` of autoware.universe 022961e, whose rings are closed.

    The length of a walk is that of 2bf226a, the distance of its ends.
    """
    walks = [[0]] if line else []
    for i in range(1, len(line)):
        if is_same_walk(line[i - 1], line[i], ratio, sense):
            walks[-1].append(i)
        else:
            walks.append([i])
    if len(walks) > 1 and is_same_walk(line[-1], line[0], ratio, sense):
        walks[0] = walks.pop() + walks[0]
    short = (
        walk
        for walk in walks
        if not (len(walk) > points or dist(line[walk[0]], line[walk[-1]]) >= length)
    )
    return {i for walk in short for i in walk}


def dual_return(shots: Sequence[Sequence[Point]], ratio: float, sense: float) -> set[int]:
    """Remove early returns, to which no return of the shots beside is near, after Autoware's idea.

    The returns of a shot ascend; they are numbered through. The ring is closed.
    """
    removed, number = set(), 0
    for i, shot in enumerate(shots):
        before, after = shots[i - 1], shots[(i + 1) % len(shots)]
        for point in shot:
            kept = point is shot[-1]
            kept |= any(is_same_walk(one, point, ratio, sense) for one in before)
            kept |= any(is_same_walk(point, one, ratio, sense) for one in after)
            if not kept:
                removed.add(number)
            number += 1
    return removed


def crop_box(line: Line, low: Point, high: Point, *, negative: bool) -> set[int]:
    """``CropBox::applyFilter`` of PCL (crop_box.hpp)."""
    removed = set()
    for i, (x, y, z) in enumerate(line):
        outside = (
            x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]
        )
        if outside != negative:
            removed.add(i)
    return removed


def field_range(
    values: Sequence[float], ranges: Sequence[float], band: Point, bounds: Point
) -> tuple[set[int], set[int]]:
    """Remove values out of bounds where the range is in a band; also return the untested."""
    removed, untested = set(), set()
    for i, (value, reach) in enumerate(zip(values, ranges, strict=True)):
        if value - value != 0:  # NaN, Inf
            untested.add(i)
        elif band[0] <= reach < band[1] and not bounds[0] <= value <= bounds[1]:
            removed.add(i)
    return removed, untested
