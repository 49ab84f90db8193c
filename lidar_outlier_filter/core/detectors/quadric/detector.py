# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Quadric surfaces through the neighbourhood (Leslar, Wang and Hu 2010, section 2.2).

Windows are sections (algorithm c of the paper) or patches (algorithm b). The cores of the sections
are the largest subtrees with at most ``section`` points; they divide the cloud. The window of a
core is the core and a rim: the points in its box, grown on every side. Each point is tested in the
window of its core. One that fails there is accepted if it lies on a surface of another window that
holds it: the foot of a pole has too few points in a window with the road, but enough in the
window above it.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri, stdtrit

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.builtin import Quadric
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.quadric.fits import Window, empty_window
from lidar_outlier_filter.core.detectors.quadric.surfaces import MIN_POINTS, Rules, judge
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads
from lidar_outlier_filter.core.kernels.kernels import kernel, noalias_kernel
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.tree_build import Tree
from lidar_outlier_filter.core.neighbours.tree_walks import Bounds, gap, height, leaves
from lidar_outlier_filter.parameters.filter import FilterParameters

SECTIONS = 64  # that a thread judges at once
PATCHES = 1024
LEAVES = 512
MARGIN = 0.25  # of the largest extent of a core's box: how far the rim reaches
ENOUGH = 1.5  # times the points of the core: what a window has at least
SMALLEST = 2.0**-20  # of the largest extent of the cloud: the margin around a single place
RIM = 3  # times the points of the largest core: the most on a rim; of more every so-manieth counts
FREEDOMS = 1000  # degrees of freedom in the tables; beyond, quantiles do not change


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
    if len(neighbourhood) < MIN_POINTS:
        return score
    place = _positions(neighbourhood)
    xyz = np.take(neighbourhood.xyz, place, axis=0)
    order = neighbourhood.order[place]
    weights = np.ones(len(score)) if variance is None else variance[order]
    if parameters.window == 'patch':
        _patches(neighbourhood, place, parameters, xyz, weights, score)
    else:
        _sections(neighbourhood, parameters, xyz, weights, score)
    share_scores(xyz, score)
    result = np.empty_like(score)
    result[order] = score
    return result


def _positions(neighbourhood: Neighbourhood) -> Ints:
    """Sort the points of every leaf by x, y and z: tree positions, in the new order.

    Tree order within a leaf is that in which the points were given, which must not matter.
    """
    tree, place = neighbourhood.tree, np.arange(len(neighbourhood))
    these = leaves(tree)
    threads.run(
        lambda begin, end: sort_leaves(neighbourhood.xyz, tree, these[begin:end], place),
        len(these),
        LEAVES,
        neighbourhood.threads,
    )
    return place


def _sections(
    neighbourhood: Neighbourhood, parameters: Quadric, xyz: Floats, variance: Floats, score: Floats
) -> None:
    tree, section, rules = neighbourhood.tree, parameters.section, _rules(parameters)
    levels, cores = height(tree), find_cores(tree, section)
    room = int((tree.last - tree.first)[cores].max()) + RIM * section

    def work(begin: int, end: int) -> tuple[NDArray[np.int64], Floats]:
        window = empty_window(room)
        return judge_sections(
            xyz, variance, tree, levels, cores[begin:end], section, rules, window, score
        )

    others = threads.run(work, len(cores), SECTIONS, neighbourhood.threads)
    failed = ~(score <= 1)
    for index, value in others:  # the least counts
        of_failed = failed[index]
        np.fmin.at(score, index[of_failed], value[of_failed])


def _patches(
    neighbourhood: Neighbourhood,
    place: NDArray[np.int64],
    parameters: Quadric,
    xyz: Floats,
    variance: Floats,
    score: Floats,
) -> None:
    rules = _rules(parameters)
    nearest = neighbourhood.nearest(min(parameters.k, len(xyz) - 1)).index
    rank = np.empty(len(xyz), np.int64)
    rank[place] = np.arange(len(xyz))

    def work(begin: int, end: int) -> None:
        window = empty_window(nearest.shape[1] + 1)
        judge_patches(xyz, variance, nearest, place, rank, begin, end, rules, window, score)

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


# Windows ------------------------------------------------------------------------------------------


@kernel
def sort_leaves(xyz: Floats, tree: Tree, these: Ints, place: Ints) -> None:
    """Sort the positions of the points of some leaves."""
    for node in these:
        for i in range(tree.first[node] + 1, tree.last[node]):
            one = place[i]
            j = i
            while j > tree.first[node] and _is_before(xyz, one, place[j - 1]):
                place[j] = place[j - 1]
                j -= 1
            place[j] = one


@noalias_kernel
def _is_before(xyz: Floats, one: int, other: int) -> bool:
    for axis in range(3):
        if xyz[one, axis] != xyz[other, axis]:
            return bool(xyz[one, axis] < xyz[other, axis])
    return False


@kernel
def share_scores(xyz: Floats, score: Floats) -> None:
    """Give coincident points, which are adjacent, their lowest score.

    Which of them is in the fit depends on their order.
    """
    begin = 0
    for i in range(1, len(score) + 1):
        if i == len(score) or _is_before(xyz, i - 1, i) or _is_before(xyz, i, i - 1):
            least = score[begin]
            for j in range(begin + 1, i):
                least = np.fmin(least, score[j])
            score[begin:i] = least
            begin = i


@kernel
def find_cores(tree: Tree, most: int) -> Ints:
    """Find the largest subtrees with at most so many points, in tree order: their nodes.

    Larger leaves, of coincident points, are cores, too.
    """
    cores = np.empty(len(tree.first), np.int64)
    count = 0
    todo = [0]
    while len(todo) > 0:
        node = todo.pop()
        if tree.last[node] - tree.first[node] <= most or tree.child[node] < 0:
            cores[count] = node
            count += 1
        else:
            todo.append(tree.child[node] + 1)
            todo.append(tree.child[node])
    return cores[:count]


@kernel
def find_window(xyz: Floats, tree: Tree, core: int, section: int, found: Ints, stack: Ints) -> int:
    """Find the points of a core's window, in tree order; return their number.

    ``found`` holds the core, ``RIM`` × ``section`` more points, and one; ``stack`` is to search.
    """
    size = tree.last[core] - tree.first[core]
    extent, most = (tree.high[core] - tree.low[core]).max(), (tree.high[0] - tree.low[0]).max()
    margin = MARGIN * extent if extent > 0 else SMALLEST * most
    enough = min(len(xyz), max(section, int(ENOUGH * size)))
    count = _visit(xyz, tree, core, margin, 1, found, stack)
    while count < enough and margin <= most:
        margin *= 2
        count = _visit(xyz, tree, core, margin, 1, found, stack)
    rim = count - size
    if rim > RIM * section:
        stride = -(-rim // (RIM * section))
        count = _visit(xyz, tree, core, margin, stride, found, stack)
    return count


@noalias_kernel
def _visit(
    xyz: Floats, tree: Tree, core: int, margin: float, stride: int, found: Ints, stack: Ints
) -> int:
    """Visit the points in the box of the core grown by a margin, faces included, in tree order.

    All points of the core, and of the others every ``stride``-th, go into ``found`` while there
    is room; returns their number.
    """
    box = (
        tree.low[core, 0] - margin,
        tree.low[core, 1] - margin,
        tree.low[core, 2] - margin,
        tree.high[core, 0] + margin,
        tree.high[core, 1] + margin,
        tree.high[core, 2] + margin,
    )
    begin, end = tree.first[core], tree.last[core]
    count, rim, room = 0, 0, len(found) - 1
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if gap(tree, node, box) > 0:
            continue
        child = tree.child[node]
        if child >= 0:
            stack[waiting], stack[waiting + 1] = child + 1, child
            waiting += 2
            continue
        for i in range(tree.first[node], tree.last[node]):
            # Without a branch, which a processor could not predict.
            inside, outer = _is_in(xyz, i, box), (i < begin) | (i >= end)
            rim += inside & outer
            skipped = stride > 1 and outer and (rim - 1) % stride > 0
            found[min(count, room)] = i
            count += inside & (not skipped)
    return count


@noalias_kernel
def _is_in(xyz: Floats, i: int, box: Bounds) -> bool:
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    across = (box[0] <= x) & (x <= box[3]) & (box[1] <= y) & (y <= box[4])
    return bool(across & (box[2] <= z) & (z <= box[5]))


@kernel
def judge_sections(
    xyz: Floats,
    variance: Floats,
    tree: Tree,
    levels: int,
    cores: Ints,
    section: int,
    rules: Rules,
    window: Window,
    score: Floats,
) -> tuple[Ints, Floats]:
    """Judge the points of some cores, each in its window; fill their scores, in tree order.

    ``levels`` is the height of the tree.

    Returns
    -------
    index, value : (A,) int64, (A,) float64
        The points on rims that lie on a surface, and their score in that window.

    """
    found, stack = np.empty(len(window.score) + 1, np.int64), np.empty(levels + 1, np.int64)
    index = np.empty(len(cores) * RIM * section, np.int64)
    value = np.empty(len(index))
    acquitted = 0
    for core in cores:
        first, last = tree.first[core], tree.last[core]
        n = find_window(xyz, tree, core, section, found, stack)
        _fill(window, xyz, variance, found[:n])
        judge(window, n, rules)
        for i in range(n):
            if first <= found[i] < last:
                score[found[i]] = window.score[i]
            elif window.score[i] <= 1:
                index[acquitted] = found[i]
                value[acquitted] = window.score[i]
                acquitted += 1
    return index[:acquitted].copy(), value[:acquitted].copy()


@kernel
def judge_patches(
    xyz: Floats,
    variance: Floats,
    nearest: NDArray[np.int32],
    place: Ints,
    rank: Ints,
    begin: int,
    end: int,
    rules: Rules,
    window: Window,
    score: Floats,
) -> None:
    """Judge points begin to end, each in the window of its nearest; fill their scores.

    ``nearest`` is by tree position, all else in the order of :func:`sort_leaves`: ``place`` and
    ``rank`` lead from that to the tree and back.
    """
    n = nearest.shape[1] + 1
    found = np.empty(n, np.int64)
    for i in range(begin, end):
        found[0] = i
        for k in range(n - 1):
            found[k + 1] = rank[nearest[place[i], k]]
        # In tree order those that follow each other lie together.
        found.sort()
        _fill(window, xyz, variance, found)
        judge(window, n, rules)
        score[i] = window.score[np.searchsorted(found, i)]


@noalias_kernel
def _fill(window: Window, xyz: Floats, variance: Floats, found: Ints) -> None:
    """Copy points into the window."""
    for k in range(len(found)):
        i = found[k]
        for axis in range(3):
            window.xyz[axis, k] = xyz[i, axis]
        window.variance[k] = variance[i]
