# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables 1 to 3, figures 6 to 10 of Pirotti et al. (2018): a cloud from images, tracks of buses."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.special import poch

from lidar_outlier_filter.core.annotations import Bytes, Floats, Progress
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation import plots
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.results.markdown import image, number, paragraphs, table
from lidar_outlier_lab.results.papers import roc
from lidar_outlier_lab.results.papers.methods import NONE_OF_ITS_PRESETS
from lidar_outlier_lab.results.papers.panels import PointPanel, draw, draw_lines, view
from lidar_outlier_lab.results.papers.published import PIROTTI_CLUSTERED, PIROTTI_LIMITS
from lidar_outlier_lab.simulation.papers import aerial, bus_tracks

LAWS: Mapping[str, aerial.Law] = {
    'uniform': aerial.uniform,
    'log-uniform': aerial.log_uniform,
}
PCL, PCL2 = 'PCL-LOFFilter', 'PCL-LOFFilter, LOF2'
SHOWN = (*roc.STATISTICS, PCL, PCL2)
PAIRS = (('SOR', 'SOR2'), ('LOF', 'LOF2'), (PCL, PCL2))
OFF = 'off the line'


def with_pcl(near: Neighbourhood, k: int) -> dict[str, Floats]:
    """Compute the four statistics of the paper, and those of the code that it names."""
    factor = roc.measure_pcl(near, k)
    return {**roc.statistics(near, k), PCL: factor, PCL2: np.abs(factor - np.median(factor))}


def mean_distance(k: int, density: float) -> float:
    """Return the mean distance, metres, to the k nearest of points thrown on a plane.

    ``density`` is their number per square metre. The mean distance to the j-th nearest is
    Γ(j + 1/2) ÷ Γ(j) ÷ √(π density).
    """
    j = np.arange(1, k + 1)
    return float(np.mean(poch(j, 0.5)) / np.sqrt(np.pi * density))


def section(presets: Sequence[str], seed: int, folder: Path, progress: Progress) -> str:
    """Judge clouds from images under several laws, and tracks of buses; write it up and draw it."""
    parts = []
    if 'pirotti-sfm' in presets:
        parts.append(_images(seed, folder, progress))
    if 'pirotti-fcd' in presets:
        progress(1, 2, 'tracks of buses')
        parts.append(_buses(seed, folder))
    return paragraphs(*parts) or NONE_OF_ITS_PRESETS


def _images(seed: int, folder: Path, progress: Progress) -> str:
    """Judge the cloud from images, its outliers moved off by one law and by another."""
    found = {}
    for index, (law, draws) in enumerate(LAWS.items()):
        progress(index, 2 * len(LAWS), f'a cloud from images, {law} distances')
        (cloud,) = aerial.photogrammetry('', seed, None, lambda _: None, draws)
        xyz = np.stack([cloud.points[axis] for axis in 'xyz'], axis=1).astype(np.float64)
        found[law] = roc.explore(xyz, cloud.points['label'], Cause.CLUSTER, measure=with_pcl)
        path = folder / f'pirotti2018_auc_{_stem(law)}'
        draw_lines(found[law].auc, roc.NEIGHBOURS, path, 'area under the ROC curve')
    one = found['log-uniform']
    for name in ('SOR2', 'LOF2'):
        chosen = {f'{name}, k = {k}': curve for k, curve in one.curves[name].items()}
        plots.draw_roc(chosen, folder / f'pirotti2018_roc_{name.lower()}')
    for name, unit in (('SOR', 'median of SOR, m'), ('LOF', 'median of LOF')):
        medians = {f'{name}, {law} distances': got.median[name] for law, got in found.items()}
        draw_lines(medians, roc.NEIGHBOURS, folder / f'pirotti2018_median_{name.lower()}', unit)
    return paragraphs(
        f'Seed {seed}. A million points from images, and 2596 outliers, half single, half in '
        'clusters of 2 to 30, 1 to 200 m off. The paper calls the distances random. Uniform: every '
        'metre is as probable; log-uniform: every magnitude is.',
        '### Figure 7: area under the ROC curve',
        *(
            paragraphs(
                f'Distances {law}:',
                table(('AUC', *(f'k = {k}' for k in roc.NEIGHBOURS), 'best k'), _areas(got)),
                image(f'pirotti2018_auc_{_stem(law)}.png', f'AUC against k, {law} distances'),
            )
            for law, got in found.items()
        ),
        '### Thresholds at the best point, and what they find',
        _limits(found),
        '### Table 1: outliers that are not found, at the best k and threshold',
        _missed(found),
        '### Table 2: truth against verdict, at the best k and threshold',
        _counts(found),
        '### SOR2 against SOR, LOF2 against LOF',
        _pairs(found),
        '### Figure 8: medians against k',
        image('pirotti2018_median_sor.png', 'Median of SOR against k'),
        image('pirotti2018_median_lof.png', 'Median of LOF against k'),
        table(
            ('median', *(f'k = {k}' for k in roc.NEIGHBOURS)),
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


def _areas(found: roc.Found, *first: str) -> list[tuple[str, ...]]:
    """Give the areas of each statistic for each k, and the best k."""
    return [
        (*first, name, *(number(v, 3) for v in values), str(roc.NEIGHBOURS[found.best(name)]))
        for name, values in found.auc.items()
    ]


def _limits(found: Mapping[str, roc.Found]) -> str:
    """Say where the best thresholds are; the paper: SOR2 0.25 m with 60, LOF 1.1 with 10."""
    head = (
        'distances',
        'statistic',
        'best k',
        'threshold there',
        'threshold, k = 10',
        'threshold, k = 60',
        f'clustered found at {percent(roc.CLOSE)} lost, k = 10',
        f'clustered found at {percent(roc.CLOSE)} lost, k = 60',
        f'single found at {percent(roc.CLOSE)} lost, k = 60',
    )
    rows = []
    ten, sixty = roc.NEIGHBOURS.index(10), roc.NEIGHBOURS.index(60)
    for law, got in found.items():
        for name in SHOWN:
            best, limits = got.best(name), got.best_of[name]
            rows.append(
                (
                    law,
                    name,
                    str(roc.NEIGHBOURS[best]),
                    *(number(limits[index].threshold) for index in (best, ten, sixty)),
                    percent(got.clustered[name][ten]),
                    percent(got.clustered[name][sixty]),
                    percent(got.single[name][sixty]),
                )
            )
    return paragraphs(
        table(head, rows),
        f'The paper: SOR2 {PIROTTI_LIMITS["SOR2"]} m with k = 60, LOF {PIROTTI_LIMITS["LOF"]} with '
        f'k = 10; of the clustered outliers LOF2 finds {percent(PIROTTI_CLUSTERED["LOF2"])}, SOR2 '
        f'{percent(PIROTTI_CLUSTERED["SOR2"])}, at thresholds of its own.',
        f'Of points thrown on a plane, {aerial.DENSITY:.0f} to the square metre, the mean distance '
        f'to the 60 nearest is {mean_distance(60, aerial.DENSITY):.2f} m. On hills and trees it is '
        'more: see the median of SOR below. The text of the paper says that its threshold of '
        f'{PIROTTI_LIMITS["SOR2"]} m is this mean distance, of which it is half.',
    )


def _at_best(found: Mapping[str, roc.Found]) -> Iterator[tuple[str, str, int, roc.AtBest]]:
    """Give each law and statistic with its best number of neighbours, and what that finds."""
    for law, got in found.items():
        for name in SHOWN:
            best = got.best(name)
            yield law, name, roc.NEIGHBOURS[best], got.best_of[name][best]


def _missed(found: Mapping[str, roc.Found]) -> str:
    rows = [
        (
            *(law, name, str(k)),
            *(
                cell
                for share in (one.single, one.clustered)
                for cell in (f'{share.part:,} of {share.total:,}', percent(share.ratio))
            ),
        )
        for law, name, k, one in _at_best(found)
    ]
    head = ('distances', 'statistic', 'best k', 'single', 'of them', 'clustered', 'of them')
    return paragraphs(
        table(head, rows),
        'The text of the paper, in words: SOR, SOR2 and LOF2 find almost all single ones, LOF very '
        'few. Of the clustered ones LOF2 leaves fewest: by the abstract '
        f'{percent(1 - PIROTTI_CLUSTERED["LOF2"])}, SOR2 {percent(1 - PIROTTI_CLUSTERED["SOR2"])}.',
    )


def _counts(found: Mapping[str, roc.Found]) -> str:
    rows = []
    for law, name, _, one in _at_best(found):
        whole = one.whole
        counts = (whole.found, whole.missed, whole.lost, whole.kept)
        shares = (whole.recall.ratio, whole.false_rejections.ratio)
        rows.append((law, name, *(f'{count:,}' for count in counts), *map(percent, shares)))
    head = ('distances', 'statistic', 'TP', 'FN', 'FP', 'TN', 'TPR', 'FPR')
    return table(head, rows)


def _pairs(found: Mapping[str, roc.Found]) -> str:
    """Say what the difference from the median changes: the points far below it."""
    rows = []
    for law, got in found.items():
        for plain, other in PAIRS:
            for k in (10, 60):
                index = roc.NEIGHBOURS.index(k)
                below = got.best_of[plain][index].below
                rows.append(
                    (
                        f'{law}: {other} against {plain}, k = {k}',
                        *(number(got.auc[name][index]) for name in (plain, other)),
                        *(percent(got.clustered[name][index]) for name in (plain, other)),
                        f'{below.total:,}',
                        f'{below.part:,}',
                    )
                )
    head = (
        '',
        'AUC, value',
        'AUC, difference',
        f'clustered found at {percent(roc.CLOSE)} lost, value',
        'the same, difference',
        'points as far below the median as the best threshold is above',
        'outliers among them',
    )
    return table(head, rows)


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
    return {**roc.statistics(near, k), OFF: off}


def _buses(seed: int, folder: Path) -> str:
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
                found = roc.explore(xyz, track['label'], Cause.DETOUR, measure=with_line)
                title = f'line {line}, {dimension}, {kind}'
                rows += _areas(found, title)
                rates.append((title, *_rates(found)))
                if kind == 'hard' and dimension == 'flat':
                    stem = folder / f'pirotti2018_line_{line}'
                    draw_lines(found.auc, roc.NEIGHBOURS, stem, 'AUC')
                    if not views:
                        views.append(_views(xyz, track['label'], found))
    draw(views, folder / 'pirotti2018_figure_10.png', ('x, m', 'y, m'), row=4.5)
    head = ('track', 'statistic', *(f'k = {k}' for k in roc.NEIGHBOURS), 'best k')
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
        table(('track', *roc.STATISTICS, OFF), rates),
        'In brackets: best k, and good positions lost. The paper in words, the best of each '
        'track: SOR and SOR2 with k = 3 on line 11, LOF with k = 70 on line 39 in the plane, '
        'SOR2 with the lowest k on line 39 with the speed.',
        '### Figure 10: line 11 before and after SOR2, k = 3',
        image('pirotti2018_figure_10.png', 'Line 11 before and after'),
    )


def _rates(found: roc.Found) -> list[str]:
    """Return the true positive rate of each statistic at its best, with its k and what is lost."""
    cells = []
    for name in found.auc:
        best = found.best(name)
        whole = found.best_of[name][best].whole
        lost = percent(whole.false_rejections.ratio)
        cells.append(f'{percent(whole.recall.ratio)} ({roc.NEIGHBOURS[best]}, {lost})')
    return cells


def _views(xyz: Floats, code: Bytes, found: roc.Found) -> list[PointPanel]:
    """Show a track before and after SOR2 with three neighbours, at its best threshold."""
    values = roc.statistics(Neighbourhood(xyz, roc.NEIGHBOURS[0]), roc.NEIGHBOURS[0])['SOR2']
    kept = values < found.best_of['SOR2'][0].threshold
    flat, bad = xyz[:, :2], code != Cause.GOOD
    return [
        view('before', flat, bad, np.ones(len(bad), np.bool_)),
        view('after SOR2, k = 3', flat, bad, kept),
    ]
