# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hierarchical outlier detection: small components of graphs (Sotoodeh 2007).

Phase 1: edges of the Euclidean minimum spanning tree that are too long are cut, and the points of
components that are too small rejected. Phase 2: the same in each remaining component with its
Gabriel graph, whose more numerous edges describe the sampling interval. Too long means longer than

    median + z σ

of the lengths of all edges of the graph, with σ their standard deviation and z the half width of
the two-sided interval of the normal distribution that holds ``global_confidence`` (z = 2.576 for
0.99) or ``local_confidence`` (1.960 for 0.95) of it. Too small means fewer than ``min_cluster``
points; the paper's "density" of a cluster is this number.

Both graphs are exact. The paper finds them in the Delaunay triangulation, whose edges are not
unique on a grid; on 20 000 points Qhull takes sixteen times as long as the search for the Gabriel
graph here. The minimum spanning tree is part of that graph, and found in it. Without their edges
beyond a length, both fall into the same components. So the Gabriel graph of a cluster gives the
limit of phase 2, and the spanning tree of the whole cloud all clusters, because what is left of it
in a cluster is that cluster's own spanning tree.

Where this is not the paper, or corrects it:

* "Connected if the largest ball passing through the two points is empty" must read smallest: the
  largest is half of space.
* Coincident points are one vertex, because edges of length 0 would lower the median; each of them
  counts in the size of its cluster.
* σ is at least a thousandth of the median. On lines and grids of equal steps it would be that of
  their rounding, and edges that are longer by a rounding would be cut.
* The shares in its Table 1 are of all points that the phase has seen, and so smaller than what is
  commonly called errors of the first and second kind; the two phases do not add up there (phase 1
  leaves 569 + 9 points, phase 2 begins with 571 + 7).

Phase 1 supposes one sampling interval for the whole cloud: surfaces that are scanned sparsely, far
away or at a grazing angle, are rejected. In phase 2 long edges between surfaces that face each
other enlarge σ: in a street or a room it finds little more than phase 1.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.special import ndtri

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Index, Ints
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.parameters.filter import FilterParameters

SECOND_PHASE = 1 << 15  # bit beside its own: the second phase rejected the point
MIN_SPREAD = 1e-3  # of the median
POINTS_AT_ONCE = 2048  # points that a thread takes at once


class Edges(NamedTuple):
    """E edges between N points.

    Attributes
    ----------
    ends : (E, 2) int32
        The points, in tree order.
    length : (E,) float64
        Metres.

    """

    ends: Index
    length: Floats


@dataclass(frozen=True)
class ClusterOutcome:
    """Result of both phases for N points.

    Attributes
    ----------
    score : (N,) float64
        ``min_cluster`` ÷ size of the cluster: more than 1 exactly where rejected; NaN for untested
        points.
    phase : (N,) uint8
        1 or 2, the phase that rejected the point; 0 where none did.
    cluster : (N,) int64
        Size of the point's cluster: in phase 1 if that rejected the point, otherwise in phase 2;
        0 for untested points.

    """

    score: Floats
    phase: NDArray[np.uint8]
    cluster: Ints


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    outcome = detect(seen.points.xyz, parameters.of(Hierarchical), seen.threads)
    return Scores(outcome.score, (outcome.phase == 2) * np.uint16(SECOND_PHASE))  # noqa: PLR2004


def detect(xyz: Floats, parameters: Hierarchical, threads: int = 0) -> ClusterOutcome:
    """Test the size of every point's cluster.

    Parameters
    ----------
    xyz : (N, 3) float64, finite, metres; fewer than ``min_cluster`` points stay untested
    parameters : see :class:`~.builtin.Hierarchical`
    threads : at most so many, 0 for all cores; the outcome does not depend on it

    Returns
    -------
    ClusterOutcome
        In the order in which the points were given.

    Raises
    ------
    FilterError
        If a coordinate is not finite, or so large that its square is not.

    References
    ----------
    .. [1] Sotoodeh (2007): Hierarchical clustered outlier detection in laser scanner point clouds.
       ISPRS Commission V/3.

    Examples
    --------
    >>> import numpy as np
    >>> from lidar_outlier_filter.core.detectors import hierarchical
    >>> from lidar_outlier_filter.core.detectors.builtin import Hierarchical
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> outcome = hierarchical.detect(xyz, Hierarchical())
    >>> np.flatnonzero(outcome.score > 1).tolist(), int(outcome.phase[77])
    ([77], 1)

    """
    count, least = len(xyz), parameters.min_cluster
    if count < max(least, 1):
        none = np.zeros(count, np.int64)
        return ClusterOutcome(np.full(count, np.nan), none.astype(np.uint8), none)
    hood, index, (copy, original) = Neighbourhood(xyz, 1, threads).distinct()
    first, place = np.arange(count), np.empty(count, np.int64)  # the first at the same place
    first[copy], place[index] = original, np.arange(len(hood))
    copies = np.bincount(first)[index]
    graph = gabriel_graph(hood, threads)
    tree = spanning_tree(graph, len(hood))
    kept = tree.length <= limit(tree.length, parameters.global_confidence)
    rough = components(len(hood), tree, kept)
    size = _sizes(rough, copies)
    # A component that phase 1 rejects stays what it is.
    local = np.full(len(size), np.inf)
    parts = np.split(np.argsort(rough, kind='stable'), np.cumsum(np.bincount(rough))[:-1])
    for which in np.flatnonzero(size >= least):
        members = parts[which]
        if len(members) < len(hood):
            graph = gabriel_graph(Neighbourhood(hood.xyz[members], 1, threads), threads)
        local[which] = limit(graph.length, parameters.local_confidence)
    kept &= tree.length <= local[rough[tree.ends[:, 0]]]
    fine = components(len(hood), tree, kept)
    final = _sizes(fine, copies)[fine]
    at = place[first]  # where each point is in tree order
    phase = np.where(size[rough] < least, 1, 2 * (final < least)).astype(np.uint8)
    return ClusterOutcome(least / final[at], phase[at], final[at])


def gabriel_graph(neighbourhood: Neighbourhood, threads: int = 0) -> Edges:
    """Find all pairs of points whose ball, with their distance as diameter, has no point inside.

    Two points have an edge if no other sees them at an obtuse angle. So with r another point, q has
    no edge to p if (r - p)·(r - q) < 0: if it is beyond the plane through r at a right angle to
    p - r. The planes of the points around p leave only a small region, Voronoi's cell of p twice as
    large, and nodes of a kd-tree beyond one of them hold no candidates. The few that are left are
    tested with all points that the ball may hold. Time is near-linear for points on surfaces.

    Points on the ball do not count, as in the paper. On a grid both diagonals of a square are
    edges, so that the graph is unique, but not part of any one Delaunay triangulation.

    Parameters
    ----------
    neighbourhood : N points, no two of which coincide
    threads : as everywhere; the graph does not depend on it

    Returns
    -------
    Edges
        In no particular order, but always in the same.

    """
    xyz, tree = neighbourhood.xyz, neighbourhood.tree

    def work(begin: int, end: int) -> Index:
        return _kernels.gabriel_edges(xyz, tree, begin, end)

    ends = np.concatenate(pool.run(work, len(neighbourhood), POINTS_AT_ONCE, threads))
    x, y, z = (xyz[ends[:, 0]] - xyz[ends[:, 1]]).T
    return Edges(ends, np.sqrt((x * x + y * y) + z * z))


def spanning_tree(graph: Edges, count: int) -> Edges:
    """Find the minimum spanning tree of a connected graph of so many points."""
    # Of two positions that are very near, the square of the distance may be 0, which is no edge.
    length = np.maximum(graph.length, np.finfo(np.float64).tiny)
    tree = minimum_spanning_tree(coo_array((length, graph.ends.T), (count, count)).tocsr()).tocoo()
    return Edges(np.stack((tree.row, tree.col), axis=1), tree.data)


def limit(length: Floats, confidence: float) -> float:
    """Return the length of the longest edge that is not cut; inf where there are no edges.

    Sums are taken in the order of length, so that they do not depend on that of the edges.
    """
    if not len(length):
        return float('inf')
    length = np.sort(length)
    middle = float(np.median(length))
    spread = float(np.std(length, ddof=1)) if len(length) > 1 else 0.0
    return middle + float(ndtri((1 + confidence) / 2)) * max(spread, MIN_SPREAD * middle)


def components(count: int, edges: Edges, kept: NDArray[np.bool_]) -> Ints:
    """Return the number of the component of each point, by the edges that are kept."""
    ends = edges.ends[kept].T
    graph = coo_array((np.ones(ends.shape[1], np.bool_), ends), (count, count))
    label: Ints = connected_components(graph, directed=False)[1]
    return label


def _sizes(label: Ints, copies: Ints) -> Ints:
    """Count the points of each component, of positions with so many points each."""
    sizes: Ints = np.bincount(label, copies).astype(np.int64)
    return sizes
