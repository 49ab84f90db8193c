# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of ``bench``, for the terminal and for a page: speeds, growth, and what costs what."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_lab.results import bench, markdown
from lidar_outlier_lab.results.bench import (
    CHAINS,
    SHARES,
    SHOTS,
    SIDES,
    SLOWER,
    SPATIAL,
    SWEEPS,
    Work,
)
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive
from lidar_outlier_lab.simulation.world.recording import clouds, to_message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from typing import Any

    from rich.console import Console

    from lidar_outlier_filter.core.annotations import Floats

COMMAND = 'lidar-outlier-filter bench --write doc/results/speed.md'
MOST_CORES = 2
PEERS = ('open3d', 'sklearn')
# What is not compared here, and why.
OTHERS = (
    'PCL: its Python bindings are no longer maintained, and need an old release of it',
    '3D-OutDet: [real snow](../real_snow.md) has its speed on a processor',
)


def run(console: Console, page: Path | None = None) -> int:
    """Compare, measure, print tables, and write them where a page is named; exit status."""
    bench.compare_engines()
    messages = [to_message(stamp, points) for stamp, points in clouds(demo_drive())]
    xyz = bench.coordinates(messages)
    bench.compare_sor(xyz[: len(xyz) // 8])
    parts = [_conditions()]
    for title, table in _tables(messages, xyz):
        parts.append(f'## {title}\n\n{table}')
        console.print(parts[-1], markup=False, highlight=False, soft_wrap=True)
    console.print(parts[0], markup=False, highlight=False)
    if page is not None:
        markdown.write(page, 'speed', markdown.paragraphs(*parts), command=COMMAND)
    return 0


def _tables(messages: list[Any], xyz: Floats) -> Iterator[tuple[str, str]]:
    works = [bench.stream_work(messages, chain) for chain in CHAINS]
    works += [bench.smoother_work(sides) for sides in SIDES]
    works += [bench.spatial_work(xyz, name) for name in SPATIAL]
    works += [*bench.peer_works(xyz), bench.floor_work(len(xyz))]
    yield 'The demo: a profile scanner', speeds(works)
    slower = bench.profile_messages(SLOWER)
    works = [bench.stream_work(slower, CHAINS[0])]
    name = f'A profile scanner of {SLOWER:.0f} lines × {SHOTS} shots a second'
    yield name, speeds([*works, *bench.peer_works(bench.coordinates(slower))])
    for rings, columns in SWEEPS:
        turns = bench.spinning_messages(rings, columns)
        works = [bench.stream_work(turns, chain, {}) for chain in CHAINS[:2]]
        peers = bench.peer_works(bench.coordinates(turns[:1]))
        yield f'Sweeps of {rings} × {columns}', speeds([*works, *peers])
    yield 'Growth with the cloud', _growth(xyz)


def speeds(works: Sequence[Work]) -> str:
    """Measure works on one core, and on two where there are; peers are compared on the most."""
    counts = range(1, min(cores(), MOST_CORES) + 1)
    every = [[on(count, work) for count in counts] for work in works]
    bench.measure([one for row in every for one in row])
    peer = next((row[-1] for row in every if row[-1].name.startswith('Open3D')), None)
    head = ['', 'points', *(f'{n} core{"s" * (n > 1)}, million/s' for n in counts)]
    head += ['ns a point', *(['× Open3D'] if peer else [])]
    rows = []
    for row in every:
        most = row[-1]
        cells = [most.name, f'{most.points:,}', *(f'{one.speed:.2f}' for one in row)]
        cells += [f'{most.nanoseconds:.0f}', *([f'{most.times(peer):.2f}'] if peer else [])]
        rows.append(cells)
    return markdown.table(head, rows)


def on(count: int, work: Work) -> Work:
    """Return the same work on so many cores only."""
    return Work(work.name, work.points, partial(_on, count, work.call))


def _on(count: int, call: Callable[[], object]) -> None:
    with limited(count):
        call()


@contextmanager
def limited(count: int) -> Iterator[None]:
    """Leave so many cores to all threads of this process, those of libraries too."""
    before = os.sched_getaffinity(0)
    _allow(set(sorted(before)[:count]))
    try:
        yield
    finally:
        _allow(before)


def _allow(allowed: set[int]) -> None:
    for thread in Path('/proc/self/task').iterdir():
        with suppress(ProcessLookupError):  # it ended
            os.sched_setaffinity(int(thread.name), allowed)


def _growth(xyz: Floats) -> str:
    works = [bench.spatial_work(xyz[: len(xyz) // n], name) for name in SPATIAL for n in SHARES]
    bench.measure(works)
    rows = []
    for i in range(0, len(works), len(SHARES)):
        row = works[i : i + len(SHARES)]
        rows.append([row[0].name, *(f'{one.nanoseconds:.0f}' for one in row)])
    head = ['ns a point, of so many', *(f'{one.points:,}' for one in works[: len(SHARES)])]
    return markdown.table(head, rows)


def _conditions() -> str:
    """Say how it was measured, and which peers are missing."""
    missing = [f'{name}: not installed' for name in PEERS if find_spec(name) is None]
    left = '; '.join((*missing, *OTHERS))
    return (
        f'{cores()} cores; medians of {bench.ROUNDS} rounds, in which all works take turns. '
        f'Left out are {left}.'
    )
