# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Replay by several processes: how much faster they are, and what they cost.

    scripts/environment python benchmarks/archive.py RECORDING FOLDER [--recordings 1] [--jobs 2]
        [--set NAME=VALUE]

Replays a recording in this process with kernels on one thread, then through Dask with one worker,
then with ``--jobs``. ``--recordings`` takes it so many times, as an archive: in pieces, and then
whole, each by one worker. Every output must have the same bytes. Starting the workers, and loading
the kernels in them, is not counted: an archive pays it once. ``FOLDER`` is made, and removed.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import psutil

from lidar_outlier_filter.archive.engine import Engine
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.order import Order
from lidar_outlier_filter.archive.pieces import LENGTH, Piece, cut, judge_piece
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.archive.workers import local_workers
from lidar_outlier_filter.cli.terminal import add_parameter_options, read_parameters
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.stream.compiling import make_ready
from lidar_outlier_filter.stream.memory import keep_memory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.archive.workers import Workers

MEGABYTE, SECOND = 1e6, 1e9


def timed(
    tasks: Sequence[Task], order: Order, workers: Workers | None, scratch: Path | None = None
) -> tuple[float, list[str]]:
    """Replay; return the seconds, and the hashes of the outputs, which are removed."""
    before, began = processor_seconds(), perf_counter()
    engine = Engine(tasks, order, workers, folder=scratch)
    for task in tasks:
        engine.replay(task, Path(str(task.output)), lambda _done, _all: None)
    elapsed = perf_counter() - began
    own, others = (after - then for after, then in zip(processor_seconds(), before, strict=True))
    print(f'  processor seconds: {own:.1f} of this process, {others:.1f} of workers')
    found = []
    for task in tasks:
        output = Path(str(task.output))
        file = output / f'{output.name}.mcap'
        found.append(hashlib.sha256(file.read_bytes()).hexdigest())
        shutil.rmtree(output)
    if engine.judged:
        print(f'  blocks judged by who writes: {engine.judged_here} of {engine.judged}')
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
    parser.add_argument('--recordings', type=int, default=1, help='how often it is replayed')
    parser.add_argument('--jobs', type=int, default=2)
    add_parameter_options(parser)
    options = parser.parse_args()
    values = {**read_parameters(options.params, options.settings), 'threads': 1}
    order = Order(parameters=values)
    keep_memory()  # as the command does
    make_ready(order.filter)
    scratch = options.folder.resolve() / 'scratch'
    scratch.mkdir(parents=True)
    tasks = _tasks(options.recording.resolve(), scratch.parent, options.recordings)
    print(f'load average {os.getloadavg()[0]:.1f} before')
    alone, expected = timed(tasks, order, None)
    print(f'in this process: {alone:.1f} s')
    ways = {'in pieces': None, 'whole': scratch} if len(tasks) > 1 else {'in pieces': None}
    for jobs in (1, options.jobs):
        with local_workers(jobs) as workers:
            for future in [workers.submit(piece) for piece in _short(tasks[0], order)[:jobs]]:
                future.result()  # has the kernels loaded
            for way, folder in ways.items():
                if jobs == 1 and way != [*ways][-1]:
                    continue
                elapsed, found = timed(tasks, order, workers, folder)
                same = 'the same bytes' if found == expected else 'OTHER BYTES'
                factor = f'{alone / elapsed:.2f} × as fast'
                print(f'{jobs} workers, {way}: {elapsed:.1f} s, {factor}, {same}')
            print(f'{memory():.0f} MB of a worker at most')
    task = tasks[0]
    judged = [judge_piece(piece) for piece in cut(task.location, (), values, LENGTH)[:3]]
    sent = sum(len(packed) for one in judged for packed in one.verdicts.values())
    print(f'{sum(one.seconds for one in judged) / len(judged):.2f} s per piece of {LENGTH:g} s')
    with Recording(options.recording) as source:
        share = sent / len(judged) / (task.location.size * LENGTH * SECOND / source.duration)
    print(f'{sent / len(judged) / MEGABYTE:.3f} MB of verdicts per piece, {share:.3%} of its bytes')
    print(f'load average {os.getloadavg()[0]:.1f} after')
    shutil.rmtree(options.folder)


def _tasks(recording: Path, folder: Path, count: int) -> list[Task]:
    """Give links to a recording, and where their outputs go."""
    links = [folder / f'{number}{recording.suffix}' for number in range(count)]
    for link in links:
        link.symlink_to(recording)
    return [Task(location_of(link), folder / f'bag{number}') for number, link in enumerate(links)]


def _short(task: Task, order: Order) -> list[Piece]:
    """Cut short pieces, one for each worker to begin with."""
    return cut(task.location, (), order.parameters, 1.0)


if __name__ == '__main__':
    main()
