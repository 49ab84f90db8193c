# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Figures 6 to 8 of Pirotti, Ravanelli, Fissore and Masiero (2018): a cloud from images."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.evaluation import plots
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.results.markdown import image, number, paragraphs, table
from lidar_outlier_lab.results.neighbour_curves import CLOSE, STATISTICS
from lidar_outlier_lab.results.papers import pirotti_buses
from lidar_outlier_lab.results.papers.counts import NONE_OF_ITS_PRESETS
from lidar_outlier_lab.results.papers.published import PIROTTI_CLUSTERED, PIROTTI_LIMITS
from lidar_outlier_lab.results.papers.roc import NEIGHBOURS, Found, explore
from lidar_outlier_lab.simulation.papers import aerial

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_lab.results.contest import Progress

LAWS: Mapping[str, aerial.Law] = {
    'uniform': aerial.uniform,
    'log-uniform': aerial.log_uniform,
}


def section(presets: Sequence[str], seed: int, folder: Path, progress: Progress) -> str:
    """Judge clouds from images under several laws, and tracks of buses; write it up and draw it."""
    parts = []
    if 'pirotti-sfm' in presets:
        parts.append(_images(seed, folder, progress))
    if 'pirotti-fcd' in presets:
        progress(1, 2, 'tracks of buses')
        parts.append(pirotti_buses.section(seed, folder))
    return paragraphs(*parts) or NONE_OF_ITS_PRESETS


def _images(seed: int, folder: Path, progress: Progress) -> str:
    """Judge the cloud from images, its outliers moved off by one law and by another."""
    found = {}
    for index, (law, draws) in enumerate(LAWS.items()):
        progress(index, 2 * len(LAWS), f'a cloud from images, {law} distances')
        (cloud,) = aerial.photogrammetry(seed, None, lambda _: None, draws)
        xyz = np.stack([cloud.points[axis] for axis in 'xyz'], axis=1).astype(np.float64)
        found[law] = explore(xyz, cloud.points['label'], Cause.CLUSTER)
        plots.draw_lines(
            found[law].auc,
            NEIGHBOURS,
            folder / f'pirotti2018_auc_{_stem(law)}',
            x_label='k, neighbours',
            y_label='area under the ROC curve',
        )
    one = found['log-uniform']
    for name in ('SOR2', 'LOF2'):
        chosen = {f'{name}, k = {k}': roc for k, roc in one.curves[name].items()}
        plots.draw_roc(chosen, folder / f'pirotti2018_roc_{name.lower()}')
    for name, unit in (('SOR', 'median of SOR, m'), ('LOF', 'median of LOF')):
        plots.draw_lines(
            {f'{name}, {law} distances': got.median[name] for law, got in found.items()},
            NEIGHBOURS,
            folder / f'pirotti2018_median_{name.lower()}',
            x_label='k, neighbours',
            y_label=unit,
        )
    return paragraphs(
        f'Seed {seed}. A million points from images, and 2596 outliers, half single, half in '
        'clusters of 2 to 30, 1 to 200 m off. The paper calls the distances random. Uniform: every '
        'metre is as probable; log-uniform: every magnitude is.',
        '### Figure 7: area under the ROC curve',
        *(
            paragraphs(
                f'Distances {law}:',
                _areas(got),
                image(f'pirotti2018_auc_{_stem(law)}.png', f'AUC against k, {law} distances'),
            )
            for law, got in found.items()
        ),
        '### Thresholds at the best point, and what they find',
        _limits(found),
        '### Figure 8: medians against k',
        image('pirotti2018_median_sor.png', 'Median of SOR against k'),
        image('pirotti2018_median_lof.png', 'Median of LOF against k'),
        table(
            ('median', *(f'k = {k}' for k in NEIGHBOURS)),
            [
                (f'{name}, {law}', *(number(v, 4) for v in got.median[name]))
                for law, got in found.items()
                for name in ('SOR', 'LOF')
            ],
        ),
        '### Figure 6: ROC curves at several k, log-uniform distances',
        *(
            image(f'pirotti2018_roc_{n}.png', f'ROC curves of {n.upper()}')
            for n in ('sor2', 'lof2')
        ),
    )


def _stem(law: str) -> str:
    return law.replace('-', '_')


def _areas(found: Found) -> str:
    return table(
        ('AUC', *(f'k = {k}' for k in NEIGHBOURS), 'best k'),
        [
            (name, *(number(v, 3) for v in values), str(NEIGHBOURS[found.best(name)]))
            for name, values in found.auc.items()
        ],
    )


def _limits(found: Mapping[str, Found]) -> str:
    """Say where the best thresholds are; the paper: SOR2 0.25 m with 60, LOF 1.1 with 10."""
    head = (
        'distances',
        'statistic',
        'best k',
        'threshold there',
        'threshold, k = 10',
        'threshold, k = 60',
        f'clustered found at {percent(CLOSE)} lost, k = 60',
        f'single found at {percent(CLOSE)} lost, k = 60',
    )
    rows = []
    ten, sixty = NEIGHBOURS.index(10), NEIGHBOURS.index(60)
    for law, got in found.items():
        for name in STATISTICS:
            best, limit = got.best(name), got.limit[name]
            rows.append(
                (
                    law,
                    name,
                    str(NEIGHBOURS[best]),
                    *(number(limit[index]) for index in (best, ten, sixty)),
                    percent(got.clustered[name][sixty]),
                    percent(got.single[name][sixty]),
                )
            )
    return paragraphs(
        table(head, rows),
        f'The paper: SOR2 {PIROTTI_LIMITS["SOR2"]} m with k = 60, LOF {PIROTTI_LIMITS["LOF"]} with '
        f'k = 10; of the clustered outliers LOF2 finds {percent(PIROTTI_CLUSTERED["LOF2"])}, SOR2 '
        f'{percent(PIROTTI_CLUSTERED["SOR2"])}, at thresholds of its own.',
    )
