# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Chains on surveys, with their defaults: what each finds and what it takes of the rest.

    scripts/environment python benchmarks/surveys.py [--write] [--data ../shared/data]

One real cloud has low points that are known, two are thought to have no outlier, and one cloud of
a town is simulated. ``--write`` puts the table into the page on chains.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from survey_peers import positions

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_lab.results.markdown import table, write
from lidar_outlier_lab.results.samples import simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_filter.annotations import Bools, Floats

PAGE = Path(__file__).resolve().parents[1] / 'doc' / 'chains.md'
SECTION, COMMAND = 'surveys', 'benchmarks/surveys.py --write'
AXES = ('x', 'y', 'z')
LOW = 285.0  # metres: what is lower in samp41 is below all ground
PRESET, SEED = 'kang-urban', 601
CHAINS: dict[str, dict[str, Any]] = {
    'the default': {'evidence.sensor': 'survey'},
    '`sor`': {'chain': ('sor',)},
    '`hierarchical`': {'chain': ('hierarchical',)},
    '`elevation`': {'chain': ('elevation',)},
    '`elevation`, `against: ground`': {'chain': ('elevation',), 'elevation.against': 'ground'},
    'the default and that': {
        'chain': ('evidence', 'elevation'),
        'evidence.sensor': 'survey',
        'elevation.against': 'ground',
    },
}


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


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR')
    parser.add_argument('--write', action='store_true', help=f'into {PAGE.name}')
    options = parser.parse_args()
    found: dict[str, list[str]] = {name: [] for name in CHAINS}
    head = ['chain']
    for cloud, xyz, bad, good in clouds(options.data):
        head.append(f'`{cloud}`')
        for name, values in CHAINS.items():
            rejected = detect_outliers(xyz, parameters=values).outlier
            found[name].append(cell(rejected, bad, good))
            print(cloud, name, found[name][-1], flush=True)
    text = table(head, [[name, *cells] for name, cells in found.items()])
    if options.write:
        write(PAGE, SECTION, text, command=COMMAND)
    else:
        print(text)


if __name__ == '__main__':
    main()
