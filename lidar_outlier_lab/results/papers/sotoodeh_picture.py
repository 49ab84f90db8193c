# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the course of hierarchical outlier detection, as figure 2 of Sotoodeh (2007)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from lidar_outlier_filter.core.detectors.hierarchical import detector as hierarchical
from lidar_outlier_filter.core.detectors.hierarchical.detector import (
    components,
    limit,
    spanning_tree,
)
from lidar_outlier_filter.core.detectors.hierarchical.gabriel import gabriel_graph
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_lab.results.pictures import INK, LEFT, LOST, PAPER, add_legend, save

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Bools, Floats, Ints
    from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
    from lidar_outlier_lab.simulation.papers.sotoodeh_clusters import LabelledClusters

WIDTH, HEIGHT, DPI = 14.0, 9.0, 100  # inches, dots per inch
COLOURS = 64  # of the palette: keeps the file small
POINT, EDGE = '#5c6168', '#9aa0a6'
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
    everything = np.ones(len(scene.xyz), np.bool_)
    rough, clean = steps.phase != 1, steps.phase == 0
    nothing = np.empty((0, 2), np.int64)
    interval = f'{parameters.global_confidence:.0%}', f'{parameters.local_confidence:.0%}'
    panels = (
        (f'a  input: {len(scene.xyz)} points', everything, nothing),
        ('b  Euclidean minimum spanning tree', everything, steps.tree),
        (f'c  tree pruned by the {interval[0]} interval', everything, steps.pruned_tree),
        ('d  Gabriel graphs of the large clusters', rough, steps.graph),
        (f'e  graphs pruned by the {interval[1]} interval', rough, steps.pruned_graph),
        (f'f  clean: {np.count_nonzero(clean)} points', clean, nothing),
    )
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    flat = _project(scene.xyz)
    for number, (name, shown, edges) in enumerate(panels):
        left, bottom = 0.01 + 0.333 * (number % 3), 0.485 - 0.48 * (number // 3)
        axes = figure.add_axes((left, bottom, 0.315, 0.43))
        _panel(axes, flat, scene.outlier, shown, edges)
        axes.set_title(name, loc='left', fontsize=13, fontweight='bold', color=INK, pad=4)
    # What was lost is shown where it would have stayed.
    lost = ~clean & ~scene.outlier
    axes.scatter(flat[lost, 0], flat[lost, 1], s=14, c=LOST, linewidths=0)
    _legend(figure, with_lost=bool(lost.any()))
    save(canvas, path, COLOURS)


def _project(xyz: Floats) -> Floats:
    """Look at points from afar: to the right and up on the picture, metres."""
    right = np.array([np.cos(AZIMUTH), -np.sin(AZIMUTH), 0.0])
    forward = np.array([np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    up = np.array([0.0, 0.0, np.cos(ELEVATION)]) + np.sin(ELEVATION) * forward
    flat: Floats = xyz @ np.stack([right, up], axis=1)
    return flat


def _panel(axes: Axes, flat: Floats, outlier: Bools, shown: Bools, edges: Ints) -> None:
    axes.add_collection(LineCollection(list(flat[edges]), colors=EDGE, linewidths=0.7))
    for some, colour, size in ((shown & ~outlier, POINT, 6), (shown & outlier, LEFT, 14)):
        axes.scatter(flat[some, 0], flat[some, 1], s=size, c=colour, linewidths=0, zorder=2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    axes.set_xlim(low[0] - 0.1, high[0] + 0.1)
    axes.set_ylim(low[1] - 0.1, high[1] + 0.1)
    axes.set_aspect('equal')
    axes.axis('off')


def _legend(figure: Figure, *, with_lost: bool) -> None:
    entries = [('good point', POINT), ('outlier still in the cloud', LEFT)]
    if with_lost:
        entries.append(('good point taken out', LOST))
    add_legend(figure, entries)
