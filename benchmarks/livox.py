# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The default on simulated scanners without rings, as those of Livox, beside DROR, SOR and LOF.

    scripts/environment python benchmarks/livox.py [--write] [--seeds 831 832 833 834 835 836]

Each scanner scans one street of each seed, as it is, and with the weather that trees are trained
on in it. The default judges with `boosted_trees.sensor: free`. Peers have the best threshold of
every single cloud, which nobody knows in the field; clean clouds are judged at the best one for all
weather. ``--write`` puts the table into the page of the sensors.
"""

# ruff: noqa: INP001, T201  a script, no package

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import NOTHING, table, write
from lidar_outlier_lab.results.peers import distances, dror, lof
from lidar_outlier_lab.simulation.world.prisms import L2, MID_40, MID_360, FreeScanner
from lidar_outlier_lab.training.free_sweeps import scanner_sweeps
from lidar_outlier_lab.training.held_out import CLEAN, MIN_OUTLIERS, STREET, HeldOut, judge_at_all
from lidar_outlier_lab.training.train import Sweep

PAGE = Path(__file__).resolve().parents[1] / 'doc' / 'results' / 'livox.md'
SECTION = 'livox'
COMMAND = 'benchmarks/livox.py --write'
SEEDS = (831, 832, 833, 834, 835, 836)
SCANNERS: dict[str, FreeScanner] = {'Mid-40': MID_40, 'L2': L2, 'like a Mid-360': MID_360}
WEATHER = ('light_snow', 'heavy_snow', 'rain', 'fog', 'spray', 'dust')
KINDS = {CLEAN: 'dry air', STREET: 'mixed points, ghosts, birds'}
MIN_RADIUS_M = 0.04  # metres: the least radius of DROR (Charron et al. 2018)
THRESHOLDS = np.geomspace(1e-4, 100.0, 241)  # of distances ÷ range, and of metres
OTHERS: dict[str, Callable[[Points], Floats]] = {
    'DROR': lambda points: dror(distances(points.xyz, 3)[:, 2], points.range, MIN_RADIUS_M),
    'SOR': lambda points: distances(points.xyz, 20).mean(axis=1),
    'LOF': lambda points: lof(points.xyz, 20),
}
FREE, DARK = '`free`', '`free`, no intensities'
HEAD = ('scanner, weather', 'clouds', FREE, DARK, *OTHERS)


@dataclass
class Judged:
    """What everybody says of the clouds of one scanner in one weather."""

    ours: dict[str, list[Confusion]] = field(default_factory=lambda: defaultdict(list))
    peers: dict[str, list[HeldOut]] = field(default_factory=lambda: defaultdict(list))

    @property
    def clouds(self) -> int:
        """Number of clouds."""
        return len(self.ours[FREE])


def sweeps(name: str, seed: int) -> Iterator[Sweep]:
    """Simulate all clouds of a scanner in the street of a seed."""
    return scanner_sweeps(name, SCANNERS[name], seed, WEATHER)


def by_default(points: Points, outlier: np.ndarray) -> Confusion:
    """Judge a cloud as a node does."""
    chain = Chain(FilterParameters().changed({'boosted_trees.sensor': 'free'}))
    return confusion(outlier, chain.judge(points).outlier)


def judge_sweep(judged: Judged, sweep: Sweep) -> None:
    """Let the default and its peers judge a cloud."""
    points, outlier = sweep.points, sweep.outlier
    judged.ours[FREE].append(by_default(points, outlier))
    judged.ours[DARK].append(by_default(replace(points, intensity=None), outlier))
    for peer, statistic in OTHERS.items():
        found = judge_at_all(sweep.sensor, sweep.kind, outlier, statistic(points), THRESHOLDS)
        judged.peers[peer].append(found)


def cells(kind: str, judged: Judged, best: dict[str, int]) -> Iterator[str]:
    """Write F1, and good points lost in brackets, of everybody; of dry air what is lost."""
    pairs = [
        [(one.f1, one.false_rejections.ratio) for one in some] for some in judged.ours.values()
    ]
    for peer, rows in judged.peers.items():
        tops = [best[peer] if kind == CLEAN else one.f1.argmax() for one in rows]
        pairs.append([(one.f1[top], one.lost[top]) for one, top in zip(rows, tops, strict=True)])
    for f1, lost in (np.mean(some, axis=0) for some in pairs):
        yield f'{100 * lost:.2f} %' if kind == CLEAN else f'{f1:.2f} ({100 * lost:.2f} %)'


def rows_of(name: str, seeds: Sequence[int]) -> Iterator[list[str]]:
    """Judge all clouds of a scanner, and lay out a row for each weather."""
    judged = {kind: Judged() for kind in (CLEAN, STREET, *WEATHER)}
    for seed in seeds:
        for sweep in sweeps(name, seed):
            if sweep.kind in {CLEAN, STREET} or sweep.outlier.sum() >= MIN_OUTLIERS:
                judge_sweep(judged[sweep.kind], sweep)
        print(name, seed, flush=True)
    mean = {
        peer: np.mean([one.f1 for kind in WEATHER for one in judged[kind].peers[peer]], axis=0)
        for peer in OTHERS
    }
    best = {peer: int(np.argmax(f1)) for peer, f1 in mean.items()}
    for kind, one in judged.items():
        words = f'{name}, {KINDS.get(kind, kind.replace("_", " "))}'
        nothing = [NOTHING] * (len(HEAD) - 2)
        found = list(cells(kind, one, best)) if one.clouds else nothing
        yield [words, str(one.clouds), *found]


def main() -> None:
    """Judge everything, and print or write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--write', action='store_true', help='put the table into the page')
    parser.add_argument('--seeds', nargs='+', type=int, default=list(SEEDS), metavar='N')
    options = parser.parse_args()
    text = table(HEAD, [line for name in SCANNERS for line in rows_of(name, options.seeds)])
    print(text)
    if options.write:
        write(PAGE, SECTION, text, command=COMMAND)


if __name__ == '__main__':
    main()
