# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How fast neighbours are found, beside peers on the same cloud in the same run.

Run as ``python benchmarks/neighbours.py [THREADS]``. Answers are compared first, with those of
scipy. Then every search builds its tree and lists the 20 nearest others of all points of the
simulated street, in turn with the others, and the best round counts. Of the peers those are timed
that are installed: pykdtree, small_gicp, and Open3D with its whole statistical outlier removal.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.kernels import threads as pool
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.results.peers import has_open3d, open3d_cloud
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive
from lidar_outlier_lab.simulation.world.recording import clouds

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.annotations import Floats


K = 20
ROUNDS = 7
SHARES = (16, 8, 4, 2, 1)  # of the cloud, to see how the time grows
REJECTED = 0.01
STATUS, PEAK = Path('/proc/self/status'), Path('/proc/self/clear_refs')


class Work(NamedTuple):
    """Something to time."""

    name: str
    points: int
    call: Callable[[], object]


def street() -> Floats:
    """Return the points of the simulated drive."""
    parts = [points for _, points in clouds(demo_drive())]
    xyz = [np.stack([part[axis] for axis in 'xyz'], axis=1) for part in parts]
    return np.concatenate(xyz).astype(np.float64)


def compare(xyz: Floats) -> None:
    """Refuse to time a search whose distances are not those of scipy."""
    neighbourhood = Neighbourhood(xyz, K)
    own = neighbourhood.xyz
    to = own[neighbourhood.nearest(K).index] - own[:, None]
    expected, _ = cKDTree(own).query(own, K + 1, workers=-1)
    wrong = ~np.isclose(np.linalg.norm(to, axis=2), expected[:, 1:], rtol=1e-12, atol=0.0)
    if wrong.any():
        raise FilterError('the distances', "scipy's", f'{np.count_nonzero(wrong)} others')


def works(xyz: Floats, threads: int) -> list[Work]:
    """List all that is to be timed; scipy, which the others are compared with, first."""
    count = len(xyz)
    searched = Neighbourhood(xyz, K, threads)
    searched.nearest(K)
    rejected = np.random.default_rng(0).uniform(size=count) < REJECTED
    found = [
        Work('scipy cKDTree', count, lambda: cKDTree(xyz).query(xyz, K + 1, workers=threads)),
        Work('Neighbourhood', count, lambda: Neighbourhood(xyz, K, threads).nearest(K)),
        Work('Neighbourhood, one thread', count, lambda: Neighbourhood(xyz, K, 1).nearest(K)),
        Work('Neighbourhood, tree only', count, lambda: Neighbourhood(xyz, K, threads).tree),
        Work(f'without {REJECTED:.0%} of the points', count, lambda: searched.without(rejected)),
    ]
    if find_spec('pykdtree') is not None:
        kdtree = import_module('pykdtree.kdtree')
        found.append(Work('pykdtree', count, lambda: kdtree.KDTree(xyz).query(xyz, K + 1)))
    if find_spec('small_gicp') is not None:
        gicp = import_module('small_gicp')
        found.append(
            Work(
                'small_gicp',
                count,
                lambda: gicp.KdTree(xyz, threads).batch_knn_search(xyz, K + 1, threads),
            )
        )
    if has_open3d():
        cloud = open3d_cloud(xyz)
        name = f'Open3D, all of remove_statistical_outlier({K}, 2.0)'
        found.append(Work(name, count, lambda: cloud.remove_statistical_outlier(K, 2.0)))
    return found


def best(all_works: list[Work]) -> list[float]:
    """Time all works in turn, and return the best round of each, in seconds."""
    seconds = [np.inf] * len(all_works)
    for _ in range(ROUNDS + 1):
        for i, work in enumerate(all_works):
            begin = perf_counter()
            work.call()
            seconds[i] = min(seconds[i], perf_counter() - begin)
    return seconds


def peak(call: Callable[[], object]) -> float:
    """Return by how much memory grows at most during a call, bytes."""
    PEAK.write_text('5')
    before, _ = _memory()
    call()
    return _memory()[1] - before


def _memory() -> tuple[int, int]:
    """Return the memory in use, and the most that ever was, bytes."""
    lines = dict(line.split(':', 1) for line in STATUS.read_text().splitlines())
    return tuple(1024 * int(lines[name].split()[0]) for name in ('VmRSS', 'VmHWM'))  # type: ignore[return-value]


def main() -> int:
    """Compare, measure and print tables; returns the exit status."""
    threads = int(sys.argv[1]) if len(sys.argv) > 1 else pool.cores()
    console = Console()
    xyz = street()
    compare(xyz)
    memory = peak(lambda: Neighbourhood(xyz, K, threads).nearest(K))
    timed = works(xyz, threads)
    seconds = best(timed)
    table = Table(f'{K} nearest of {len(xyz):,} points', 'ms', 'million points/s', '× scipy')
    for column in table.columns[1:]:
        column.justify = 'right'
    for work, mine in zip(timed, seconds, strict=True):
        speed = f'{work.points / mine / 1e6:.2f}'
        table.add_row(work.name, f'{1e3 * mine:.0f}', speed, f'{seconds[0] / mine:.2f}')
    console.print(table)
    growth = [xyz[: len(xyz) // share] for share in SHARES]
    parts = [
        Work('', len(part), lambda part=part: Neighbourhood(part, K, threads).nearest(K))  # type: ignore[misc]
        for part in growth
    ]
    table = Table('µs/point, of', *(f'{len(part):,}' for part in growth))
    each = zip(parts, best(parts), strict=True)
    table.add_row('Neighbourhood', *(f'{1e6 * mine / part.points:.3f}' for part, mine in each))
    console.print(table)
    console.print(
        f'{threads} threads; the best of {ROUNDS} rounds. '
        f'At its peak the search takes {memory / len(xyz):.0f} bytes a point.',
        highlight=False,
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
