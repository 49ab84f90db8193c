# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The Gabriel graph, without a triangulation (Gabriel and Sokal 1969; Sotoodeh 2007, section 3.2).

Two points have an edge if the ball between them, of which their distance is the diameter, has no
other point inside: if none sees the two at an obtuse angle. So with r another point, q has no edge
to p if (r - p)·(r - q) < 0: if it is beyond the plane through r at a right angle to p - r. The
planes of the points around p leave only a small region, Voronoi's cell of p twice as large, and
nodes of a kd-tree beyond one of them hold no candidates. The few that are left are tested with all
points that the ball may hold. This makes the graph exact; its memory are its edges, and its
time is near-linear for points that lie on surfaces.

Points on the ball do not count: the ball is open, as in the paper. On a grid both diagonals of a
square are edges, so that the graph is unique, but not part of any one Delaunay triangulation.
"""

from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Index
from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

CHUNK = 2048  # points that a thread takes at once


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


def gabriel_graph(neighbourhood: Neighbourhood, threads: int = 0) -> Edges:
    """Find all pairs of points with nothing inside the ball between them.

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

    ends = np.concatenate(pool.run(work, len(neighbourhood), CHUNK, threads))
    return Edges(ends, _kernels.edge_lengths(xyz, ends))
