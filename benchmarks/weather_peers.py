# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Peers at their best thresholds on the weather that `lidar-outlier-filter train` judges by.

    scripts/environment python benchmarks/weather_peers.py [--data ../shared/data] [--seed 1]

Three peers score each point by its neighbours in the sweep; a fourth is the weighted sum of
`boosted_trees`, whose features come from a search tree and not from the scan pattern. Two
thresholds of each are tried: the best for every single sweep, which nobody knows in the
field, and the best one for all sweeps.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.boosted_trees.weighted_sum import detector
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.peers import distances, dror
from lidar_outlier_lab.training.held_out import CLEAN, ENOUGH
from lidar_outlier_lab.training.scenes import (
    has_pattern,
    known_recordings,
    read_sweeps,
    recorded_sweeps,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.annotations import Floats
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_lab.training.train import Sweep


LEAST = 0.04  # metres: the least radius of DROR (Charron et al. 2018)
THRESHOLDS = np.geomspace(1e-4, 100.0, 241)  # of distances ÷ range, and of metres


class Row(NamedTuple):
    """What a peer gives at each threshold on one sweep: F1, and share of the good points lost."""

    sensor: str
    kind: str
    f1: Floats
    lost: Floats


def weighted_sum(points: Points) -> Floats:
    """Return the score of the default where there is no scan pattern."""
    score = detector.detect(
        Neighbourhood(points.xyz, detector.neighbours()), points, FilterParameters()
    )
    return np.nan_to_num(score)


PEERS: dict[str, Callable[[Points], Floats]] = {
    'DROR': lambda points: dror(distances(points.xyz, 3)[:, 2], points.range, LEAST),
    'range-scaled': lambda points: distances(points.xyz, 4).mean(axis=1) / points.range,
    'SOR(20)': lambda points: distances(points.xyz, 20).mean(axis=1),
    'weighted': weighted_sum,
}


def row(sweep: Sweep, score: Floats) -> Row:
    """Count what each threshold rejects."""
    bad, good = np.sort(score[sweep.outlier]), np.sort(score[~sweep.outlier])
    found = len(bad) - np.searchsorted(bad, THRESHOLDS, 'right')
    lost = len(good) - np.searchsorted(good, THRESHOLDS, 'right')
    f1 = 2.0 * found / np.maximum(found + lost + len(bad), 1)
    return Row(sweep.sensor, sweep.kind, f1, lost / max(len(good), 1))


def mean(rows: list[Row], values: list[Floats]) -> Floats:
    """Return the mean over sensors of the mean over sweeps."""
    sensors = dict.fromkeys(one.sensor for one in rows)
    parts = [
        np.mean([v for one, v in zip(rows, values, strict=True) if one.sensor == sensor], axis=0)
        for sensor in sensors
    ]
    found: Floats = np.mean(parts, axis=0)
    return found


def show(peer: str, rows: list[Row]) -> None:
    """Print a peer's rows of the table."""
    weather = [one for one in rows if one.kind != CLEAN]
    kinds = list(dict.fromkeys(one.kind for one in weather))
    f1 = {
        kind: mean(some, [one.f1 for one in some])
        for kind in kinds
        if (some := [one for one in weather if one.kind == kind])
    }
    at = int(np.argmax(np.mean(list(f1.values()), axis=0)))
    clean = [one for one in rows if one.kind == CLEAN]
    print(f'{peer}: one threshold {THRESHOLDS[at]:.4f}', end=', ')
    print(f'clean lost {mean(clean, [one.lost for one in clean])[at]:.3%}')
    for kind in kinds:
        some = [one for one in weather if one.kind == kind]
        best = [np.array([one.f1.max(), one.lost[one.f1.argmax()]]) for one in some]
        own, lost = mean(some, best)
        all_lost = mean(some, [one.lost for one in some])[at]
        print(f'  {kind:12} own: {own:.3f} lost {lost:.2%}', end='  ')
        print(f'one for all: {f1[kind][at]:.3f} lost {all_lost:.2%}', flush=True)


def main() -> None:
    """Judge all sweeps and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR')
    parser.add_argument('--seed', type=int, default=1, metavar='N')
    parser.add_argument('--peers', nargs='+', choices=PEERS, default=tuple(PEERS), metavar='P')
    options = parser.parse_args()
    rows: dict[str, list[Row]] = {peer: [] for peer in options.peers}
    for recording in known_recordings(options.data / 'bags'):
        clouds = read_sweeps(recording)
        if not all(map(has_pattern, clouds)):
            continue
        for sweep in recorded_sweeps(recording.sensor, clouds, options.seed):
            if sweep.kind == CLEAN or sweep.outlier.sum() >= ENOUGH:
                for peer, found in rows.items():
                    found.append(row(sweep, PEERS[peer](sweep.points)))
    for peer, judged in rows.items():
        show(peer, judged)


if __name__ == '__main__':
    main()
