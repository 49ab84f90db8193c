# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Replay by several processes: how much faster they are, and what they cost.

    scripts/environment python benchmarks/archive.py RECORDING FOLDER [--recordings 2] [--jobs 2]
        [--set NAME=VALUE]

Replays a recording in this process with kernels on one thread, then with kernels on ``--jobs``.
What the first thread computes is the time that it takes where nothing else runs. Then
``--recordings`` of it are replayed, each by one of ``--jobs`` workers. Every output must have the
same bytes. Starting the workers, and loading the kernels in them, is not counted: an archive pays
it once. ``FOLDER`` is made, and removed.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
from pathlib import Path
from time import perf_counter, thread_time
from typing import TYPE_CHECKING

import psutil

from lidar_outlier_filter.archive.hands import ByWhom
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.manifest import opened_manifest
from lidar_outlier_filter.archive.one_recording import ReplayOrder
from lidar_outlier_filter.archive.run import run_all
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.archive.workers import local_workers
from lidar_outlier_filter.cli.terminal import add_parameter_options, read_parameters
from lidar_outlier_filter.pipeline.compiling import make_ready
from lidar_outlier_filter.pipeline.memory import keep_memory

if TYPE_CHECKING:
    from collections.abc import Sequence


def timed(tasks: Sequence[Task], order: ReplayOrder, by: ByWhom) -> tuple[float, set[str]]:
    """Replay; return the seconds, and the hashes of the outputs, which are removed."""
    before, began, first = processor_seconds(), perf_counter(), thread_time()
    with opened_manifest(tasks[0].output.parent) as manifest:
        run_all(tasks, order, manifest, by)
    elapsed = perf_counter() - began
    own, others = (after - then for after, then in zip(processor_seconds(), before, strict=True))
    print(f'  processor seconds: {own:.1f} of this process, {others:.1f} of workers')
    print(f'  of the first thread: {thread_time() - first:.1f}')
    found = set()
    for task in tasks:
        output = Path(str(task.output))
        file = output / f'{output.name}.mcap'
        found.add(hashlib.sha256(file.read_bytes()).hexdigest())
        shutil.rmtree(output)
    return elapsed, found


def processor_seconds() -> tuple[float, float]:
    """Return those of this process, and of its workers: these say more where others are busy."""
    me = psutil.Process()
    times = [one.cpu_times() for one in (me, *me.children(recursive=True))]
    sums = [one.user + one.system for one in times]
    return sums[0], sum(sums[1:])


def memory() -> float:
    """Return the most memory that a worker of this process has taken so far, MB."""
    found = psutil.Process().children(recursive=True)
    peaks = [
        int(line.split()[1]) / 1e3
        for one in found
        for line in Path(f'/proc/{one.pid}/status').read_text('ascii').splitlines()
        if line.startswith('VmHWM')
    ]
    return max(peaks)


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('recording', type=Path)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--recordings', type=int, default=2, help='for the workers')
    parser.add_argument('--jobs', type=int, default=2)
    add_parameter_options(parser)
    options = parser.parse_args()
    values = read_parameters(options.params, options.settings)
    one, many = (
        ReplayOrder(parameters={**values, 'threads': count}) for count in (1, options.jobs)
    )
    keep_memory()  # as the command does
    make_ready(one.filter)
    hidden = options.folder.resolve() / 'hidden'
    hidden.mkdir(parents=True)
    tasks = _tasks(options.recording.resolve(), hidden.parent, options.recordings)
    print(f'load average {os.getloadavg()[0]:.1f} before')
    alone, expected = timed(tasks[:1], one, ByWhom(None, hidden))
    print(f'in this process: {alone:.1f} s')
    elapsed, found = timed(tasks[:1], many, ByWhom(None, hidden))
    _show(f'kernels on {options.jobs} threads', elapsed, alone, found == expected)
    with local_workers(options.jobs) as workers:
        workers.client.run(make_ready, one.filter)
        elapsed, found = timed(tasks, one, ByWhom(workers, hidden))
        _show(f'{options.jobs} workers', elapsed, alone * len(tasks), found == expected)
        print(f'{memory():.0f} MB of a worker at most')
    print(f'load average {os.getloadavg()[0]:.1f} after')
    shutil.rmtree(options.folder)


def _show(what: str, elapsed: float, alone: float, is_same: bool) -> None:  # noqa: FBT001
    same = 'the same bytes' if is_same else 'OTHER BYTES'
    print(f'{what}: {elapsed:.1f} s, {alone / elapsed:.2f} × as fast, {same}')


def _tasks(recording: Path, folder: Path, count: int) -> list[Task]:
    """Give links to a recording, and where their outputs go."""
    links = [folder / f'{number}{recording.suffix}' for number in range(count)]
    for link in links:
        link.symlink_to(recording)
    return [Task(location_of(link), folder / f'bag{number}') for number, link in enumerate(links)]


if __name__ == '__main__':
    main()
