# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Neighbours along closed rings, as Autoware's filters compare them."""

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Ints

MAX_GAP = np.cos(np.radians(1.0))  # between the azimuths of neighbours


def following(first: Ints) -> Ints:
    """Return the index of the next point in each ring; the first one follows the last."""
    result = np.arange(1, first[-1] + 1)
    some = first[1:] > first[:-1]
    result[first[1:][some] - 1] = first[:-1][some]
    return result


def are_near(xyz: Floats, other: Ints) -> Bools:
    """Return whether points are less than a degree of azimuth from others, given by index."""
    level = xyz[:, :2]
    flat = np.hypot(level[:, 0], level[:, 1])
    near: Bools = np.einsum('ij,ij->i', level, level[other]) > MAX_GAP * flat * flat[other]
    return near


def jumps(reach: Floats, other: Ints) -> Floats:
    """Return the ratios of ranges to those of others, given by index: the larger ÷ the smaller."""
    beyond = reach[other]
    with np.errstate(divide='ignore', invalid='ignore'):  # at the sensor itself
        ratio: Floats = np.maximum(reach, beyond) / np.minimum(reach, beyond)
    return ratio
