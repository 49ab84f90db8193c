# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Figures 9 and 10 of Pirotti et al. (2018): tracks of buses, easy ones and ones as hard as his."""

from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Bytes, Floats
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.results.markdown import image, number, paragraphs, table
from lidar_outlier_lab.results.papers.panels import PointPanel, draw, draw_lines, view
from lidar_outlier_lab.results.papers.roc import (
    NEIGHBOURS,
    STATISTICS,
    Found,
    explore,
    statistics,
)
from lidar_outlier_lab.simulation.papers import bus_tracks

OFF = 'off the line'


def with_line(near: Neighbourhood, k: int) -> dict[str, Floats]:
    """Compute five statistics of every position, the fifth the distance from the neighbours' line.

    The line is the first principal axis of the k nearest in x and y. The paper asks for a degree of
    linearity as a descriptor; the distance from the line is what it makes of a position.
    """
    index, order = near.nearest(k).index, near.order
    positions = near.xyz[:, :2]
    around = positions[index]
    middle = around.mean(axis=1)
    apart = around - middle[:, None]
    _, axes = np.linalg.eigh(np.einsum('nki,nkj->nij', apart, apart) / k)
    off = np.empty(len(order))
    off[order] = np.abs(np.einsum('ni,ni->n', positions - middle, axes[:, :, 0]))
    return {**statistics(near, k), OFF: off}


def section(seed: int, folder: Path) -> str:
    """Judge the tracks, flat and with the speed, easy and as hard as his."""
    rows: list[tuple[str, ...]] = []
    rates: list[tuple[str, ...]] = []
    views: list[list[PointPanel]] = []
    for kind, lines in (('easy', bus_tracks.LINES), ('hard', bus_tracks.HARD)):
        for line, how in lines.items():
            track = bus_tracks.track(how, how.outliers, np.random.default_rng([seed, line]))
            for dimension in ('flat', 'speed'):
                xyz = np.stack([track[axis] for axis in 'xyz'], axis=1).astype(np.float64)
                xyz[:, 2] *= dimension == 'speed'
                found = explore(xyz, track['label'], Cause.DETOUR, measure=with_line)
                rows += [
                    (
                        f'line {line}, {dimension}, {kind}',
                        name,
                        *(number(v, 3) for v in values),
                        str(NEIGHBOURS[found.best(name)]),
                    )
                    for name, values in found.auc.items()
                ]
                rates.append((f'line {line}, {dimension}, {kind}', *_rates(found)))
                if kind == 'hard' and dimension == 'flat':
                    stem = folder / f'pirotti2018_line_{line}'
                    draw_lines(found.auc, NEIGHBOURS, stem, x_label='k, neighbours', y_label='AUC')
                    if not views:
                        views.append(_views(xyz, track['label'], found))
    draw(views, folder / 'pirotti2018_figure_10.png', ('x, m', 'y, m'), row=4.5)
    head = ('track', 'statistic', *(f'k = {k}' for k in NEIGHBOURS), 'best k')
    return paragraphs(
        '### Figure 9: buses',
        'Line 11 and line 39 in the plane and with the speed for a third dimension. The easy ones '
        'are the preset `pirotti-fcd`. In the hard ones outliers come as near as 6 m to the route, '
        'alone on line 11, in stands of 20 to 60 positions on line 39.',
        table(head, rows),
        *(
            image(f'pirotti2018_line_{line}.png', f'AUC against k, line {line}, flat, hard')
            for line in bus_tracks.HARD
        ),
        '### Table 3: outliers of the buses that are found, at the best k and threshold',
        table(('track', *STATISTICS, OFF), rates),
        'In brackets: best k, and good positions lost. The paper in words, the best of each '
        'track: SOR and SOR2 with k = 3 on line 11, LOF with k = 70 on line 39 in the plane, '
        'SOR2 with the lowest k on line 39 with the speed.',
        '### Figure 10: line 11 before and after SOR2, k = 3',
        image('pirotti2018_figure_10.png', 'Line 11 before and after'),
    )


def _rates(found: Found) -> list[str]:
    """Return the true positive rate of each statistic at its best, with its k and what is lost."""
    cells = []
    for name in found.auc:
        best = found.best(name)
        whole = found.best_of[name][best].whole
        lost = percent(whole.false_rejections.ratio)
        cells.append(f'{percent(whole.recall.ratio)} ({NEIGHBOURS[best]}, {lost})')
    return cells


def _views(xyz: Floats, code: Bytes, found: Found) -> list[PointPanel]:
    """Show a track before and after SOR2 with three neighbours, at its best threshold."""
    values = statistics(Neighbourhood(xyz, NEIGHBOURS[0]), NEIGHBOURS[0])['SOR2']
    kept = values < found.best_of['SOR2'][0].threshold
    flat, bad = xyz[:, :2], code != Cause.GOOD
    return [
        view('before', flat, bad, np.ones(len(bad), np.bool_)),
        view('after SOR2, k = 3', flat, bad, kept),
    ]
