# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of :mod:`.boosted_trees`, and what they compare with."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import (
    lines as boosted_trees_lines,
)
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import (
    surface as boosted_trees_surface,
)
from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum.surface import (
    MIDDLE,
    NEAR,
    K,
    Surroundings,
)
from lidar_outlier_filter.core.kernels import threads
from lidar_outlier_filter.core.kernels.kernels import kernel, median
from lidar_outlier_filter.core.kernels.lanes import LANES, fill, sort
from lidar_outlier_filter.core.points import scan_lines

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_filter.core.points.scan_lines import Lines

CHUNK = 2048  # wanted points that a thread takes at once
FEATURES = ('spacing', 'step', 'lonely', 'amid', 'along', 'surface', 'alone', 'company')
SURFACE, COMPANY = FEATURES.index('surface'), FEATURES.index('company')
# Where features begin to contribute, and where they contribute no more: logarithms, but for
# `surface` and `company`.
LEAST = np.array([0.0, 0.0, 0.0, -1.2, 0.7, 0.0, 0.0])
MOST = np.array([3.0, 2.0, 1.2, 0.0, 2.8, 6.0, np.log(NEAR + 1)])
QUIET = np.exp(LEAST) * (1 - 1e-9)  # ratios up to which no logarithm need be taken
SIGMA_FLOOR = 0.002  # metres, of the median difference along the line and from the surface
SPACING_FLOOR = 0.001  # metres
FEW_SIGMA, MANY_SIGMA = 2.0, 8.0  # from the surface: where it begins and ends to count against
FOR = -1.0  # the least contribution of a surface: the point lies on it
EVEN = 1.3  # × the typical standard deviation: a surface up to which is even
OF_ALL = 0.3  # part of the σ of all points that is added to that of the neighbours
FEW_LOST = 1 / 3  # of the neighbours: more raise the score of a point, fewer lower it


class Scan(NamedTuple):
    """N points, their neighbours and their lines.

    Attributes
    ----------
    neighbourhood : of them
    ordered : sorted by line and time
    lines : of the ordered
    rank : (N,) int64
        Of each point in tree order, its index among the ordered.
    back : (N,) int64
        Of each of the ordered, its index in tree order.

    """

    neighbourhood: Neighbourhood
    ordered: Points
    lines: Lines
    rank: Ints
    back: Ints


class Usual(NamedTuple):
    """What the features compare with.

    Attributes
    ----------
    spacing, step, some : (N,) float64
        In tree order, metres: distance to near neighbours that the sensor leads to expect, step
        along the line, mean distance to 5 neighbours.
    part : spacing of a spinning sensor ÷ range
    along, surface : standard deviations of all points, metres

    """

    spacing: Floats
    step: Floats
    some: Floats
    part: float
    along: float
    surface: float


class Features(NamedTuple):
    """The features of N points, in tree order.

    Attributes
    ----------
    wanted : (N,) bool
        Points that they are computed for.
    contributions : (N, 8) float64
        Of each feature before its weight, 0 to MOST - LEAST, `surface` from FOR, and `company` from
        -FEW_LOST to 1 - FEW_LOST; 0 for others.
    lost : (N,) int64
        How many neighbours of each were rejected, pass after pass.
    around : what was measured of the neighbours of all
    usual : what the features compare with

    """

    wanted: Bools
    contributions: Floats
    lost: Ints
    around: Surroundings
    usual: Usual


def see(neighbourhood: Neighbourhood, points: Points, gap_factor: float) -> Scan:
    """Find the lines of points, which are those of the neighbourhood, in the order given."""
    order = scan_lines.order_by_line(points)
    ordered = points.take(order)
    back = scan_lines.inverse(neighbourhood.order)[order]
    lines = scan_lines.find_lines(ordered, gap_factor)
    return Scan(neighbourhood, ordered, lines, scan_lines.inverse(back), back)


def see_without(scan: Scan, rejected: Bools, gap_factor: float) -> Scan:
    """Find the lines of the points that are left, ``rejected`` being in tree order."""
    as_given = np.empty_like(rejected)
    as_given[scan.neighbourhood.order] = rejected
    left = np.flatnonzero(~rejected[scan.back])
    ordered = scan.ordered.take(left)
    # Both orders stay what they were.
    back = (np.cumsum(~rejected) - 1)[scan.back[left]]
    lines = scan_lines.find_lines(ordered, gap_factor)
    neighbourhood = scan.neighbourhood.without(as_given)
    return Scan(neighbourhood, ordered, lines, scan_lines.inverse(back), back)


def compute(scan: Scan, *, spinning: bool) -> Features:
    """Compute the features of all points.

    Parameters
    ----------
    scan : of more than 20 points
    spinning : whether spacing grows with the range, or is that of lines and steps

    """
    count = len(scan.rank)
    wanted, around = np.ones(count, np.bool_), boosted_trees_surface.empty(count)
    _measure(scan, wanted, around)
    part = np.nan
    if spinning:
        parts = around.few / np.maximum(scan.ordered.range[scan.rank], SPACING_FLOOR)
        part = median(parts, count)
    unknown = np.empty((3, count))
    usual = Usual(unknown[0], unknown[1], unknown[2], part, np.nan, _typical(around.scale))
    contributions, usual = _contribute(scan, wanted, around, usual)
    return Features(wanted, contributions, np.zeros(count, np.int64), around, usual)


def compute_again(
    scan: Scan, before: Features, nearest: NDArray[np.int32], rejected: Bools
) -> Features:
    """Compute the features of points that lost neighbours.

    Standard deviations, and the part of the range, stay what they were.

    Parameters
    ----------
    scan : of the points that are left, more than 20
    before : the features of all
    nearest, rejected : the lists of neighbours of all, and which of these were rejected, (N,), in
        their tree order

    """
    left = np.flatnonzero(~rejected)
    newly = boosted_trees_surface.lost(nearest, rejected)[left]
    wanted, lost = newly > 0, before.lost[left] + newly
    around = Surroundings(*(np.take(values, left) for values in before.around))
    _measure(scan, wanted, around)
    usual = before.usual
    usual = usual._replace(
        spacing=usual.spacing[left], step=usual.step[left], some=usual.some[left]
    )
    contributions, usual = _contribute(scan, wanted, around, usual)
    contributions[wanted, COMPANY] = np.minimum(lost[wanted] / K, 1.0) - FEW_LOST
    return Features(wanted, contributions, lost, around, usual)


@kernel
def weigh(contributions: Floats, weights: Floats) -> Floats:
    """Sum up the contributions, each times its weight: (N,), at least 0."""
    result = np.empty(len(contributions))
    for i in range(len(contributions)):
        total = 0.0
        for w in range(len(weights)):
            total += weights[w] * contributions[i, w]
        result[i] = max(total, 0.0)
    return result


def _measure(scan: Scan, wanted: Bools, around: Surroundings) -> None:
    hood = scan.neighbourhood
    line = scan.ordered.line[scan.rank]
    _run(scan, boosted_trees_surface.measure, wanted, hood.xyz, hood.nearest(K).index, line, around)


def _contribute(
    scan: Scan, wanted: Bools, around: Surroundings, usual: Usual
) -> tuple[Floats, Usual]:
    """Find out what is usual for the wanted points, and compute their features."""
    lines, ordered, spins = scan.lines, scan.ordered, not np.isnan(usual.part)
    there = wanted[scan.back]
    values, along = np.empty((2 if spins else 3, len(wanted))), np.empty(len(wanted))
    links, outcome = (lines.before, lines.after), (values[0], along)
    _run(scan, boosted_trees_lines.follow, there, ordered.xyz, ordered.t, *links, *outcome)
    values[1] = around.some[scan.back]
    if not spins:
        values[2] = around.other[scan.back]
    medians = np.stack([usual.step, usual.some, usual.spacing][: len(values)])
    _run(scan, boosted_trees_lines.usual, there, lines.first, values, scan.back, medians)
    steps, some = medians[:2]
    if spins:
        spacing = usual.part * ordered.range[scan.rank]
    else:
        known = np.maximum(np.where(steps < np.inf, steps, 0.0), medians[2])
        spacing = np.where(wanted, known, medians[2])
    sigma = _typical(along[along < np.inf]) if np.isnan(usual.along) else usual.along
    usual = Usual(
        np.maximum(spacing, SPACING_FLOOR),
        np.maximum(steps, SPACING_FLOOR),
        np.maximum(some, SPACING_FLOOR),
        usual.part,
        sigma,
        usual.surface,
    )
    contributions = np.zeros((len(wanted), len(FEATURES)))
    nearest = scan.neighbourhood.nearest(K).index
    own = scan.rank, *outcome
    _run(
        scan, _write_contributions, wanted, nearest, around, *own, usual, LEAST, MOST, contributions
    )
    return contributions, usual


def _run(scan: Scan, work: Callable[..., None], wanted: Bools, *arguments: object) -> None:
    """Do work for the wanted points in threads, few of them by the caller alone."""
    threads.run(
        lambda begin, end: work(begin, end, wanted, *arguments),
        len(wanted),
        CHUNK * len(wanted) // max(int(np.count_nonzero(wanted)), 1),
        scan.neighbourhood.threads,
    )


def _typical(values: Floats) -> float:
    """Return the median, but at least the floor."""
    return max(SIGMA_FLOOR, median(values.copy(), len(values))) if len(values) else SIGMA_FLOOR


@kernel
def _write_contributions(
    begin: int,
    end: int,
    wanted: Bools,
    nearest: NDArray[np.int32],
    around: Surroundings,
    rank: Ints,
    step: Floats,
    along: Floats,
    usual: Usual,
    least: Floats,
    most: Floats,
    contributions: Floats,
) -> None:
    """Write what the features contribute to the scores of the wanted of a range of points."""
    points, near, ratio = np.empty(LANES, np.int64), np.empty((K, LANES)), np.empty(len(least))
    while begin < end:
        count, begin = fill(points, wanted, begin, end)
        for lane in range(count):
            for m in range(K):
                near[m, lane] = around.some[nearest[points[lane], m]]
        sort(near, MIDDLE)
        for lane in range(count):
            i = points[lane]
            here = rank[i]
            off = around.off[i]
            own = around.scale[i] + OF_ALL * usual.surface
            even = min(EVEN * usual.surface / own, 1.0)
            sigmas = min(off / usual.surface, 2 * off / own, MANY_SIGMA) - FEW_SIGMA
            ratio[0] = around.few[i] / usual.spacing[i]
            # Where steps are lacking all around, that of a point contributes nothing.
            ratio[1] = step[here] / usual.step[i] if usual.step[i] < np.inf else 0.0
            ratio[2] = around.some[i] / usual.some[i]
            ratio[3] = (near[K // 2 - 1, lane] + near[K // 2, lane]) / 2 / around.all[i]
            ratio[4] = along[here] / usual.along
            ratio[6] = (NEAR + 1) / (around.others[i] + 1)
            ratio[SURFACE] = 1.0
            for w in range(len(least)):
                # A comparison with NaN, 0 ÷ 0 where all points coincide, is false: it adds nothing.
                value = np.log(ratio[w]) if ratio[w] > QUIET[w] else least[w]
                contributions[i, w] = min(max(value, least[w]), most[w]) - least[w]
            contributions[i, SURFACE] = max(sigmas, FOR) * even * around.amidst[i]
