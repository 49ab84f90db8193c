# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Chains on surveys, with their defaults: what each finds and what it takes of the rest.

    scripts/environment python benchmarks/surveys.py [--write] [--data ../shared/data]

One real cloud has low points that are known, two are thought to have no outlier, and one cloud of
a town is simulated. A second table has the default and SOR on simulated surveys of five seeds, and
on real clouds of which artefacts are known, or nothing. ``--write`` puts the first into the page on
chains, the second into that of the default.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import laspy
import numpy as np
from survey_peers import positions

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_lab.results.markdown import table, write
from lidar_outlier_lab.results.samples import simulated

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lidar_outlier_filter.annotations import Bools, Floats

DOC = Path(__file__).resolve().parents[1] / 'doc'
PAGE, DEFAULT_PAGE = DOC / 'chains.md', DOC / 'detectors' / 'boosted_trees.md'
SECTION, COMMAND = 'surveys', 'benchmarks/surveys.py --write'
AXES = ('x', 'y', 'z')
LOW = 285.0  # metres: what is lower in samp41 is below all ground
PRESET, SEED = 'kang-urban', 601
SIMULATED = ('kang-urban', 'kang-mountain', 'pirotti-sfm', 'pirotti-fcd', 'sotoodeh-hod')
SEEDS = range(601, 606)
ACTUAL = 'actual_scan_20240820_cloud.pcd'
ARTEFACT = 65  # class of IGN's
CHAINS: dict[str, dict[str, Any]] = {
    'the default': {'boosted_trees.sensor': 'survey'},
    '`sor`': {'chain': ('sor',)},
    '`hierarchical`': {'chain': ('hierarchical',)},
    '`elevation`': {'chain': ('elevation',)},
    '`elevation`, `against: ground`': {'chain': ('elevation',), 'elevation.against': 'ground'},
    'the default and that': {
        'chain': ('boosted_trees', 'elevation'),
        'boosted_trees.sensor': 'survey',
        'elevation.against': 'ground',
    },
}
BOTH = {'default': CHAINS['the default'], '`sor`': CHAINS['`sor`']}


def read(path: Path) -> Floats:
    """Read all points (N, 3) of a file, metres."""
    file = open_cloud(path)
    units = [file.metres.get(axis, 1.0) for axis in AXES]
    parts = [np.stack(columns, axis=1).astype(np.float64) for columns in file.read(AXES)]
    return np.concatenate(parts) * units


def clouds(data: Path) -> Iterator[tuple[str, Floats, Bools, Bools]]:
    """Give the name of each cloud, its points, which are outliers, and which are surely good."""
    real = data / 'clouds'
    xyz = read(real / 'samp41-utm.pcd')
    ground = {tuple(row) for row in read(real / 'samp41-utm-ground.pcd').round(3).tolist()}
    is_ground = np.array([tuple(row) in ground for row in xyz.round(3).tolist()])
    is_low = xyz[:, 2] < LOW
    yield 'samp41', xyz, is_low, is_ground & ~is_low
    for name in ('plane.laz', 'autzen_trim.laz'):
        xyz = read(real / name)
        yield name, xyz, np.zeros(len(xyz), np.bool_), np.ones(len(xyz), np.bool_)
    for sample in simulated(PRESET, SEED):
        yield sample.name, positions(sample), sample.data.bad, ~sample.data.bad


def cell(rejected: Bools, bad: Bools, good: Bools) -> str:
    """Say how many outliers are found, and what share of the good points is taken."""
    lost = f'{100 * np.count_nonzero(rejected & good) / np.count_nonzero(good):.2g} %'
    if not bad.any():
        return lost
    return f'{np.count_nonzero(rejected & bad)} of {np.count_nonzero(bad)} ({lost})'


def of_chains(data: Path) -> str:
    """Compare chains."""
    found: dict[str, list[str]] = {name: [] for name in CHAINS}
    head = ['chain']
    for cloud, xyz, bad, good in clouds(data):
        head.append(f'`{cloud}`')
        for name, values in CHAINS.items():
            rejected = detect_outliers(xyz, parameters=values).outlier
            found[name].append(cell(rejected, bad, good))
            print(cloud, name, found[name][-1], flush=True)
    return table(head, [[name, *cells] for name, cells in found.items()])


def of_default(data: Path) -> str:
    """Compare the default with SOR on more clouds."""
    head = ['cloud', *(f'{what}, {name}' for what in ('F1', 'found', 'lost') for name in BOTH)]
    figures: dict[str, dict[str, list[Counts]]] = {}
    for name, xyz, bad in many(data):
        for judge, values in BOTH.items():
            rejected = detect_outliers(xyz, parameters=values).outlier
            sums = (rejected & bad, rejected, bad, ~bad)
            counts = Counts(*(int(np.count_nonzero(one)) for one in sums))
            figures.setdefault(name, {}).setdefault(judge, []).append(counts)
        print(name, {judge: counts[-1] for judge, counts in figures[name].items()}, flush=True)
    rows = [
        [f'`{name}`', *(say([*one.values()][k]) for say in (f1, recall, lost) for k in range(2))]
        for name, one in figures.items()
    ]
    return table(head, rows)


def many(data: Path) -> Iterator[tuple[str, Floats, Bools]]:
    """Give the name of each cloud, its points, and which are outliers, seed by seed."""
    for preset in SIMULATED:
        for seed in SEEDS:
            for sample in simulated(preset, seed):
                yield sample.name, positions(sample), sample.data.bad
    real = data / 'clouds'
    for path in sorted([*real.glob('*.laz'), real / 'source.ply', real / ACTUAL]):
        xyz = read(path)
        bad = np.zeros(len(xyz), np.bool_)
        if path.suffix == '.laz':
            bad = np.array(laspy.read(path).classification) == ARTEFACT
        there = np.isfinite(xyz).all(axis=1)
        yield path.name.partition('.')[0], xyz[there], bad[there]


class Counts(NamedTuple):
    """Of one cloud: points found, rejected, bad and good."""

    found: int
    rejected: int
    bad: int
    good: int


def f1(some: Sequence[Counts]) -> str:
    """Say the mean over seeds, and the least and the most."""
    if not some[0].bad:
        return ''
    values = [2 * one.found / (one.rejected + one.bad) for one in some]
    mean = f'{np.mean(values):.2f}'
    return mean if len(some) == 1 else f'{mean} ({min(values):.2f} to {max(values):.2f})'


def recall(some: Sequence[Counts]) -> str:
    """Say how many outliers are found, of all seeds."""
    bad = sum(one.bad for one in some)
    return f'{sum(one.found for one in some)} of {bad}' if bad else ''


def lost(some: Sequence[Counts]) -> str:
    """Say the share of the good points that is lost, of all seeds."""
    share = sum(one.rejected - one.found for one in some) / sum(one.good for one in some)
    return f'{100 * share:.2g} %' if share else 'none'


def main() -> None:
    """Print the tables, or write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR')
    parser.add_argument(
        '--write', action='store_true', help=f'into {PAGE.name}, {DEFAULT_PAGE.name}'
    )
    options = parser.parse_args()
    for page, text in ((DEFAULT_PAGE, of_default(options.data)), (PAGE, of_chains(options.data))):
        if options.write:
            write(page, SECTION, text, command=COMMAND)
        else:
            print(text)


if __name__ == '__main__':
    main()
