# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Table 1 and figures 2 and 4 of Sotoodeh (2007), and ours beside them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.core.detectors import hierarchical
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_filter.evaluation.confusion import confusion
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.results.markdown import image, paragraphs, table
from lidar_outlier_lab.results.papers import published, sotoodeh_picture
from lidar_outlier_lab.results.papers.panels import draw, view
from lidar_outlier_lab.simulation.papers import sotoodeh_clusters, tripod

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from lidar_outlier_filter.core.annotations import Progress

PAPER = Hierarchical()  # 99 % and 95 %, 100 points: the paper's, the last for its scans only
LEAST = (10, 20, 50, 100, 150)  # points of a cluster that stays
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
    scene = sotoodeh_clusters.simulate(seed, cluttered=True)
    sotoodeh_picture.draw(scene, PAPER, folder / 'sotoodeh2007_figure_2.png')
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
        scene = sotoodeh_clusters.simulate(seed, cluttered=cluttered)
        outcome = hierarchical.detect(scene.xyz, PAPER)
        seen = (outcome.phase == 0) | (outcome.phase >= phase)
        rejected = outcome.phase[seen] == phase
        bad = scene.outlier[seen]
        rows.append(
            (
                np.sum(~bad & ~rejected),
                np.sum(~bad & rejected),
                np.sum(bad & ~rejected),
                np.sum(bad & rejected),
            )
        )
    return tuple(map(float, np.mean(rows, axis=0)))


def _least(seeds: Iterable[int]) -> str:
    """Say what the size of the least cluster does on clouds with clutter."""
    scenes = [sotoodeh_clusters.simulate(seed, cluttered=True) for seed in seeds]
    rows = []
    for least in LEAST:
        how = replace(PAPER, min_cluster=least)
        counts = [
            confusion(one.outlier, hierarchical.detect(one.xyz, how).phase > 0) for one in scenes
        ]
        means = (np.mean([(one.lost, one.missed, one.found) for one in counts], axis=0)).tolist()
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
                    percent(counts.prevalence.ratio),
                    percent(counts.recall.ratio),
                    percent(counts.false_rejections.ratio),
                )
            )
    draw(views, folder / 'sotoodeh2007_figure_4.png', ('x, m', 'z, m'))
    return table(('', 'points', 'outliers', 'found', 'good points lost'), rows)
