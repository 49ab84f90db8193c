# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the filter is, and how fast a peer on the same cloud in the same run.

Tests compare the results: those of kernels with plain loops, and those of peers with ours.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from lidar_outlier_filter.cli.terminal import show
from lidar_outlier_filter.core.annotations import Bools, Floats
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.core.points.points import Points, is_return
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline
from lidar_outlier_lab.results import markdown, peers
from lidar_outlier_lab.results.native_peers import NativePeers, native_peers
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, demo_sweeps
from lidar_outlier_lab.simulation.world.recording import clouds, to_message
from lidar_outlier_lab.simulation.world.sensors import ProfileScanner

SHOTS = 1000  # of a scan line
NEIGHBOURS, MULTIPLIER = 20, 2.0  # of the peers' statistical outlier removal
DROR = (3, 0.05, 0.035)  # others, least radius in metres, radius ÷ range
ROUNDS = 5
SPATIAL = ('quadric', 'lof', 'sor')
CHAINS = (('boosted_trees',), ('alpha_beta_gamma',), ('alpha_beta_gamma', 'quadric', 'lof'))
SWEEPS = ((128, 1024), (64, 2048))  # rings and columns of spinning sensors, 10 Hz
TURNS = 8
SLOWER = 160.0  # scan lines a second of another profile scanner; 150 have no whole nanoseconds
SECONDS = 4.0  # of the demo's drive
SHARES = (16, 8, 4, 2, 1)  # of the cloud, to see how the time grows
SLOW = 8  # part of the cloud that slow peers get
COPIED = 48  # bytes of a point, as Ouster's: nothing that touches a cloud is faster than its copy
COMMAND = 'lidar-outlier-filter bench --write doc/results/speed.md'
MAX_CORES = 2
PEERS = ('open3d', 'small_gicp', 'sklearn')
# What is not compared here, and why.
OTHERS = ('3D-OutDet: [real snow](../real_snow.md) has its speed on a processor',)


@dataclass
class Work:
    """Something to time, on a number of points."""

    name: str
    points: int
    call: Callable[[], object]
    seconds: list[float] = field(default_factory=list)  # of each round

    @property
    def nanoseconds(self) -> float:
        """Nanoseconds a point, in the median round."""
        return median(self.seconds) / self.points * 1e9

    @property
    def speed(self) -> float:
        """Million points per second, in the median round."""
        return self.points / median(self.seconds) / 1e6


def measure(works: Sequence[Work]) -> None:
    """Time all works in turn, in rounds, after one that does not count."""
    for number in range(ROUNDS + 1):
        for work in works:
            begin = perf_counter()
            work.call()
            if number:
                work.seconds.append(perf_counter() - begin)


def spatial_work(xyz: Floats, detector: str) -> Work:
    """Run one spatial detector on the whole cloud at once, its neighbourhood included."""
    parameters = FilterParameters().changed({'chain': [detector]})
    whole = np.zeros(len(xyz), np.int64)
    points = Points(xyz, whole, whole, np.ones(len(xyz), np.bool_))
    chain = Chain(parameters)
    return Work(detector, len(xyz), lambda: chain.judge(points))


def spinning_messages(rings: int, columns: int) -> list[Any]:
    """Turn once in the demo's street in dry air, and take the sweep several times, at 10 Hz."""
    drive = demo_sweeps(rings, columns)
    ((stamp, points),) = clouds(drive, 1)
    turn = drive.shots * drive.sensor.interval
    return [to_message(stamp + number * turn, points) for number in range(TURNS)]


def profile_messages(lines: float) -> list[Any]:
    """Drive through the demo's street for its four seconds, with so many scan lines a second."""
    drive = demo_drive()
    slower = replace(
        drive,
        sensor=ProfileScanner(lines_per_second=lines, shots_per_line=SHOTS),
        lines=round(lines * SECONDS),
    )
    return [to_message(stamp, points) for stamp, points in clouds(slower)]


def stream_work(
    messages: list[Any], chain: Sequence[str], form: Mapping[str, object] = SENSOR
) -> Work:
    """Filter a drive: decode, verdict, split. ``form`` is how its clouds are read."""
    parameters = FilterParameters().changed({**form, 'chain': chain})

    def stream() -> None:
        cloud_filter = Pipeline(parameters)
        outputs = sum(len(cloud_filter.process(msg)) for msg in messages)
        outputs += len(cloud_filter.flush())
        if outputs != len(messages):
            raise FilterError('the results', f'{len(messages)}', outputs)

    points = sum(msg.width * msg.height for msg in messages)
    return Work(f'decode → {", ".join(chain)} → split', points, stream)


def peer_works(xyz: Floats, native: NativePeers | None) -> list[Work]:
    """Run the peers' SOR and LOF on the same points; all but Open3D's on some of them."""
    some = xyz[: len(xyz) // SLOW]
    sor_name = f'SOR({NEIGHBOURS}, {MULTIPLIER})'
    works = []
    if peers.loads('open3d'):
        remove = peers.open3d_cloud(xyz).remove_statistical_outlier
        name, call = f'Open3D: {sor_name}', partial(remove, NEIGHBOURS, MULTIPLIER)
        works.append(Work(name, len(xyz), call))
    if peers.loads('small_gicp'):
        call = partial(peers.small_gicp_sor, xyz, NEIGHBOURS, MULTIPLIER)
        same(f'small_gicp: {sor_name}', call(), peers.sor(xyz, NEIGHBOURS, MULTIPLIER))
        works.append(Work(f'small_gicp: {sor_name}', len(xyz), call))
    call = partial(peers.sor, some, NEIGHBOURS, MULTIPLIER)
    works.append(Work(f'SciPy: {sor_name}', len(some), call))
    if native and native.has_pcl:
        call = partial(native.sor, some.astype(np.float32), NEIGHBOURS, MULTIPLIER)
        same(f'PCL: {sor_name}', call(), peers.sor(some, NEIGHBOURS, MULTIPLIER))
        works.append(Work(f'PCL: {sor_name}', len(some), call))
    if peers.loads('sklearn'):
        name = f'scikit-learn: LOF({NEIGHBOURS})'
        works.append(Work(name, len(some), lambda: peers.lof(some, NEIGHBOURS)))
    return works


def vehicle_works(msg: Any, native: NativePeers | None) -> list[Work]:
    """Run on one turn of a spinning sensor what vehicles run today; and the copy of a cloud."""
    rows, xyz = structured(msg).reshape(-1), coordinates([msg])
    reach = np.linalg.norm(xyz, axis=1)
    works = []
    if native:
        # The demo's sensor turns clockwise, and azimuths grow with time.
        azimuth, ring = -np.arctan2(xyz[:, 1], xyz[:, 0]), rows['ring'].copy()
        given, azimuth, far = (column.astype(np.float32) for column in (xyz, azimuth, reach))
        call = partial(native.rings, given, azimuth, far, ring)
        works.append(Work('C++: ring filter of Autoware', len(xyz), call))
    if native and native.has_pcl:
        others, least, factor = DROR
        some = slice(len(xyz) // SLOW)
        call = partial(native.dror, xyz[some].astype(np.float32), *DROR)
        third = peers.distances(xyz[some], others)[:, -1]
        same('DROR on PCL', call(), third > np.maximum(least, factor * reach[some]))
        works.append(Work('PCL: DROR', len(third), call))
    cloud = np.zeros(len(xyz) * COPIED, np.uint8)
    copy = partial(np.copyto, np.empty_like(cloud), cloud)
    return [*works, Work(f'copy of {COPIED} bytes a point', len(xyz), copy)]


def same(name: str, rejected: Bools, expected: Bools) -> None:
    """Refuse to time a peer that does not do what the table says."""
    different = int((rejected != expected).sum())
    if different:
        raise FilterError(f'points that {name} rejects', 'those of SciPy', different)


def coordinates(messages: list[Any]) -> Floats:
    """Return the returns of clouds (N, 3), metres."""
    parts = [structured(msg).reshape(-1) for msg in messages]
    xyz = np.concatenate([np.stack([part[axis] for axis in 'xyz'], axis=1) for part in parts])
    exact = xyz.astype(np.float64)
    return exact[is_return(exact)]


# Tables, for the terminal and for a page


def run(page: Path | None = None) -> int:
    """Measure, print tables, and write them where a page is named; return the exit status."""
    messages = [to_message(stamp, points) for stamp, points in clouds(demo_drive())]
    with native_peers() as native:
        parts = [_conditions(native)]
        for title, table in _tables(messages, native):
            parts.append(f'## {title}\n\n{table}')
            show(*parts[-1].splitlines())
    show(parts[0])
    if page is not None:
        markdown.write(page, 'speed', markdown.paragraphs(*parts), command=COMMAND)
    return 0


def _tables(messages: list[Any], native: NativePeers | None) -> Iterator[tuple[str, str]]:
    xyz = coordinates(messages)
    works = [stream_work(messages, chain) for chain in CHAINS]
    works += [spatial_work(xyz, name) for name in SPATIAL]
    works += peer_works(xyz, native)
    yield 'The demo: a profile scanner', speeds(works)
    slower = profile_messages(SLOWER)
    works = [stream_work(slower, CHAINS[0])]
    name = f'A profile scanner of {SLOWER:.0f} lines × {SHOTS} shots a second'
    yield name, speeds([*works, *peer_works(coordinates(slower), native)])
    for rings, columns in SWEEPS:
        turns = spinning_messages(rings, columns)
        works = [stream_work(turns, chain, {}) for chain in CHAINS[:2]]
        works += peer_works(coordinates(turns[:1]), native) + vehicle_works(turns[0], native)
        yield f'Sweeps of {rings} × {columns}', speeds(works)
    yield 'Growth with the cloud', _growth(xyz)


def speeds(works: Sequence[Work]) -> str:
    """Measure works on one core, and on two where there are; peers are compared on the most."""
    counts = range(1, min(cores(), MAX_CORES) + 1)
    every = [
        [replace(work, call=partial(_on, count, work.call), seconds=[]) for count in counts]
        for work in works
    ]
    measure([one for row in every for one in row])
    peer = next((row[-1] for row in every if row[-1].name.startswith('Open3D')), None)
    head = ['', 'points', *(f'{n} core{"s" * (n > 1)}, million/s' for n in counts)]
    head += ['ns a point', *(['× Open3D'] if peer else [])]
    rows = []
    for row in every:
        most = row[-1]
        cells = [most.name, f'{most.points:,}', *(f'{one.speed:.2f}' for one in row)]
        cells += [f'{most.nanoseconds:.0f}', *([f'{most.speed / peer.speed:.2f}'] if peer else [])]
        rows.append(cells)
    return markdown.table(head, rows)


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
    works = [spatial_work(xyz[: len(xyz) // n], name) for name in SPATIAL for n in SHARES]
    measure(works)
    rows = []
    for i in range(0, len(works), len(SHARES)):
        row = works[i : i + len(SHARES)]
        rows.append([row[0].name, *(f'{one.nanoseconds:.0f}' for one in row)])
    head = ['ns a point, of so many', *(f'{one.points:,}' for one in works[: len(SHARES)])]
    return markdown.table(head, rows)


def _conditions(native: NativePeers | None) -> str:
    """Say how it was measured, and which peers are missing."""
    why = {True: 'not installed', False: 'cannot be loaded'}
    missing = [f'{name}: {why[find_spec(name) is None]}' for name in PEERS if not peers.loads(name)]
    if native is None or not native.has_pcl:
        missing.append('PCL: ' + ('no C++ compiler' if native is None else 'not installed'))
    left = '; '.join((*missing, *OTHERS))
    return (
        f'{cores()} cores; medians of {ROUNDS} rounds, in which all works take turns. '
        f'Left out are {left}.'
    )
