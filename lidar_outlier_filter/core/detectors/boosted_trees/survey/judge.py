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

from lidar_outlier_filter.core.detectors.boosted_trees.models import SURVEY_MODEL, load
from lidar_outlier_filter.core.detectors.boosted_trees.survey import far as survey_far
from lidar_outlier_filter.core.detectors.boosted_trees.survey import near as survey_near
from lidar_outlier_filter.core.detectors.boosted_trees.survey.far import MOST, Far, write_far
from lidar_outlier_filter.core.detectors.boosted_trees.survey.near import (
    Near,
    write_leads,
    write_near,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees, add_lanes
from lidar_outlier_filter.core.detectors.distances import squared_k_distances
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.kernels.kernels import kernel
from lidar_outlier_filter.core.kernels.lanes import LANES
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.places import K, find_copies, numbers

if TYPE_CHECKING:
    from lidar_outlier_filter.annotations import Allocate, Floats, Ints, Singles
    from lidar_outlier_filter.core.neighbours.floor import Floor

AT_ONCE = 128 * LANES  # points that a thread takes at once
LEADS = 8  # points: of one of so many, how far it leads is found first
LEAST = -8.0  # log-odds that make a score of 0


def measure(xyz: Floats, around: Floor, threads: int = 0, allocate: Allocate = np.empty) -> Floats:
    """Return the log-odds of N points.

    Parameters
    ----------
    xyz : (N, 3) float64
        Metres, finite; z points up.
    around : Floor
        What :func:`.look_around` finds in the whole cloud.
    threads : at most so many at once; 0 for as many as there are cores
    allocate : returns large arrays, in memory or in files

    Returns
    -------
    (N,) float64
        NaN for all where each has fewer than eight others. Others at the same place do not count.

    """
    odds = np.full(len(xyz), np.nan)
    if len(xyz) <= K:
        return odds
    hood = Neighbourhood(xyz, K, threads, allocate)
    copies = find_copies(hood, xyz, K)
    if len(copies) == 0:
        odds[hood.order] = _measure(hood, around)
        return odds
    alone, (copy, original) = np.ones(len(xyz), np.bool_), copies.T
    alone[copy] = False
    hood = hood.without(~alone)
    if len(hood) > K:
        odds[np.flatnonzero(alone)[hood.order]] = _measure(hood, around)
        odds[copy] = odds[original]
    return odds


def _measure(hood: Neighbourhood, around: Floor) -> Floats:
    """Measure points, more than eight, no two of which are at one place; in tree order."""
    model, threads = load(SURVEY_MODEL), hood.threads
    near = neighbours(hood, around)
    first = first_odds(near, model.first, threads)
    result = first.astype(np.float64)
    doubtful = np.flatnonzero(first > np.float32(model.doubtful))
    result[doubtful] = second_odds(hood, near, first, doubtful, model.again)
    return result


def score(odds: Floats, threshold: float) -> Floats:
    """Return scores from 0, more than 1 where rejected; ``threshold`` is the user's, 1 usually."""
    scores: Floats = np.maximum(odds - LEAST, 0.0) / (
        threshold * (load(SURVEY_MODEL).threshold - LEAST)
    )
    return scores


def neighbours(hood: Neighbourhood, around: Floor) -> Near:
    """Find the eight nearest neighbours of more than eight points."""
    radius, unknown = np.sqrt(squared_k_distances(hood, K)), np.zeros(len(hood), np.bool_)
    near = Near(hood.xyz, hood.nearest(K).index, radius, around, unknown)
    some, lead = np.flatnonzero(numbers(hood.xyz) % LEADS == 0), unknown.copy()
    pool.run(lambda i, j: write_leads(near, some[i:j], lead), len(some), AT_ONCE, hood.threads)
    return near._replace(lead=lead)


def first_odds(near: Near, trees: Trees, threads: int = 0) -> Singles:
    """Return the log-odds by the first trees (N,), in tree order."""
    odds = np.empty(len(near.radius), np.float32)
    pool.run(lambda i, j: _first(near, trees, i, j, odds), len(odds), AT_ONCE, threads)
    return odds


def second_odds(
    hood: Neighbourhood, near: Near, first: Singles, which: Ints, trees: Trees
) -> Singles:
    """Return the log-odds of some points (M,) by the second trees."""
    odds = np.empty(len(which), np.float32)
    far = Far(near, first, hood.nearest_of(which, min(MOST, len(hood) - 1)))
    pool.run(
        lambda i, j: _again(far, trees, which, i, j, odds),
        len(which),
        AT_ONCE // 8,
        hood.threads,
    )
    return odds


@kernel
def _first(near: Near, trees: Trees, begin: int, end: int, odds: Singles) -> None:
    buffers, points = survey_near.make_buffers(), np.empty(LANES, np.int64)
    values, total = np.empty((survey_near.COUNT, LANES), np.float32), np.empty(LANES, np.float32)
    for start in range(begin, end, LANES):
        for lane in range(LANES):
            points[lane] = min(start + lane, end - 1)
        write_near(near, points, buffers, values)
        add_lanes(trees, values, total)
        for lane in range(min(LANES, end - start)):
            odds[start + lane] = total[lane]


@kernel
def _again(far: Far, trees: Trees, which: Ints, begin: int, end: int, odds: Singles) -> None:
    buffers = survey_far.make_buffers()
    points, rows = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    values, total = np.empty((survey_far.COUNT, LANES), np.float32), np.empty(LANES, np.float32)
    for start in range(begin, end, LANES):
        for lane in range(LANES):
            rows[lane] = min(start + lane, end - 1)
            points[lane] = which[rows[lane]]
        write_far(far, points, rows, buffers, values)
        add_lanes(trees, values, total)
        for lane in range(min(LANES, end - start)):
            odds[start + lane] = total[lane]


@kernel
def measure_near(near: Near, which: Ints, result: Singles) -> None:
    """Write the features (COUNT, M) of some points that the first trees see."""
    buffers, points = survey_near.make_buffers(), np.empty(LANES, np.int64)
    values = np.empty((survey_near.COUNT, LANES), np.float32)
    for start in range(0, len(which), LANES):
        for lane in range(LANES):
            points[lane] = which[min(start + lane, len(which) - 1)]
        write_near(near, points, buffers, values)
        count = min(LANES, len(which) - start)
        result[:, start : start + count] = values[:, :count]


@kernel
def measure_far(far: Far, which: Ints, result: Singles) -> None:
    """Write the features (COUNT, M) of some points that the second trees see."""
    buffers = survey_far.make_buffers()
    points, rows = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    values = np.empty((survey_far.COUNT, LANES), np.float32)
    for start in range(0, len(which), LANES):
        for lane in range(LANES):
            rows[lane] = min(start + lane, len(which) - 1)
            points[lane] = which[rows[lane]]
        write_far(far, points, rows, buffers, values)
        count = min(LANES, len(which) - start)
        result[:, start : start + count] = values[:, :count]
