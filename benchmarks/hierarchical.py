# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How fast hierarchical outlier detection and the elevation test are, and what memory they take.

Run as ``python benchmarks/hierarchical.py [MOST_POINTS]``. Answers are compared first, with those
of scipy: Qhull's Delaunay triangulation for the one, as in the paper, and a kd-tree for the other.
Then both are timed on streets of 10 000 points to a million, each in a process of its own.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import sys
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, cKDTree
from scipy.stats import norm

from lidar_outlier_filter.core.detectors.elevation import detector as elevation
from lidar_outlier_filter.core.detectors.elevation.parameters import Elevation
from lidar_outlier_filter.core.detectors.hierarchical import detector as hierarchical
from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.annotations import Floats, Ints


COMPARED, PEERED, MOST = 20_000, 30_000, 1_000_000  # points
RUNS = 5
PEAK = Path('/proc/self/clear_refs')
DENSITY = 2500.0  # points for each metre of the street
# Metres: half the width of road and sidewalks, and the height of facades and of the air.
HALF_WIDTH, HEIGHT, FACADE = 7.5, 12.0, 8.0
NOISE, STRAY = 0.008, 0.005  # standard deviation of a coordinate, metres; share of outliers


class Timing(NamedTuple):
    """Median time, and what memory was used beyond that of the imports and of the cloud."""

    seconds: float
    mebibytes: float


def street(count: int, seed: int = 1) -> Floats:
    """Simulate a street whose length grows with the number of points: road, facades, strays."""
    rng = np.random.default_rng(seed)
    length = count / DENSITY
    stray, half = int(STRAY * count), int(0.3 * count)
    road = count - stray - 2 * half
    parts = [
        np.stack([_along(rng, length, road), rng.normal(0, 2.5, road), np.zeros(road)], axis=1)
    ]
    for side in (-FACADE, FACADE):
        x, z = _along(rng, length, half), HEIGHT * rng.random(half) ** 1.5
        # Recessed windows, and a gap between two houses.
        recessed = ((x % 3.0) < 1.3) & ((z % 3.0) > 1.2)  # noqa: PLR2004  a facade's measures
        y = np.where(recessed, side * 1.02, side) + np.where((x % 40.0) < 4.0, side, 0.0)  # noqa: PLR2004
        parts.append(np.stack([x, y, z], axis=1))
    surface = np.concatenate(parts)
    surface += rng.normal(0.0, NOISE, surface.shape)
    low, high = (0.0, -HALF_WIDTH, 0.2), (length, HALF_WIDTH, HEIGHT)
    cloud: Floats = np.concatenate([surface, rng.uniform(low, high, (stray, 3))])
    return cloud


def _along(rng: np.random.Generator, length: float, count: int) -> Floats:
    """Positions along the street."""
    positions: Floats = rng.uniform(0.0, length, count)
    return positions


def run(console: Console, most: int) -> None:
    """Compare, measure and print a table."""
    cloud = street(COMPARED)
    compare_hierarchical(cloud)
    compare_elevation(cloud)
    console.print(f'Answers on {COMPARED:,} points are those of scipy.', highlight=False)
    table = Table('points', 'method', 'seconds', 'thousand points/s', 'MiB', 'bytes/point')
    for column in table.columns:
        column.justify = 'right'
    sizes = [n for n in (10_000, 30_000, 100_000, 300_000, 1_000_000) if n <= most]
    for count in sizes:
        for name in WORK:
            if name in PEERS and count != PEERED:
                continue
            with get_context('spawn').Pool(1) as pool:
                timing = pool.apply(measure, (name, count))
            speed = count / timing.seconds / 1e3
            each = timing.mebibytes * 2**20 / count
            cells = f'{timing.seconds:.3f}', f'{speed:,.0f}', f'{timing.mebibytes:.0f}'
            table.add_row(f'{count:,}', name, *cells, f'{each:.0f}')
    console.print(table)
    console.print(f'{cores()} cores. Medians of {RUNS} runs; scipy once.', highlight=False)


def measure(name: str, count: int) -> Timing:
    """Time one method, after a run on few points that compiles its kernels."""
    work = WORK[name]
    work(street(1000))
    cloud = street(count)
    PEAK.write_text('5')  # begins the peak anew
    before = _memory('VmRSS')
    times = []
    for _ in range(1 if name in PEERS else RUNS):
        begin = perf_counter()
        work(cloud)
        times.append(perf_counter() - begin)
    return Timing(median(times), _memory('VmHWM') - before)


def _memory(name: str) -> float:
    """Read what the kernel says of this process, MiB."""
    for line in Path('/proc/self/status').read_text(encoding='ascii').splitlines():
        if line.startswith(name):
            return int(line.split()[1]) / 1024
    raise FilterError('/proc/self/status', f'with a line {name}', 'none')


def _hierarchical(cloud: Floats) -> None:
    hierarchical.detect(cloud, Hierarchical())


def _elevation(cloud: Floats) -> None:
    elevation.detect(cloud, Elevation())


def _hierarchical_by_scipy(cloud: Floats) -> None:
    _by_triangulation(cloud, Hierarchical())


def _elevation_by_scipy(cloud: Floats) -> None:
    _by_kd_tree(cloud, Elevation())


PEERS: dict[str, Callable[[Floats], None]] = {
    '… by Qhull': _hierarchical_by_scipy,
    '… by cKDTree': _elevation_by_scipy,
}
WORK: dict[str, Callable[[Floats], None]] = {
    'hierarchical': _hierarchical,
    'elevation': _elevation,
    **PEERS,
}


def compare_hierarchical(cloud: Floats) -> None:
    """Refuse to time an answer that is not that of the paper's own way."""
    parameters = Hierarchical()
    outcome = hierarchical.detect(cloud, parameters)
    phase = _by_triangulation(cloud, parameters)
    if not np.array_equal(outcome.phase, phase):
        differing = np.count_nonzero(outcome.phase != phase)
        raise FilterError('the phases', "those of Qhull's triangulation", f'{differing} others')


def _by_triangulation(xyz: Floats, parameters: Hierarchical) -> Ints:
    """Return which phase rejects each point, by Delaunay triangulations; no two may coincide."""
    phase = np.zeros(len(xyz), np.int64)
    ends = _triangulate(xyz)
    length = np.linalg.norm(xyz[ends[:, 0]] - xyz[ends[:, 1]], axis=1)
    graph = coo_array((length, ends.T), (len(xyz), len(xyz)))
    tree = minimum_spanning_tree(graph).tocoo()
    kept = tree.data <= _limit(tree.data, parameters.global_confidence)
    rough = _label(len(xyz), tree.row[kept], tree.col[kept])
    size = np.bincount(rough)
    phase[size[rough] < parameters.min_cluster] = 1
    for cluster in np.flatnonzero(size >= parameters.min_cluster):
        members = np.flatnonzero(rough == cluster)
        part = xyz[members]
        ends = _triangulate(part)
        middle = (part[ends[:, 0]] + part[ends[:, 1]]) / 2
        length = np.linalg.norm(part[ends[:, 0]] - part[ends[:, 1]], axis=1)
        nearest, _ = cKDTree(part).query(middle)
        gabriel = nearest > length / 2 * (1 - 1e-9)
        ends, length = ends[gabriel], length[gabriel]
        ends = ends[length <= _limit(length, parameters.local_confidence)]
        fine = _label(len(part), *ends.T)
        phase[members[np.bincount(fine)[fine] < parameters.min_cluster]] = 2
    return phase


def _triangulate(xyz: Floats) -> Ints:
    corners = Delaunay(xyz).simplices
    pairs = np.concatenate([corners[:, [a, b]] for a in range(4) for b in range(a)])
    edges: Ints = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)
    return edges


def _label(count: int, i: Ints, j: Ints) -> Ints:
    graph = coo_array((np.ones(len(i)), (i, j)), (count, count))
    label: Ints = connected_components(graph, directed=False)[1]
    return label


def _limit(length: Floats, confidence: float) -> float:
    z = norm.ppf((1 + confidence) / 2)
    return float(np.median(length) + z * np.std(length, ddof=1))


def compare_elevation(cloud: Floats) -> None:
    """Refuse to time scores that are not those of scipy's kd-tree."""
    parameters = Elevation(gap=0.0)
    score = elevation.detect(cloud, parameters)
    expected = _by_kd_tree(cloud, parameters)
    if not np.allclose(score, expected, rtol=1e-9, atol=1e-12):
        worst = np.abs(score - expected).max()
        raise FilterError('the scores', "those of scipy's kd-tree", f'{worst:g} off')


def _by_kd_tree(xyz: Floats, parameters: Elevation) -> Floats:
    """Score each point without the histogram; no two may coincide."""
    _, near = cKDTree(xyz[:, :2]).query(xyz[:, :2], parameters.k + 1, workers=-1)
    difference = xyz[near[:, 1:], 2].mean(axis=1) - xyz[:, 2]
    off = np.abs(difference - difference.mean())
    score: Floats = off / (parameters.multiplier * difference.std(ddof=1))
    return score


if __name__ == '__main__':
    run(Console(), int(sys.argv[1]) if len(sys.argv) > 1 else MOST)
