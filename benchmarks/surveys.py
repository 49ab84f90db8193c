# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Detectors, chains and peers on clouds without scan lines, with their defaults.

    scripts/environment python benchmarks/surveys.py [--write] [--data ../shared/data] [--only PAGE]

Three tables: chains on three real clouds and a simulated town (``doc/surveys.md``); the default and
SOR on simulated surveys of five seeds and on real clouds (the page of the default); and filters of
PDAL, Open3D, lidR and CloudCompare, reimplemented from their definitions, beside ours
(``doc/results/surveys.md``).
"""
# ruff: noqa: INP001, T201  a script, no package

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from scipy.spatial import cKDTree

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_lab.results.markdown import paragraphs, table, write
from lidar_outlier_lab.results.peers import distances, sor
from lidar_outlier_lab.results.real_clouds import labelled
from lidar_outlier_lab.results.samples import Sample, simulated

Cloud = tuple[str, Floats, Bools]  # name, positions, which points are outliers
Figures = dict[str, dict[str, list[Confusion]]]

DOC = Path(__file__).resolve().parents[1] / 'doc'
COMMAND = 'benchmarks/surveys.py --write'
AXES = ('x', 'y', 'z')
LOW = 285.0  # metres: what is lower in samp41 is below all ground
PRESETS = ('kang-urban', 'kang-mountain', 'pirotti-sfm', 'pirotti-fcd', 'sotoodeh-hod')
SEEDS, PEER_SEEDS = range(601, 606), (602, 603)
ACTUAL = 'actual_scan_20240820_cloud.pcd'
ARTEFACT = 65  # class of IGN's
DEFAULT: dict[str, Any] = {'boosted_trees.sensor': 'survey'}
CHAINS: dict[str, dict[str, Any]] = {
    'the default': DEFAULT,
    '`sor`': {'chain': ('sor',)},
    '`hierarchical`': {'chain': ('hierarchical',)},
    '`elevation`': {'chain': ('elevation',)},
    '`elevation`, `against: ground`': {'chain': ('elevation',), 'elevation.against': 'ground'},
    'the default and the row above': {
        'chain': ('boosted_trees', 'elevation'),
        'boosted_trees.sensor': 'survey',
        'elevation.against': 'ground',
    },
}
BOTH = ('default', 'sor')
OURS = ('lof', 'sor', 'hierarchical', 'elevation')
SIGMAS = {  # neighbours and standard deviations of statistical filters
    'PDAL, statistical': (8, 2.0),
    'Open3D, statistical': (19, 2.0),  # 20 with the point itself
    'lidR, sor': (10, 3.0),
    'CloudCompare, SOR': (6, 1.0),
}
MIN_K, RADIUS_M = 2, 1.0  # of PDAL's radius filter
CELL_M, DROP_M = 10.0, 1.0  # of PDAL's filters.elm
FEW_IVF, SIDE_IVF_M = 6, 5.0  # of lidR
PEERS = ('default', *OURS, *SIGMAS, 'PDAL, radius', 'PDAL, elm', 'lidR, ivf')


def read(path: Path) -> Floats:
    """Read all points (N, 3) of a file, metres."""
    file = open_cloud(path)
    units = [file.metres.get(axis, 1.0) for axis in AXES]
    parts = [np.stack(columns, axis=1).astype(np.float64) for columns in file.read(AXES)]
    return np.concatenate(parts) * units


def positions(sample: Sample) -> Floats:
    """Return all points (N, 3) of a sample, metres."""
    return np.concatenate([cloud.xyz for cloud in sample.data.clouds])


def made(presets: Sequence[str], seeds: Sequence[int]) -> Iterator[Cloud]:
    """Simulate clouds."""
    for preset in presets:
        for seed in seeds:
            for sample in simulated(preset, seed):
                yield sample.name, positions(sample), sample.data.bad


def of_chains(data: Path) -> str:
    """Compare chains on clouds whose good points are known."""
    real = data / 'clouds'
    xyz = read(real / 'samp41-utm.pcd')
    ground = {tuple(row) for row in read(real / 'samp41-utm-ground.pcd').round(3).tolist()}
    is_ground = np.array([tuple(row) in ground for row in xyz.round(3).tolist()])
    is_low = xyz[:, 2] < LOW
    clouds = [('samp41', xyz, is_low, is_ground & ~is_low)]
    for name in ('plane.laz', 'autzen_trim.laz'):
        xyz = read(real / name)
        clouds.append((name, xyz, np.zeros(len(xyz), np.bool_), np.ones(len(xyz), np.bool_)))
    clouds += [(name, xyz, bad, ~bad) for name, xyz, bad in made(PRESETS[:1], SEEDS[:1])]
    rows = []
    for chain, values in CHAINS.items():
        cells = []
        for _, xyz, bad, good in clouds:
            rejected = detect_outliers(xyz, parameters=values).outlier
            taken = f'{100 * np.count_nonzero(rejected & good) / np.count_nonzero(good):.2g} %'
            found = f'{np.count_nonzero(rejected & bad)} of {np.count_nonzero(bad)} ({taken})'
            cells.append(found if bad.any() else taken)
        rows.append([chain, *cells])
    return table(['chain', *(f'`{one[0]}`' for one in clouds)], rows)


def compare(clouds: Iterable[Cloud], peers: Sequence[str]) -> Figures:
    """Count what filters find and lose, by cloud and filter: a count for each seed."""
    figures: Figures = {}
    for name, xyz, bad in clouds:
        for peer in peers:
            counts = confusion(bad, by_peer(peer, xyz))
            figures.setdefault(name, {}).setdefault(peer, []).append(counts)
        print(name, flush=True)
    return figures


def of_default(data: Path) -> str:
    """Compare the default with SOR on more clouds."""
    figures = compare((*made(PRESETS, SEEDS), *real_clouds(data)), BOTH)
    head = [f'{what}, {name}' for what in ('F1', 'found', 'lost') for name in ('default', '`sor`')]
    rows = [
        [f'`{name}`', *(say(one[peer]) for say in (f1, recall, lost) for peer in BOTH)]
        for name, one in figures.items()
    ]
    return table(['cloud', *head], rows)


def real_clouds(data: Path) -> Iterator[Cloud]:
    """Read real clouds; artefacts are known by their class, or not at all."""
    real = data / 'clouds'
    for path in sorted([*real.glob('*.laz'), real / 'source.ply', real / ACTUAL]):
        xyz = read(path)
        bad = np.zeros(len(xyz), np.bool_)
        if path.suffix == '.laz':
            bad = np.array(laspy.read(path).classification) == ARTEFACT
        there = np.isfinite(xyz).all(axis=1)
        yield path.name.partition('.')[0], xyz[there], bad[there]


def f1(some: Sequence[Confusion]) -> str:
    """Write the mean over seeds, the minimum and the maximum."""
    if not some[0].outliers:
        return ''
    values = np.nan_to_num([one.f1 for one in some])
    mean = f'{values.mean():.2f}'
    return mean if len(some) == 1 else f'{mean} ({values.min():.2f} to {values.max():.2f})'


def recall(some: Sequence[Confusion]) -> str:
    """Write how many outliers are found, of all seeds."""
    outliers = sum(one.outliers for one in some)
    return f'{sum(one.found for one in some)} of {outliers}' if outliers else ''


def lost(some: Sequence[Confusion]) -> str:
    """Write the share of the good points that is lost, of all seeds."""
    lost, good = sum(one.lost for one in some), sum(one.good for one in some)
    return f'{100 * lost / good:.2g} %' if lost else 'none'


def of_peers(data: Path) -> str:
    """Compare ours with the filters of other programs."""
    found = ((path.name, labelled(path)) for path in sorted((data / 'clouds').glob('*.laz')))
    known = ((name, positions(one), one.data.bad) for name, one in found if one is not None)
    figures = compare((*made(PRESETS, PEER_SEEDS), *known), PEERS)
    rows = [[f'`{name}`', *map(both_shares, one.values())] for name, one in figures.items()]
    return paragraphs(
        f'Simulated clouds are of the seeds {", ".join(map(str, PEER_SEEDS))}. Percent of the '
        'outliers that are found / of the good points that are lost:',
        table(['cloud', *PEERS], rows),
    )


def both_shares(some: Sequence[Confusion]) -> str:
    """Write what is found and lost in percent, means over seeds, to two significant digits."""
    shares = [(one.recall.ratio, one.false_rejections.ratio) for one in some]
    return ' / '.join(
        np.format_float_positional(100 * share, 2, unique=False, fractional=False, trim='-')
        for share in np.mean(shares, axis=0).tolist()
    )


def by_peer(peer: str, xyz: Floats) -> Bools:
    """Reject as a filter does with its default settings."""
    if peer in SIGMAS:
        neighbours, sigmas = SIGMAS[peer]
        return sor(xyz, neighbours + 1, sigmas)
    if peer == 'PDAL, radius':
        return distances(xyz, MIN_K)[:, -1] > RADIUS_M
    if peer == 'PDAL, elm':
        return minima(xyz, CELL_M, DROP_M)
    if peer == 'lidR, ivf':
        return isolated(xyz, SIDE_IVF_M, FEW_IVF)
    values = DEFAULT if peer == 'default' else {'chain': (peer,)}
    return detect_outliers(xyz, parameters=values).outlier


def minima(xyz: Floats, cell: float, drop: float) -> Bools:
    """In each cell, the lowest points up to the first that is less than ``drop`` below the next."""
    number = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / cell).astype(np.int64)
    order = np.lexsort([xyz[:, 2], number[:, 1], number[:, 0]])
    own = number[order]
    begins = np.append(True, (own[1:] != own[:-1]).any(axis=1))
    rises = np.append(np.diff(xyz[order, 2]) >= drop, False)
    rises[np.append(begins[1:], True)] = False  # the last of its cell
    ends = np.flatnonzero(~rises)  # of each run of rises
    first = np.flatnonzero(begins)[np.cumsum(begins) - 1]
    rejected = np.zeros(len(xyz), np.bool_)
    rejected[order] = np.arange(len(xyz)) < ends[np.searchsorted(ends, first)]
    return rejected


def isolated(xyz: Floats, side: float, few: int) -> Bools:
    """Reject where 27 voxels hold at most ``few`` points."""
    voxel = np.floor((xyz - xyz.min(axis=0)) / side)
    taken, inverse = np.unique(voxel, axis=0, return_inverse=True)
    held = cKDTree(voxel).query_ball_point(taken, 1.0, p=np.inf, return_length=True)
    return held[inverse.ravel()] <= few


PAGES = {
    'chains': (DOC / 'surveys.md', 'surveys', of_chains),
    'default': (DOC / 'detectors' / 'boosted_trees.md', 'surveys', of_default),
    'peers': (DOC / 'results' / 'surveys.md', 'survey-peers', of_peers),
}


def main() -> None:
    """Print the tables, or write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR')
    parser.add_argument('--only', choices=PAGES, nargs='+', default=tuple(PAGES), metavar='PAGE')
    parser.add_argument('--write', action='store_true', help='into the pages')
    options = parser.parse_args()
    for name in options.only:
        page, section, make = PAGES[name]
        text = make(options.data)
        if options.write:
            write(page, section, text, command=COMMAND)
        else:
            print(text)


if __name__ == '__main__':
    main()
