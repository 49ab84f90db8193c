# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds without scan lines, judged by trees on the neighbours of each point.

The first trees see the eight nearest neighbours of every point. If a point is not clearly good,
the second trees see its sixty nearest neighbours and their first log-odds. So the slow, wide
search is made for few points only. A verdict depends on the neighbours of a point, and on the
floor of the whole cloud. Coincident points are judged as one: neighbours are at other positions.
Lone points of a whole cloud are taken out first, see :mod:`.lone_points`.

A sweep is sparser where it is farther from its sensor. Such a cloud has trees of its own, which
compare the distance of neighbours with the range, too.
"""

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Allocate, Floats, Ints, Singles
from lidar_outlier_filter.core.detectors.boosted_trees.features import FAR, NEAR, SWEEP
from lidar_outlier_filter.core.detectors.boosted_trees.lone_points import NONE, Parted, part
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_features import (
    MAX_NEIGHBOURS,
    Far,
    Near,
)
from lidar_outlier_filter.core.detectors.boosted_trees.trees import (
    MIN_LOG_ODDS,
    NO_TREES,
    SURVEY_MODEL,
    SWEEP_MODEL,
    TreeModel,
    Trees,
    find_valleys,
    load,
)
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.floor import Floor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.typical import K

NO_VALUES = np.empty((0, 0), np.float32)
POINTS_AT_ONCE = 4096  # points that a thread takes at once
# In shells of range that hold as many points each, the nearest tenth of the distances to the eighth
# neighbour grows with the range: those are of surfaces, so also in snow. Of 350 sweeps in frames of
# vehicles, 311 are known by these limits; the others are mostly of small rooms. Of 150 surveys,
# maps, forests and scans from tripods one is, and its origin is its scanner.
MIN_SWEEP_POINTS, MAX_SWEEP_POINTS = 1 << 13, 2_000_000
SHELLS, NEAREST_SHARE, MIN_SPAN = 16, 0.1, 2.0
MIN_POWER, MIN_CORRELATION = 0.4, 0.73  # of the logarithms


def measure(
    xyz: Floats,
    around: Floor,
    threads: int = 0,
    allocate: Allocate = np.empty,
    *,
    whole: bool = False,
    sweeps: bool = True,
) -> tuple[Floats, TreeModel]:
    """Return the log-odds of N points, and the model that they are of.

    Parameters
    ----------
    xyz : (N, 3) float64
        Metres, finite; z points up.
    around : Floor
        What :func:`.measure_floor` finds in the whole cloud.
    threads : maximum number of threads; 0: all cores
    allocate : returns large arrays, in memory or in files
    whole : whether the points are a whole cloud, whose lone points are rejected first
    sweeps : whether they may be a sweep, see :func:`is_sweep`

    Returns
    -------
    log_odds : (N,) float64
        NaN for all where each has fewer than eight others. Others at the same place do not count.
    model : TreeModel

    """
    odds, model = np.full(len(xyz), np.nan), load(SURVEY_MODEL)
    hood, index, (copy, original) = Neighbourhood(xyz, K, threads, allocate).distinct()
    if len(hood) > K:
        (hood, index, lone, isolation), near = see(hood, index, around, whole=whole, sweeps=sweeps)
        odds[lone], model = lone_odds(isolation), model_of(near)
        first = first_odds(near, model.first, threads)
        found = first.astype(np.float64)
        doubtful = np.flatnonzero(first > np.float32(model.doubtful))
        found[doubtful] = second_odds(hood, near, first, doubtful, model.again)
        odds[index] = found
        odds[copy] = odds[original]
    return odds, model


def score(odds: Floats, threshold: float, model: TreeModel) -> Floats:
    """Return scores from 0, more than 1 where rejected; ``threshold`` is the user's, 1 usually."""
    (own,) = find_valleys(odds, np.array([model.threshold]), model.drop)
    scores: Floats = np.maximum(odds - MIN_LOG_ODDS, 0.0) / (threshold * (own - MIN_LOG_ODDS))
    return scores


def lone_odds(isolation: Floats) -> Floats:
    """Return log-odds (L,) of lone points, whose scores are their isolation ÷ the threshold."""
    odds: Floats = MIN_LOG_ODDS + isolation * (load(SURVEY_MODEL).threshold - MIN_LOG_ODDS)
    return odds


def see(
    hood: Neighbourhood, index: Ints, around: Floor, *, whole: bool, sweeps: bool
) -> tuple[Parted, Near]:
    """Part more than eight points as :func:`measure` says, and find their neighbours."""
    sweep = sweeps and is_sweep(hood)
    parted = part(hood, index, around) if whole and not sweep else Parted(hood, index, *NONE)
    return parted, neighbours(parted.hood, around, sweep=sweep)


def neighbours(hood: Neighbourhood, around: Floor, *, sweep: bool = False) -> Near:
    """Find the eight nearest neighbours of more than eight points."""
    radius, unknown, is_large = hood.squared_distances(K), *np.zeros((2, len(hood)), np.bool_)
    radius, index = np.sqrt(radius, out=radius), hood.nearest(K).index
    near = Near(hood.xyz, index, radius, around, unknown, sweep)
    pool.run(
        lambda i, j: _kernels.write_large_components(near, i, j, is_large),
        *(len(radius), POINTS_AT_ONCE, hood.threads),
    )
    return near._replace(is_large=is_large)


def is_sweep(hood: Neighbourhood) -> bool:
    """Return whether a sensor at the origin saw the points: the farther, the sparser they are."""
    if not MIN_SWEEP_POINTS <= len(hood) <= MAX_SWEEP_POINTS:
        return False
    with np.errstate(divide='ignore'):
        squares, reach = hood.squared_distances(K), (hood.xyz**2).sum(axis=1)
        shells = np.array_split(np.argsort(reach, kind='stable'), SHELLS)
        near = [np.quantile(squares[shell], NEAREST_SHARE, method='lower') for shell in shells]
        far, sparse = np.log([[reach[shell[len(shell) // 2]] for shell in shells], near])
    if not np.isfinite([far, sparse]).all() or far[-1] - far[0] < 2.0 * np.log(MIN_SPAN):
        return False
    grows = np.polyfit(far, sparse, 1)[0] > MIN_POWER
    return bool(grows and np.corrcoef(far, sparse)[0, 1] > MIN_CORRELATION)


def model_of(near: Near) -> TreeModel:
    """Return the model for points with these neighbours."""
    return load(SWEEP_MODEL if near.is_sweep else SURVEY_MODEL)


def first_odds(near: Near, trees: Trees, threads: int = 0) -> Singles:
    """Return the log-odds by the first trees (N,), in tree order."""
    odds, every = np.empty(len(near.radius), np.float32), np.empty(0, np.int64)
    pool.run(
        lambda i, j: _kernels.judge_near(near, trees, every, i, j, odds, NO_VALUES),
        *(len(odds), POINTS_AT_ONCE, threads),
    )
    return odds


def second_odds(
    hood: Neighbourhood, near: Near, first: Singles, which: Ints, trees: Trees
) -> Singles:
    """Return the log-odds of some points (M,) by the second trees."""
    odds = np.empty(len(which), np.float32)
    far = Far(near, first, hood.nearest_of(which, min(MAX_NEIGHBOURS, len(hood) - 1)))
    pool.run(
        lambda i, j: _kernels.judge_far(far, trees, which, i, j, odds, NO_VALUES),
        *(len(which), POINTS_AT_ONCE // 8, hood.threads),
    )
    return odds


def near_values(near: Near, which: Ints) -> Singles:
    """Return the features (COUNT, M) of points for the first trees."""
    values, odds = _room(len(NEAR) + len(SWEEP), which)
    _kernels.judge_near(near, NO_TREES, which, 0, len(which), odds, values)
    return values


def far_values(far: Far, which: Ints) -> Singles:
    """Return the features (COUNT, M) of points for the second trees."""
    values, odds = _room(len(NEAR) + len(SWEEP) + len(FAR), which)
    _kernels.judge_far(far, NO_TREES, which, 0, len(which), odds, values)
    return values


def _room(count: int, which: Ints) -> tuple[Singles, Singles]:
    return np.empty((count, len(which)), np.float32), np.empty(len(which), np.float32)
