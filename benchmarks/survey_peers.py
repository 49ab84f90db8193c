# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Peers at their best thresholds and as they come, on clouds without scan lines, and the default.

    scripts/environment python benchmarks/survey_peers.py [--seeds 602 603] [--write]
    scripts/environment python benchmarks/survey_peers.py --shipped [--write]

The peers are the statistical and the radius filter of PDAL (filters.outlier) and of Open3D, the
extended local minimum of PDAL (filters.elm), and the isolated voxels of LAStools (lasnoise) and
lidR (ivf), written anew by their definitions. Each gets the best threshold of every single cloud,
which nobody knows in the field. With --shipped each has the defaults that it comes with instead;
lidR's and CloudCompare's statistical filters are beside them. Of our detectors the best one, and
with --shipped each, is beside them, with its defaults. Printed are F1, its mean over the seeds, the
least and the most, and the share of the good points that is lost; with --shipped the shares of the
outliers that are found and of the good points that are lost.
With --write they go into the page on the default.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core.neighbours.places import typical_scale
from lidar_outlier_lab.results.markdown import paragraphs, table, write
from lidar_outlier_lab.results.peers import distances
from lidar_outlier_lab.results.real_clouds import labelled
from lidar_outlier_lab.results.samples import simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_filter.annotations import Bools, Floats
    from lidar_outlier_lab.results.samples import Sample


PAGE = Path(__file__).resolve().parents[1] / 'doc' / 'development' / 'default.md'
OF_BEST = 'F1, its mean, the least and the most, and the share of the good points that is lost:'
OF_SHIPPED = 'Percent of the outliers that are found / of the good points that are lost:'
MEAN_K, MIN_K = 8, 2  # the defaults of PDAL
NB_NEIGHBORS, NB_POINTS = 20, 16  # those of the tutorial of Open3D
VOXELS = 2.0 ** np.arange(-1.0, 8.0)  # sides, typical distances to the eighth neighbour
FEW = 5  # points in a voxel and the 26 around it, the default of lasnoise
FEW_IVF, SIDE_IVF = 6, 5.0  # the defaults of lidR
CELL, DROP = 10.0, 1.0  # metres, the defaults of PDAL's filters.elm
CELLS, DROPS = (2.0, 5.0, 10.0, 20.0, 50.0), (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # metres
SIGMAS = {  # neighbours and standard deviations of statistical filters as they come
    'PDAL, statistical': (8, 2.0),
    'Open3D, statistical': (19, 2.0),  # 20 with the point itself
    'lidR, sor': (10, 3.0),
    'CloudCompare, SOR': (6, 1.0),
}
OURS = ('lof', 'sor', 'hierarchical', 'elevation')
PRESETS = ('kang-urban', 'kang-mountain', 'pirotti-sfm', 'pirotti-fcd', 'sotoodeh-hod')


class Best(NamedTuple):
    """F1, the share of the good points that is lost, and that of the outliers that is found."""

    f1: float
    lost: float
    found: float


def judged(rejected: Bools, bad: Bools) -> Best:
    """Count what is rejected."""
    both = int((rejected & bad).sum())
    f1 = 2.0 * both / max(int(rejected.sum()) + int(bad.sum()), 1)
    return Best(f1, float(rejected[~bad].mean()), both / max(int(bad.sum()), 1))


def best(score: Floats, bad: Bools) -> Best:
    """Return what the threshold of a score gives that has the highest F1."""
    order = np.argsort(-score, kind='stable')
    found = np.cumsum(bad[order])
    f1 = 2.0 * found / (np.arange(1, len(bad) + 1) + bad.sum())
    last = np.append(np.diff(score[order]) != 0, True)  # equal scores go together
    at = int(np.argmax(np.where(last, f1, 0.0)))
    lost = (at + 1 - found[at]) / max(int((~bad).sum()), 1)
    return Best(float(f1[at]), float(lost), float(found[at] / max(int(bad.sum()), 1)))


def statistical(xyz: Floats, bad: Bools) -> Best:
    """Judge by the mean distance to eight neighbours."""
    return best(distances(xyz, MEAN_K).mean(axis=1), bad)


def radius(xyz: Floats, bad: Bools) -> Best:
    """Judge by the distance to the second neighbour: the radius that does not hold two."""
    return best(distances(xyz, MIN_K)[:, -1], bad)


def of_twenty(xyz: Floats, bad: Bools) -> Best:
    """Judge by the mean distance to twenty neighbours, of which the point itself is one."""
    return best(distances(xyz, NB_NEIGHBORS - 1).sum(axis=1), bad)


def of_sixteen(xyz: Floats, bad: Bools) -> Best:
    """Judge by the distance to the sixteenth neighbour: the radius that does not hold as many."""
    return best(distances(xyz, NB_POINTS)[:, -1], bad)


def voxels(xyz: Floats, bad: Bools) -> Best:
    """Reject where 27 voxels hold few points, at the best of several sides."""
    typical = typical_scale(xyz, np.arange(len(xyz)))
    return max(judged(_isolated(xyz, side * typical), bad) for side in VOXELS)


def low(xyz: Floats, bad: Bools) -> Best:
    """Reject the extended local minima of cells, at the best of several sides and drops."""
    found = [_minima(xyz, cell, drop) for cell in CELLS for drop in DROPS]
    return max(judged(rejected, bad) for rejected in found)


def _minima(xyz: Floats, cell: float, drop: float) -> Bools:
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


def shipped(way: str, xyz: Floats) -> Bools:
    """Reject as a filter does with the defaults that it comes with, or that its page shows."""
    if way in SIGMAS:
        neighbours, sigmas = SIGMAS[way]
        mean = distances(xyz, neighbours).mean(axis=1)
        return mean > mean.mean() + sigmas * mean.std(ddof=1)
    if way == 'PDAL, radius':
        return distances(xyz, MIN_K)[:, -1] > 1.0
    if way == 'PDAL, elm':
        return _minima(xyz, CELL, DROP)
    if way == 'lidR, ivf':
        return _isolated(xyz, SIDE_IVF, FEW_IVF)
    chain = {} if way == 'default' else {'chain': (way,)}
    return detect_outliers(xyz, parameters={'boosted_trees.sensor': 'survey', **chain}).outlier


def _isolated(xyz: Floats, side: float, few: int = FEW) -> Bools:
    voxel = np.floor((xyz - xyz.min(axis=0)) / side).astype(np.int64) + 1
    count = voxel.max(axis=0) + 2
    step = np.array([count[1] * count[2], count[2], 1])
    number, inverse, held = np.unique(voxel @ step, return_inverse=True, return_counts=True)
    total = np.zeros(len(number), np.int64)
    for offset in np.ndindex(3, 3, 3):
        wanted = number + (np.array(offset) - 1) @ step
        at = np.minimum(np.searchsorted(number, wanted), len(number) - 1)
        total += np.where(number[at] == wanted, held[at], 0)
    return total[inverse] <= few


def default(xyz: Floats, bad: Bools) -> Best:
    """Judge as `clean` does."""
    asked = {'boosted_trees.sensor': 'survey'}
    return judged(detect_outliers(xyz, parameters=asked).outlier, bad)


def ours(xyz: Floats, bad: Bools) -> Best:
    """Judge by each of our detectors that needs no lines, and keep the best."""
    found = [detect_outliers(xyz, parameters={'chain': (one,)}).outlier for one in OURS]
    return max(judged(rejected, bad) for rejected in found)


WAYS = {
    'default': default,
    'best of ours': ours,
    'PDAL, statistical': statistical,
    'PDAL, radius': radius,
    'Open3D, statistical': of_twenty,
    'Open3D, radius': of_sixteen,
    'PDAL, elm': low,
    'voxels': voxels,
}
SHIPPED = ('default', *OURS, *SIGMAS, 'PDAL, radius', 'PDAL, elm', 'lidR, ivf')
WITH_US = {'default', 'best of ours', *OURS}


def clouds(data: Path, presets: list[str], seeds: list[int]) -> Iterator[tuple[str, Floats, Bools]]:
    """Simulate clouds, and read those with classes."""
    samples = (one for preset in presets for seed in seeds for one in simulated(preset, seed))
    for sample in samples:
        yield sample.name, positions(sample), sample.data.bad
    for path in sorted((data / 'clouds').glob('*.laz')):
        found = labelled(path)
        if found is not None:
            yield path.name, positions(found), found.data.bad


def positions(sample: Sample) -> Floats:
    """Return all points (N, 3) of a sample, metres."""
    return np.concatenate([cloud.xyz for cloud in sample.data.clouds])


def of_shipped(found: list[Best]) -> str:
    """Write what is found and lost, means of all seeds."""
    shares = [(one.found, one.lost) for one in found]
    return ' / '.join(percent(share) for share in np.mean(shares, axis=0).tolist())


def cell(found: list[Best]) -> str:
    """Write the mean F1, the least and the most where there are several, and what is lost."""
    f1, lost = [f'{one.f1:.2f}' for one in found], float(np.mean([one.lost for one in found]))
    spread = f', {min(f1)} to {max(f1)}' if len({*f1}) > 1 else ''
    mean = np.mean([one.f1 for one in found])
    return f'{mean:.2f}{spread} ({percent(lost) + " %" if lost else "none"})'


def percent(share: float) -> str:
    """Write a share in percent, to two digits that count."""
    return np.format_float_positional(100 * share, 2, unique=False, fractional=False, trim='-')


def worse(name: str, row: dict[str, list[Best]]) -> str | None:
    """Say which peers have a higher mean F1 than the default; None: no one."""
    f1 = {way: float(np.mean([one.f1 for one in found])) for way, found in row.items()}
    better = [
        f'{way} {one:.3f}' for way, one in f1.items() if way not in WITH_US and one > f1['default']
    ]
    return f'`{name}`: default {f1["default"]:.3f}; {", ".join(better)}' if better else None


def judge_all(options: argparse.Namespace) -> dict[str, dict[str, list[Best]]]:
    """Judge every cloud in every way: by name, and by way, one result for each seed."""
    rows: dict[str, dict[str, list[Best]]] = {}
    for name, xyz, bad in clouds(options.data, options.presets, options.seeds):
        row = rows.setdefault(name, {way: [] for way in (SHIPPED if options.shipped else WAYS)})
        for way, found in row.items():
            found.append(judged(shipped(way, xyz), bad) if options.shipped else WAYS[way](xyz, bad))
        print(name, {way: round(found[-1].f1, 3) for way, found in row.items()}, file=sys.stderr)
    return rows


def said(options: argparse.Namespace) -> str:
    """Say what is in the table, the table, and where a peer is better."""
    rows, text = judge_all(options), of_shipped if options.shipped else cell
    ways = SHIPPED if options.shipped else tuple(WAYS)
    seeds = f'Simulated clouds are of the seeds {", ".join(map(str, options.seeds))}.'
    lines = [[f'`{name}`', *(text(found) for found in row.values())] for name, row in rows.items()]
    better = filter(None, (worse(name, row) for name, row in rows.items()))
    return paragraphs(
        f'{seeds} {OF_SHIPPED if options.shipped else OF_BEST}',
        table(['cloud', *ways], lines),
        *(['\n'.join(f'* {sentence}' for sentence in better)] if not options.shipped else []),
    )


def main() -> None:
    """Print a row of a table for each cloud, and where a peer is better, or write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR')
    parser.add_argument('--seeds', type=int, nargs='+', default=[602, 603], metavar='N')
    parser.add_argument('--presets', nargs='*', choices=PRESETS, default=PRESETS, metavar='P')
    parser.add_argument('--shipped', action='store_true', help='peers with their defaults')
    parser.add_argument('--write', action='store_true', help=f'into {PAGE.name}')
    options = parser.parse_args()
    if options.write:
        section, asked = ('shipped', ' --shipped') if options.shipped else ('best', '')
        command = f'benchmarks/survey_peers.py{asked} --write'
        write(PAGE, f'survey-peers-{section}', said(options), command=command)
    else:
        print(said(options))


if __name__ == '__main__':
    main()
