# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The neighbours of points, of which near_features and far_features measure the features.

Of the eight, all lengths are divided by the local scale s, the median distance of those neighbours
to their own eighth: so features have no unit, and follow the density. Of the sixty, they are
divided by S, the same median. z is expected to point up. What each means: :mod:`.features`.
"""

from typing import NamedTuple

from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Singles
from lidar_outlier_filter.core.neighbours.floor import Floor

MAX_NEIGHBOURS = 60  # neighbours that the second trees see


class Near(NamedTuple):
    """N points in tree order, and their neighbours.

    Attributes
    ----------
    xyz : (N, 3) float64, metres
    index : (N, K) int32
        The nearest first.
    radius : (N,) float64
        Distance to the eighth, metres.
    around : Floor
        What the whole cloud is like.
    is_large : (N,) bool
        Points that ``write_large_components`` found in components of more than sixty others.
    is_sweep : bool
        Whether a sensor at the origin saw them, see :func:`.is_sweep`.

    """

    xyz: Floats
    index: Index  # type: ignore[assignment]  # hides the method of tuples
    radius: Floats
    around: Floor
    is_large: Bools
    is_sweep: bool


class Far(NamedTuple):
    """M points, by their index in tree order, and up to 60 neighbours of each.

    Attributes
    ----------
    near : all points
    odds : (N,) float32
        Log-odds by the first trees.
    index : (M, 60) int32
        The nearest first; fewer columns where there are fewer points.

    """

    near: Near
    odds: Singles
    index: Index  # type: ignore[assignment]  # hides the method of tuples
