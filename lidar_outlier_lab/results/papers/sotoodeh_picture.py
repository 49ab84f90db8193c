# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the course of hierarchical outlier detection, as figure 2 of Sotoodeh (2007)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors import hierarchical
from lidar_outlier_filter.core.detectors.gabriel import gabriel_graph
from lidar_outlier_filter.core.detectors.hierarchical import (
    components,
    limit,
    spanning_tree,
)
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_lab.results.papers import panels

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Floats, Ints
    from lidar_outlier_filter.core.detectors.builtin import Hierarchical
    from lidar_outlier_lab.simulation.papers.sotoodeh_clusters import LabelledClusters

AZIMUTH, ELEVATION = np.radians(-58.0), np.radians(16.0)  # from where it is seen


class Course(NamedTuple):
    """What each step leaves of the graphs, as pairs of indices of points, and of the points.

    Attributes
    ----------
    tree, pruned_tree : (E, 2) int64
        The spanning tree, and what is left of it.
    graph, pruned_graph : (E, 2) int64
        The Gabriel graphs of the clusters of phase 1 that are large enough, likewise.
    phase : (N,) uint8
        The phase that rejected the point; 0: none.

    """

    tree: Ints
    pruned_tree: Ints
    graph: Ints
    pruned_graph: Ints
    phase: NDArray[np.uint8]


def course(xyz: Floats, parameters: Hierarchical) -> Course:
    """Go through the steps, for a look at them; no two points may coincide."""
    phase = hierarchical.detect(xyz, parameters).phase
    neighbourhood = Neighbourhood(xyz, 1)
    tree = spanning_tree(gabriel_graph(neighbourhood), len(xyz))
    kept = tree.length <= limit(tree.length, parameters.global_confidence)
    label = components(len(xyz), tree, kept)
    graphs, pruned = [], []
    for cluster in np.flatnonzero(np.bincount(label) >= parameters.min_cluster):
        members = neighbourhood.order[label == cluster]
        inside = Neighbourhood(xyz[members], 1)
        graph = gabriel_graph(inside)
        ends = members[inside.order[graph.ends]]
        graphs.append(ends)
        pruned.append(ends[graph.length <= limit(graph.length, parameters.local_confidence)])
    ends = neighbourhood.order[tree.ends]
    empty = np.empty((0, 2), np.int64)
    return Course(
        ends, ends[kept], np.concatenate([empty, *graphs]), np.concatenate([empty, *pruned]), phase
    )


def draw(scene: LabelledClusters, parameters: Hierarchical, path: Path) -> None:
    """Draw six panels: the cloud, its spanning tree, pruned, Gabriel graphs, pruned, the rest."""
    steps = course(scene.xyz, parameters)
    every = np.ones(len(scene.xyz), np.bool_)
    rough, clean = steps.phase != 1, steps.phase == 0
    nothing = np.empty((0, 2), np.int64)
    interval = f'{parameters.global_confidence:.0%}', f'{parameters.local_confidence:.0%}'
    shown = (
        (f'a  input: {len(scene.xyz)} points', every, nothing),
        ('b  Euclidean minimum spanning tree', every, steps.tree),
        (f'c  tree pruned by the {interval[0]} interval', every, steps.pruned_tree),
        ('d  Gabriel graphs of the large clusters', rough, steps.graph),
        (f'e  graphs pruned by the {interval[1]} interval', rough, steps.pruned_graph),
        (f'f  clean: {np.count_nonzero(clean)} points', clean, nothing),
    )
    flat = _project(scene.xyz)
    # What was lost is shown in the last panel, where it would have stayed.
    views = []
    for title, some, edges in shown[:-1]:
        kept = np.ones(np.count_nonzero(some), np.bool_)
        views.append(panels.view(title, flat[some], scene.outlier[some], kept, flat[edges]))
    views.append(panels.view(shown[-1][0], flat, scene.outlier, clean))
    panels.draw([views[:3], views[3:]], path, ('right, m', 'up, m'), row=4.2)


def _project(xyz: Floats) -> Floats:
    """Look at points from afar: to the right and up on the picture, metres."""
    right = np.array([np.cos(AZIMUTH), -np.sin(AZIMUTH), 0.0])
    forward = np.array([np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    up = np.array([0.0, 0.0, np.cos(ELEVATION)]) + np.sin(ELEVATION) * forward
    flat: Floats = xyz @ np.stack([right, up], axis=1)
    return flat
