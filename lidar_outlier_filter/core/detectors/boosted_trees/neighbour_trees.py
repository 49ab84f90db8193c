# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds without scan lines, judged by trees on the neighbours of each point.

The first trees see the eight nearest neighbours of every point. Where they do not call it clearly
good, the second trees see the sixty nearest, and what the first say of these. So the wide search,
which takes long, is for few points. What is said of a point depends on what is near it, and on the
floor of the whole cloud. Points at one place are judged as one: neighbours are at other places.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees import far_features, near_features
from lidar_outlier_filter.core.detectors.boosted_trees.far_features import MOST, Far, write_far
from lidar_outlier_filter.core.detectors.boosted_trees.near_features import (
    Near,
    write_near,
    write_reach_bounds,
)
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_lanes import add_farthest
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    LEAST_LOG_ODDS,
    SURVEY_MODEL,
    Trees,
    add_lanes,
    load,
)
from lidar_outlier_filter.core.detectors.distances import squared_k_distances
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.kernels.lanes import LANES
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import K, find_copies, numbers

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Bools, Floats, Ints, Singles
    from lidar_outlier_filter.core.neighbours.floor import Floor

AT_ONCE = 128 * LANES  # points that a thread takes at once
BOUNDS = 8  # points: of one of so many, the reach bound is found first


def measure(
    xyz: Floats, around: Floor, threads: int = 0, wanted: Bools | None = None
) -> tuple[Floats, Floats]:
    """Return the log-odds of N points, and how far away what they depend on may be, metres.

    Parameters
    ----------
    xyz : (N, 3) float64
        Metres, finite; z points up.
    around : Floor
        What :func:`.look_around` says of the whole cloud that they are of.
    threads : at most so many at once; 0 for as many as there are cores
    wanted : (N,) bool
        None: all. Of the others it says only what the first trees say.

    Returns
    -------
    odds : (N,) float64
        NaN for all where each has fewer than eight others.
    reach : (N,) float64
        Points farther away, in any direction, count for nothing. inf for all where each has fewer
        than sixty others. Others at the same place count for none.

    """
    odds, reach = np.full(len(xyz), np.nan), np.full(len(xyz), np.inf)
    if len(xyz) <= K:
        return odds, reach
    hood = Neighbourhood(xyz, K, threads)
    copies = find_copies(hood, xyz, K)
    if len(copies) == 0:
        return _measure(hood, around, wanted)
    alone, (copy, original) = np.ones(len(xyz), np.bool_), copies.T
    alone[copy] = False
    if np.count_nonzero(alone) <= K:
        return odds, reach
    if wanted is not None:
        asked = wanted.copy()
        np.logical_or.at(asked, original, wanted[copy])
        wanted = asked[alone]
    odds[alone], reach[alone] = _measure(hood.without(~alone), around, wanted)
    odds[copy], reach[copy] = odds[original], reach[original]
    return odds, reach


def _measure(hood: Neighbourhood, around: Floor, wanted: Bools | None) -> tuple[Floats, Floats]:
    """Measure points, more than eight, no two of which are at one place."""
    model, threads = load(SURVEY_MODEL), hood.threads
    near = neighbours(hood, around)
    first, extent = first_odds(near, model.first, threads)
    result, way = first.astype(np.float64), extent
    is_doubtful = first > np.float32(model.doubtful)
    if wanted is not None:
        is_doubtful &= wanted[hood.order]
    doubtful = np.flatnonzero(is_doubtful)
    again, wide = second_odds(hood, near, first, extent, doubtful, model.again)
    result[doubtful], way[doubtful] = again, wide
    odds, reach = np.empty(len(hood)), np.full(len(hood), np.inf)
    odds[hood.order] = result
    if len(hood) > MOST:
        reach[hood.order] = way
    return odds, reach


def score(odds: Floats, threshold: float) -> Floats:
    """Return scores from 0, more than 1 where rejected; ``threshold`` is the user's, 1 usually."""
    scores: Floats = np.maximum(odds - LEAST_LOG_ODDS, 0.0) / (
        threshold * (load(SURVEY_MODEL).threshold - LEAST_LOG_ODDS)
    )
    return scores


def neighbours(hood: Neighbourhood, around: Floor) -> Near:
    """Find the eight nearest neighbours of more than eight points."""
    radius, unknown = np.sqrt(squared_k_distances(hood, K)), np.full(len(hood), np.nan)
    near = Near(hood.xyz, hood.nearest(K).index, radius, around, unknown)
    some, bound = np.flatnonzero(numbers(hood.xyz) % BOUNDS == 0), unknown.copy()
    pool.run(
        lambda i, j: write_reach_bounds(near, some[i:j], bound), len(some), AT_ONCE, hood.threads
    )
    return near._replace(reach_bound=bound)


def first_odds(near: Near, trees: Trees, threads: int = 0) -> tuple[Singles, Floats]:
    """Return what the first trees say (N,), and how far what they see may be, in tree order."""
    count = len(near.radius)
    odds, extent = np.empty(count, np.float32), np.empty(count)
    pool.run(lambda i, j: _first(near, trees, i, j, odds, extent), count, AT_ONCE, threads)
    return odds, extent


def second_odds(
    hood: Neighbourhood, near: Near, first: Singles, extent: Floats, which: Ints, trees: Trees
) -> tuple[Singles, Floats]:
    """Return what the second trees say of some points (M,), and how far what they see may be."""
    odds, wide = np.empty(len(which), np.float32), np.empty(len(which))
    far = Far(near, first, hood.nearest_of(which, min(MOST, len(hood) - 1)))
    pool.run(
        lambda i, j: _again(far, extent, trees, which, i, j, odds, wide),
        len(which),
        AT_ONCE // 8,
        hood.threads,
    )
    return odds, wide


@kernel
def _first(near: Near, trees: Trees, begin: int, end: int, odds: Singles, extent: Floats) -> None:
    buffers, points = near_features.make_buffers(), np.empty(LANES, np.int64)
    values, total = np.empty((near_features.COUNT, LANES), np.float32), np.empty(LANES, np.float32)
    for start in range(begin, end, LANES):
        for lane in range(LANES):
            points[lane] = min(start + lane, end - 1)
        write_near(near, points, buffers, values)
        add_lanes(trees, values, total)
        for lane in range(min(LANES, end - start)):
            odds[start + lane] = total[lane]
            extent[start + lane] = buffers.extent[lane]


@kernel
def _again(
    far: Far,
    extent: Floats,
    trees: Trees,
    which: Ints,
    begin: int,
    end: int,
    odds: Singles,
    wide: Floats,
) -> None:
    buffers = far_features.make_buffers()
    points, rows = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    values, total = np.empty((far_features.COUNT, LANES), np.float32), np.empty(LANES, np.float32)
    farthest, count = np.empty(LANES), far.index.shape[1]
    for start in range(begin, end, LANES):
        for lane in range(LANES):
            rows[lane] = min(start + lane, end - 1)
            points[lane] = which[rows[lane]]
        write_far(far, points, rows, buffers, values)
        add_lanes(trees, values, total)
        for lane in range(min(LANES, end - start)):
            odds[start + lane] = total[lane]
            for m in range(count):
                buffers.radii[m, lane] = extent[far.index[start + lane, m]]
        add_farthest(buffers.distance, buffers.radii, count, farthest)
        for lane in range(min(LANES, end - start)):
            wide[start + lane] = max(extent[points[lane]], farthest[lane])


def near_values(near: Near, which: Ints) -> Singles:
    """Return the features (COUNT, M) of points for the first trees."""
    values = np.empty((near_features.COUNT, len(which)), np.float32)
    _measure_near(near, which, values)
    return values


def far_values(far: Far, which: Ints) -> Singles:
    """Return the features (COUNT, M) of points for the second trees."""
    values = np.empty((far_features.COUNT, len(which)), np.float32)
    _measure_far(far, which, values)
    return values


@kernel
def _measure_near(near: Near, which: Ints, result: Singles) -> None:
    """Write the features (COUNT, M) of some points that the first trees see."""
    buffers, points = near_features.make_buffers(), np.empty(LANES, np.int64)
    values = np.empty((near_features.COUNT, LANES), np.float32)
    for start in range(0, len(which), LANES):
        for lane in range(LANES):
            points[lane] = which[min(start + lane, len(which) - 1)]
        write_near(near, points, buffers, values)
        count = min(LANES, len(which) - start)
        result[:, start : start + count] = values[:, :count]


@kernel
def _measure_far(far: Far, which: Ints, result: Singles) -> None:
    """Write the features (COUNT, M) of some points that the second trees see."""
    buffers = far_features.make_buffers()
    points, rows = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    values = np.empty((far_features.COUNT, LANES), np.float32)
    for start in range(0, len(which), LANES):
        for lane in range(LANES):
            rows[lane] = min(start + lane, len(which) - 1)
            points[lane] = which[rows[lane]]
        write_far(far, points, rows, buffers, values)
        count = min(LANES, len(which) - start)
        result[:, start : start + count] = values[:, :count]
