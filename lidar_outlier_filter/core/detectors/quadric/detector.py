# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Quadric surfaces through the neighbourhood (Leslar, Wang and Hu 2010, section 2.2).

Windows are sections (algorithm c of the paper) or patches (algorithm b). The cores of the sections
are the largest subtrees with at most ``section`` points; they divide the cloud. The window of a
core is the core and a rim: the points in its box, grown on every side. Each point is tested in the
window of its core. One that fails there is accepted if it lies on a surface of another window that
holds it: the foot of a pole has too few points in a window with the road, but enough in the
window above it.

What a window says of its points is in ``surfaces.dispatch.cpp``.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri, stdtrit

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.builtin import Quadric
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.parameters.filter import FilterParameters

SECTIONS = 64  # that a thread judges at once, at least
PATCHES = 1024
LEAVES = 512
PARTS = 32  # of a cloud, at most: each checks the whole tree
FREEDOMS = 1000  # degrees of freedom in the tables; beyond, quantiles do not change


class Rules(NamedTuple):
    """Rules of the judgement, for the kernels."""

    critical: Floats  # two-sided quantile of t by degrees of freedom; the last for all beyond
    ratio: Floats  # the same of F for three more parameters, by those of the larger model
    floor: float  # least standard deviation of a residual, metres
    surfaces: int  # at most
    # Nothing but a quadric is fitted, to all points, ambiguous or not, and every window is decided;
    # else a surface begins with the points nearest to a plane.
    always: bool


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    sigma = seen.points.sigma
    variance = None if sigma is None else sigma**2
    return Scores(detect(seen.neighbourhood, parameters.of(Quadric), variance))


def detect(
    neighbourhood: Neighbourhood, parameters: Quadric, variance: Floats | None = None
) -> Floats:
    """Score every point by its distance from the surfaces around it.

    Parameters
    ----------
    neighbourhood : N points
    parameters : see :class:`~.builtin.Quadric`
    variance : (N,) float64, optional
        Variance of any coordinate of each point, m², finite and positive. Only their ratios count:
        σ̂0 is estimated in every window. None: equal weights.

    Returns
    -------
    (N,) float64
        In the order in which the points were given: T (31) ÷ its critical value, the same for
        coincident points. NaN for points in windows that are undecided.

    References
    ----------
    .. [1] Leslar, Wang and Hu (2010): A comparison of two new methods of outlier detection for
       mobile terrestrial lidar data. ISPRS Commission I, ICWG VI.
    .. [2] Leslar, Wang and Hu (2011): Comprehensive utilization of temporal and spatial domain
       outlier detection methods for mobile terrestrial LiDAR data. Remote Sensing 3(8), 1724-1742.
       https://doi.org/10.3390/rs3081724

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors.quadric import detector as quadric
    >>> from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    >>> from lidar_outlier_filter.core.detectors.builtin import Quadric
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> parameters = Quadric()
    >>> score = quadric.detect(Neighbourhood(xyz, parameters.list_length), parameters)
    >>> np.flatnonzero(score > 1).tolist()
    [77]

    """
    score = np.full(len(neighbourhood), np.nan)
    if len(neighbourhood) < _kernels.SURFACE_POINTS:
        return score
    place = _positions(neighbourhood)
    xyz = np.take(neighbourhood.xyz, place, axis=0)
    order = neighbourhood.order[place]
    weights = np.ones(len(score)) if variance is None else variance[order]
    if parameters.window == 'patch':
        _patches(neighbourhood, place, parameters, xyz, weights, score)
    else:
        _sections(neighbourhood, parameters, xyz, weights, score)
    # Which of coincident points, which are adjacent, is in the fit depends on their order.
    begins = np.flatnonzero(np.append(True, (xyz[1:] != xyz[:-1]).any(axis=1)))
    least = np.fmin.reduceat(score, begins)
    result = np.empty_like(score)
    result[order] = np.repeat(least, np.diff(begins, append=len(score)))
    return result


def _positions(neighbourhood: Neighbourhood) -> Ints:
    """Sort the points of every leaf by x, y and z: tree positions, in the new order.

    Tree order within a leaf is that in which the points were given, which must not matter.
    """
    xyz, tree, place = neighbourhood.xyz, neighbourhood.tree, np.empty(len(neighbourhood), np.int64)
    these = _kernels.subtrees(tree, 0)
    threads.run(
        lambda begin, end: _kernels.sort_leaves(xyz, tree, these[begin:end], place),
        len(these),
        max(LEAVES, -(-len(these) // PARTS)),
        neighbourhood.threads,
    )
    return place


def _sections(
    neighbourhood: Neighbourhood, parameters: Quadric, xyz: Floats, variance: Floats, score: Floats
) -> None:
    tree, section, rules = neighbourhood.tree, parameters.section, _rules(parameters)
    cores = _kernels.subtrees(tree, section)

    def work(begin: int, end: int) -> tuple[Ints, Floats]:
        return _kernels.judge_sections(xyz, variance, tree, cores[begin:end], section, rules, score)

    chunk = max(SECTIONS, -(-len(cores) // PARTS))
    others = threads.run(work, len(cores), chunk, neighbourhood.threads)
    failed = ~(score <= 1)
    for index, value in others:  # the least counts
        of_failed = failed[index]
        np.fmin.at(score, index[of_failed], value[of_failed])


def _patches(
    neighbourhood: Neighbourhood,
    place: Ints,
    parameters: Quadric,
    xyz: Floats,
    variance: Floats,
    score: Floats,
) -> None:
    rules = _rules(parameters)
    lists = neighbourhood.nearest(min(parameters.k, len(xyz) - 1))
    nearest = np.ascontiguousarray(lists.index)  # of longer ones, where others need these
    rank = np.empty(len(xyz), np.int64)
    rank[place] = np.arange(len(xyz))

    def work(begin: int, end: int) -> None:
        _kernels.judge_patches(xyz, variance, nearest, place, rank, begin, end, rules, score)

    threads.run(work, len(xyz), PATCHES, neighbourhood.threads)


def _rules(parameters: Quadric) -> Rules:
    always = parameters.model == 'always'
    surfaces = 1 if always else parameters.surfaces
    return Rules(*tables(parameters.significance), parameters.sigma_floor, surfaces, always)


@lru_cache(maxsize=64)
def tables(significance: float) -> tuple[Floats, Floats]:
    """Return the quantiles, two-sided of t, and of F for three more parameters, by freedom.

    The first entry, for no degree of freedom, is inf.
    """
    freedom = np.arange(1, FREEDOMS)
    critical = np.abs(stdtrit(freedom, significance / 2))
    ratio = fdtri(3, freedom, 1 - significance)
    return np.append(np.inf, critical), np.append(np.inf, ratio)
