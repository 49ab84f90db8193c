# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hierarchical outlier detection: clusters that graphs fall into (Sotoodeh 2007).

Phase 1: edges of the Euclidean minimum spanning tree that are too long are cut, and the points of
components that are too small rejected. Phase 2: in each component that is left, by itself, the same
with its Gabriel graph, whose edges show more of the sampling interval. Too long means longer than

    median + z σ

of the lengths of all edges of the graph, with σ their standard deviation and z the half width of
the two-sided interval of the normal distribution that holds ``global_confidence`` (z = 2.576 for
0.99) or ``local_confidence`` (1.960 for 0.95) of it. Too small means fewer than ``min_cluster``
points; the paper's "density" of a cluster is this number.

Both graphs are exact, without the Delaunay triangulation in which the paper finds them. The minimum
spanning tree is part of the Gabriel graph, and both, without their edges beyond a length, fall into
the same components: points that steps of at most that length lead between. So the Gabriel graph
gives the limit of phase 2, and the spanning tree of the whole cloud all clusters, because what is
left of it in a cluster is that cluster's own spanning tree.

Where this is not the paper, or corrects it:

* "Connected if the largest ball passing through the two points is empty" must read smallest: the
  largest is half of space.
* Coincident points are one place. They have no edges, whose length of 0 would drag the median down,
  and each of them counts in the size of its cluster.
* σ is at least a thousandth of the median. On lines and grids of equal steps it would be that of
  their rounding, and edges that are longer by a rounding would be cut.
* The shares in its Table 1 are of all points that the phase has seen, and so smaller than what is
  commonly called errors of the first and second kind; the two phases do not add up there (phase 1
  leaves 569 + 9 points, phase 2 begins with 571 + 7).

Phase 1 supposes one sampling interval for the whole cloud: surfaces that are scanned sparsely, far
away or at a grazing angle, are rejected. In phase 2 edges across the air between surfaces that face
each other are among those that make σ: in a street or a room it finds little more than phase 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtri

from lidar_outlier_filter.core.detectors.hierarchical.gabriel import gabriel_graph
from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
from lidar_outlier_filter.core.detectors.hierarchical.spanning_tree import Edges, spanning_tree
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Floats, Ints
    from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
    from lidar_outlier_filter.parameters.filter import FilterParameters

SECOND_PHASE = 1 << 15  # bit beside its own: the second phase rejected the point
LEAST_SPREAD = 1e-3  # of the median


@dataclass(frozen=True)
class ClusterOutcome:
    """What the two phases say of N points.

    Attributes
    ----------
    score : (N,) float64
        ``min_cluster`` ÷ size of the cluster: more than 1 exactly where rejected; NaN for untested
        points.
    phase : (N,) uint8
        1 or 2, the phase that rejected the point; 0 where none did.
    cluster : (N,) int64
        Points of the cluster that the point was in at last: of phase 1 where that rejected it,
        otherwise of phase 2; 0 for untested points.

    """

    score: Floats
    phase: NDArray[np.uint8]
    cluster: Ints


def score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    """Score every point of a chain's input."""
    outcome = detect(seen.points.xyz, parameters.of(Hierarchical), seen.threads)
    return Scores(outcome.score, (outcome.phase == 2) * np.uint16(SECOND_PHASE))  # noqa: PLR2004


def detect(xyz: Floats, parameters: Hierarchical, threads: int = 0) -> ClusterOutcome:
    """Test to how large a cluster every point belongs.

    Parameters
    ----------
    xyz : (N, 3) float64, finite, metres; fewer than ``min_cluster`` points stay untested
    parameters : see :class:`~.hierarchical.parameters.Hierarchical`
    threads : at most so many, 0 for all cores; the outcome does not depend on it

    Returns
    -------
    Outcome
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
    >>> from lidar_outlier_filter.core.detectors.hierarchical import detector as hierarchical
    >>> from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
    >>> x, y = np.divmod(np.arange(900.0), 30)
    >>> xyz = np.column_stack([x, y, 0.01 * np.sin(x)])
    >>> xyz[77, 2] = 6.0  # above a floor
    >>> outcome = hierarchical.detect(xyz, Hierarchical())
    >>> np.flatnonzero(outcome.score > 1).tolist(), int(outcome.phase[77])
    ([77], 1)

    """
    count, least = len(xyz), parameters.min_cluster
    if count < max(least, 1):
        return ClusterOutcome(
            np.full(count, np.nan), np.zeros(count, np.uint8), np.zeros(count, np.int64)
        )
    neighbourhood = Neighbourhood(xyz, 1, threads)
    tree = spanning_tree(neighbourhood, threads)
    longest = limit(tree.length[tree.length > 0], parameters.global_confidence)
    rough, size = clusters(count, tree, tree.length <= longest)
    local = np.full(len(size), np.inf)
    for which, places in _places(neighbourhood, tree, rough, size, least, threads):
        length = gabriel_graph(places, threads).length
        local[which] = limit(length, parameters.local_confidence)
    # Components that phase 1 rejects have no limit, and stay what they are.
    kept = (tree.length <= longest) & (tree.length <= local[rough[tree.ends[:, 0]]])
    fine, final = clusters(count, tree, kept)
    cluster = np.empty(count, np.int64)
    phase = np.zeros(count, np.uint8)
    cluster[neighbourhood.order] = final[fine]
    phase[neighbourhood.order] = np.where(size[rough] < least, 1, 2 * (final[fine] < least))
    return ClusterOutcome(least / cluster, phase, cluster)


def limit(length: Floats, confidence: float) -> float:
    """Return the length of the longest edge that is not cut; inf where there are no edges.

    Sums are taken in the order of length, so that they do not depend on that of the edges.
    """
    if not len(length):
        return float('inf')
    length = np.sort(length)
    middle = float(np.median(length))
    spread = float(np.std(length, ddof=1)) if len(length) > 1 else 0.0
    return middle + float(ndtri((1 + confidence) / 2)) * max(spread, LEAST_SPREAD * middle)


def clusters(count: int, edges: Edges, kept: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Return the number of the component of each point, and the size of each component."""
    i, j = edges.ends[kept].T
    graph = coo_array((np.ones(len(i), np.bool_), (i, j)), (count, count))
    _, label = connected_components(graph, directed=False)
    return label, np.bincount(label)


def _places(
    neighbourhood: Neighbourhood,
    tree: Edges,
    label: Ints,
    size: Ints,
    least: int,
    threads: int,
) -> Iterator[tuple[int, Neighbourhood]]:
    """Yield each large enough component with its distinct points."""
    first = np.arange(len(label))
    coincident = tree.length == 0
    if coincident.any():
        # Edges of length 0 hold them together; the first one stands for all.
        _, first = np.unique(clusters(len(label), tree, coincident)[0], return_index=True)
    elif len(size) == 1:
        yield 0, neighbourhood
        return
    first = first[np.argsort(label[first], kind='stable')]
    ends = np.searchsorted(label[first], np.arange(len(size) + 1))
    for which in np.flatnonzero(size >= least):
        members = first[ends[which] : ends[which + 1]]
        yield int(which), Neighbourhood(neighbourhood.xyz[members], 1, threads)
