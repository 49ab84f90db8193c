# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Table 1 and figures 2 and 4 of Sotoodeh (2007), and ours beside them."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Ints, Progress
from lidar_outlier_filter.core.detectors import hierarchical
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation.confusion import confusion
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.results.markdown import image, paragraphs, table
from lidar_outlier_lab.results.papers import panels, published
from lidar_outlier_lab.results.papers.panels import draw, view
from lidar_outlier_lab.simulation.papers import sotoodeh_clusters, tripod

PAPER = Hierarchical()  # 99 % and 95 %, 100 points: the paper's, the last for its scans only
MIN_CLUSTERS = (10, 20, 50, 100, 150)  # points of a cluster that stays
SCENES = 20
STEPS = 3
SLICE = 12.0  # metres to both sides of the scanner that figure 4 shows


def section(_presets: Sequence[str], seed: int, folder: Path, progress: Progress) -> str:
    """Judge simulated clouds of 656 points, and three scans of a street of houses."""
    progress(0, STEPS, 'clouds of 656 points')
    seeds = range(seed, seed + SCENES)
    tidy = [_counts(seeds, phase, cluttered=False) for phase in (1, 2)]
    cluttered = [_counts(seeds, phase, cluttered=True) for phase in (1, 2)]
    progress(1, STEPS, 'figure 2')
    xyz, bad = sotoodeh_clusters.simulate(seed, cluttered=True)
    draw_course(xyz, bad, PAPER, folder / 'sotoodeh2007_figure_2.png')
    progress(2, STEPS, 'figure 4')
    scans = _figure_4(seed, folder)
    return paragraphs(
        f'Means over the clouds of the seeds {seeds[0]} to {seeds[-1]}, points.',
        '### Table 1',
        _table(tidy, cluttered),
        '### Table 1 with other least clusters, both phases',
        _least(seeds),
        '### Figure 2',
        image('sotoodeh2007_figure_2.png', 'Input, trees, graphs and the clean cloud'),
        '### Figure 4',
        image('sotoodeh2007_figure_4.png', 'Three scans of a street before and after each phase'),
        f'Three scans of a street of houses from the side, {SLICE:.0f} m to both sides: before, '
        'after phase 1, after phase 2. Birds, flakes of snow and points between two surfaces are '
        'outliers.',
        scans,
    )


def _counts(seeds: Iterable[int], phase: int, *, cluttered: bool) -> tuple[float, ...]:
    """Return the means of the four counts of a phase, in the paper's order, of what it saw."""
    rows = []
    for seed in seeds:
        xyz, bad = sotoodeh_clusters.simulate(seed, cluttered=cluttered)
        outcome = hierarchical.detect(xyz, PAPER)
        seen = (outcome.phase == 0) | (outcome.phase >= phase)
        one = confusion(bad[seen], outcome.phase[seen] == phase)
        rows.append((one.kept, one.lost, one.missed, one.found))
    return tuple(map(float, np.mean(rows, axis=0)))


def _least(seeds: Iterable[int]) -> str:
    """Say what the size of the least cluster does on clouds with clutter."""
    scenes = [sotoodeh_clusters.simulate(seed, cluttered=True) for seed in seeds]
    rows = []
    for least in MIN_CLUSTERS:
        how = replace(PAPER, min_cluster=least)
        counts = [confusion(bad, hierarchical.detect(xyz, how).phase > 0) for xyz, bad in scenes]
        means = np.mean([(one.lost, one.missed, one.found) for one in counts], axis=0).tolist()
        rows.append((f'{least} points', *(f'{mean:.1f}' for mean in means)))
    return table(('least cluster', 'inliers lost', 'outliers left', 'outliers found'), rows)


def _table(tidy: Sequence[Sequence[float]], cluttered: Sequence[Sequence[float]]) -> str:
    head = (
        '',
        'points seen',
        'inliers kept',
        'inliers lost',
        'outliers left',
        'outliers found',
        'α-error',
        'β-error',
    )
    rows = []
    for phase in (0, 1):
        paper = published.HIERARCHICAL[phase]
        printed = (paper.kept, paper.lost, paper.missed, paper.found)
        for name, counts, digits in (
            ('paper', printed, 0),
            ('ours, with clutter', cluttered[phase], 1),
            ('ours, without', tidy[phase], 1),
        ):
            total = sum(counts)
            shares = (percent(counts[1] / total), percent(counts[2] / total))
            if name == 'paper':
                shares = published.HIERARCHICAL_PRINTED[phase]
            cells = (f'{one:.{digits}f}' for one in (total, *counts))
            rows.append((f'phase {phase + 1}: {name}', *cells, *shares))
    return table(head, rows)


def _figure_4(seed: int, folder: Path) -> str:
    """Draw three scans from above after each phase; count what goes and what stays."""
    views, rows = [], []
    for number, scan in enumerate(tripod.facades(seed), 1):
        xyz = scan.xyz
        bad = scan.points['label'] != Cause.GOOD
        phase = hierarchical.detect(xyz, PAPER).phase
        near = np.abs(xyz[:, 0] - np.median(xyz[:, 0])) < SLICE
        flat = xyz[near][:, [0, 2]]
        views.append(
            [
                view(f'scan {number}: before', flat, bad[near], np.ones(near.sum(), np.bool_)),
                view('after phase 1', flat, bad[near], (phase != 1)[near]),
                view('after phase 2', flat, bad[near], (phase == 0)[near]),
            ]
        )
        for after, rejected in ((1, phase == 1), (2, phase > 0)):
            counts = confusion(bad, rejected)
            rows.append(
                (
                    f'scan {number}, after phase {after}',
                    f'{counts.total:,}',
                    percent(counts.share('prevalence').ratio),
                    percent(counts.recall.ratio),
                    percent(counts.false_rejections.ratio),
                )
            )
    draw(views, folder / 'sotoodeh2007_figure_4.png', ('x, m', 'z, m'))
    return table(('', 'points', 'outliers', 'found', 'good points lost'), rows)


AZIMUTH, ELEVATION = np.radians(-58.0), np.radians(16.0)  # from where it is seen


def course(xyz: Floats, parameters: Hierarchical) -> tuple[Ints, Ints, Ints, Ints, Bytes]:
    """Go through the steps, to draw them; no two points may coincide.

    Edges are pairs of indices of points, (E, 2): of the spanning tree, and of what is left of it;
    of the Gabriel graphs of the clusters of phase 1 that are large enough, likewise. Last comes the
    phase (N,) that rejected each point; 0: none.
    """
    phase = hierarchical.detect(xyz, parameters).phase
    neighbourhood = Neighbourhood(xyz, 1)
    tree = hierarchical.spanning_tree(hierarchical.gabriel_graph(neighbourhood), len(xyz))
    kept = tree.length <= hierarchical.limit(tree.length, parameters.global_confidence)
    label = hierarchical.components(len(xyz), tree, kept)
    graphs, pruned = [], []
    for cluster in np.flatnonzero(np.bincount(label) >= parameters.min_cluster):
        members = neighbourhood.order[label == cluster]
        inside = Neighbourhood(xyz[members], 1)
        graph = hierarchical.gabriel_graph(inside)
        ends = members[inside.order[graph.ends]]
        graphs.append(ends)
        longest = hierarchical.limit(graph.length, parameters.local_confidence)
        pruned.append(ends[graph.length <= longest])
    ends = neighbourhood.order[tree.ends]
    empty = np.empty((0, 2), np.int64)
    left = np.concatenate([empty, *pruned])
    return ends, ends[kept], np.concatenate([empty, *graphs]), left, phase


def draw_course(xyz: Floats, bad: Bools, parameters: Hierarchical, path: Path) -> None:
    """Draw six panels: the cloud, its spanning tree, pruned, Gabriel graphs, pruned, the rest."""
    tree, pruned_tree, graph, pruned_graph, phase = course(xyz, parameters)
    every = np.ones(len(xyz), np.bool_)
    rough, clean = phase != 1, phase == 0
    nothing = np.empty((0, 2), np.int64)
    confidences = parameters.global_confidence, parameters.local_confidence
    interval = [f'{100 * one:.0f} %' for one in confidences]
    shown = (
        (f'a  input: {len(xyz)} points', every, nothing),
        ('b  Euclidean minimum spanning tree', every, tree),
        (f'c  tree pruned by the {interval[0]} interval', every, pruned_tree),
        ('d  Gabriel graphs of the large clusters', rough, graph),
        (f'e  graphs pruned by the {interval[1]} interval', rough, pruned_graph),
        (f'f  clean: {np.count_nonzero(clean)} points', clean, nothing),
    )
    flat = _project(xyz)
    # What was lost is shown in the last panel, where it would have stayed.
    views = []
    for title, some, edges in shown[:-1]:
        kept = np.ones(np.count_nonzero(some), np.bool_)
        views.append(panels.view(title, flat[some], bad[some], kept, flat[edges]))
    views.append(panels.view(shown[-1][0], flat, bad, clean))
    panels.draw([views[:3], views[3:]], path, ('right, m', 'up, m'), row=4.2)


def _project(xyz: Floats) -> Floats:
    """Look at points from afar: to the right and up on the picture, metres."""
    right = np.array([np.cos(AZIMUTH), -np.sin(AZIMUTH), 0.0])
    forward = np.array([np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    up = np.array([0.0, 0.0, np.cos(ELEVATION)]) + np.sin(ELEVATION) * forward
    return xyz @ np.stack([right, up], axis=1)
