# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""An archive of 100 TB on 1 to 1000 workers, simulated from what was measured on one machine.

    python benchmarks/archive_plan.py [--measure] [--figure FILE]

Printed are the hours that it takes, how many times faster that is than one worker, and what an hour
of a drive costs. ``--measure`` prints the processor time of a Dask task instead: of the scheduler,
the client and a worker, each a process, for tasks that do nothing and return 16 kB.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import heapq
import os
import subprocess
import sys
from collections import deque
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ARCHIVE = 100e12  # bytes
WORKERS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
TASKS, AHEAD = 2000, 9  # of the measurement


@dataclass(frozen=True)
class Sensor:
    """What was measured for each second of a recording; processor seconds on one thread."""

    name: str
    read: float  # bytes
    written: float  # bytes, with the copy of the input
    judge: float  # by a worker, in pieces of 10 s, with what is read before each
    write: float  # by the process that writes what workers have judged
    replay: float  # by one process that judges and writes


# 10 s and 15 s made of the real sweeps; processor seconds, two cores, 2026-11-22.
SENSORS = (
    Sensor('OS1-128, 128 × 1024', 63.5e6, 127.0e6, 0.77, 0.24, 0.84),
    Sensor('XT32, 32 × 1900', 18.4e6, 36.8e6, 0.60, 0.08, 0.61),
)


@dataclass(frozen=True)
class Cluster:
    """Dask's part, measured, and what is assumed of machines, store and prices."""

    scheduler: float = 0.0022  # s of a task
    client: float = 0.0015  # s of a task
    link: float = 78e6  # bytes/s of a worker: 16 of them on a machine with 10 Gbit/s
    writer_link: float = 1.25e9  # bytes/s of the machine of the one writer
    store: float = 12.5e9  # bytes/s of the store to all: 100 Gbit/s
    price: float = 0.045  # $ for an hour of a processor
    get: float = 0.4e-6  # $ for a request that reads 4 MiB
    put: float = 5e-6  # $ for a request that writes 32 MiB
    piece: float = 10.0  # s; those at the end of the last recording are shorter
    before: float = 0.72  # s read before each piece
    recording: float = 1200.0  # s, the median; the standard deviation of its logarithm is 0.5


def by_pieces(sensor: Sensor, cluster: Cluster, workers: int) -> float:
    """Hours with workers that judge pieces, and one process that writes all recordings in order.

    2000 pieces are simulated; the rest takes its time in proportion.
    """
    pieces = round(ARCHIVE / sensor.read / cluster.piece)
    read = sensor.read * (cluster.piece + cluster.before)
    judged = max(read / cluster.link + sensor.judge * cluster.piece, workers * read / cluster.store)
    moved = (sensor.read + sensor.written) * cluster.piece / cluster.writer_link
    written = sensor.write * cluster.piece + cluster.client + moved
    free = [0.0] * workers
    ahead = 2 * workers + 1
    taken: deque[float] = deque([0.0] * ahead, ahead)
    scheduler = end = 0.0
    count = max(2000, 20 * workers)
    for _ in range(count):
        scheduler = max(scheduler, taken[0]) + cluster.scheduler
        done = max(scheduler, heapq.heappop(free)) + judged
        heapq.heappush(free, done)
        taken.append(max(done, end))
        end = taken[-1] + written
    return end / count * pieces / 3600


def by_recordings(sensor: Sensor, cluster: Cluster, workers: int) -> float:
    """Hours with workers that replay whole recordings, each with a writer of its own."""
    rng = np.random.default_rng(1)
    share: list[float] = []
    left = ARCHIVE / sensor.read
    while left > 0:
        share.append(cluster.recording * rng.lognormal(0, 0.5))
        left -= share[-1]
    moved = sensor.read + sensor.written
    waiting = sorted(share)  # the longest is taken first, so that none ends long after all others
    ends: list[float] = []  # of those under way, in seconds of a recording that was always so
    now = at = 0.0
    while waiting or ends:
        while waiting and len(ends) < workers:
            heapq.heappush(ends, at + waiting.pop())
            now += cluster.scheduler
        # All of them together get what the store gives, and no more.
        slowed = len(ends) * moved / cluster.store
        each = max(sensor.replay + moved / cluster.link, slowed)
        end = heapq.heappop(ends)
        now += (end - at) * each
        at = end
    return now / 3600


def cost(sensor: Sensor, cluster: Cluster, processors: int, hours: float) -> float:
    """$ for an hour of a drive: processors while all runs, and requests."""
    drive = ARCHIVE / sensor.read / 3600  # hours
    requests = sensor.read / 2**22 * cluster.get + sensor.written / 2**25 * cluster.put
    return cluster.price * processors * hours / drive + 3600 * requests


def ways(sensor: Sensor) -> dict[str, tuple[Sensor, bool]]:
    """Name the ways to do it: which bytes are written, and whether by one process."""
    short = replace(sensor, written=sensor.written - sensor.read)
    return {
        'pieces, one writer': (sensor, True),
        'whole recordings': (sensor, False),
        'whole recordings, input dropped': (short, False),
    }


def hours(sensor: Sensor, workers: int, *, one_writer: bool) -> float:
    """Simulate one way."""
    return (by_pieces if one_writer else by_recordings)(sensor, Cluster(), workers)


def tables() -> None:
    """Print hours, speed-up and cost."""
    for sensor in SENSORS:
        drive = ARCHIVE / sensor.read / 3600
        print(f'\n{sensor.name}: {drive:,.0f} h of drives')
        print('workers  ' + '  '.join(f'{name:>34}' for name in ways(sensor)))
        for workers in WORKERS:
            row = []
            for one, one_writer in ways(sensor).values():
                took = hours(one, workers, one_writer=one_writer)
                times = hours(one, 1, one_writer=one_writer) / took
                price = cost(one, Cluster(), workers + one_writer, took)
                row.append(f'{took:10,.1f} h {times:7.1f} × {price:8.3f} $/h')
            print(f'{workers:7}  ' + '  '.join(f'{text:>34}' for text in row))


def draw(path: Path) -> None:
    """Draw how many times faster than one worker replaying whole recordings."""
    from matplotlib.figure import Figure  # noqa: PLC0415  tables need none

    figure = Figure(figsize=(9, 4), layout='constrained')
    axes = figure.subplots(1, 2, sharey=True)
    styles = (('#d55e00', 'o'), ('#0072b2', 's'), ('#009e73', '^'))
    for axis, sensor in zip(axes, SENSORS, strict=True):
        first = hours(sensor, 1, one_writer=False)
        axis.plot(WORKERS, WORKERS, color='0.6', linestyle=':', label='as many times as workers')
        for (name, (one, one_writer)), (colour, mark) in zip(
            ways(sensor).items(), styles, strict=True
        ):
            took = [hours(one, workers, one_writer=one_writer) for workers in WORKERS]
            axis.plot(WORKERS, first / np.array(took), color=colour, marker=mark, label=name)
        axis.set(xscale='log', yscale='log', title=sensor.name, xlabel='workers')
        axis.grid(color='0.9')
    axes[0].set_ylabel('times faster than one worker')
    axes[0].legend(frameon=False, fontsize='small')
    figure.savefig(path, dpi=110)


def nothing(_number: int) -> bytes:
    """Do nothing, and return what the verdicts of 128 k points would be."""
    return bytes(16384)


def measure(workers: int = 4) -> None:
    """Print the processor time of a task, of each process."""
    import psutil  # noqa: PLC0415  as in draw
    from distributed import Client  # noqa: PLC0415

    with TemporaryDirectory() as folder, ExitStack() as stack:
        file = str(Path(folder, 'scheduler.json'))
        options = ['--scheduler-file', file, '--no-dashboard']
        alone = ['--nthreads', '1', '--no-nanny', '--local-directory', folder]
        commands = [['dask_scheduler', *options, '--port', '0']]
        commands += [['dask_worker', *options, *alone]] * workers
        processes = []
        for module, *rest in commands:
            line = [sys.executable, '-m', f'distributed.cli.{module}', *rest]
            process = subprocess.Popen(line, stderr=subprocess.DEVNULL)  # noqa: S603  Dask's own
            stack.callback(process.wait)
            stack.callback(process.terminate)
            processes.append(psutil.Process(process.pid))
        client = stack.enter_context(Client(scheduler_file=file, timeout=60))
        client.wait_for_workers(workers, timeout=60)
        processes.insert(1, psutil.Process(os.getpid()))
        for _ in range(3):
            before = [sum(process.cpu_times()[:2]) for process in processes]
            waiting: deque[object] = deque()
            for number in range(TASKS):
                if len(waiting) == AHEAD:
                    waiting.popleft().result()  # type: ignore[attr-defined]
                waiting.append(client.submit(nothing, number, pure=False))
            client.gather(list(waiting))
            after = [sum(process.cpu_times()[:2]) for process in processes]
            used = [(b - a) / TASKS * 1e3 for a, b in zip(before, after, strict=True)]
            print(
                f'ms of a task: scheduler {used[0]:.2f}, client {used[1]:.2f}, '
                f'worker {sum(used[2:]):.2f}'
            )


def main() -> None:
    """Measure, or print and draw the plan."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('--measure', action='store_true', help='print what a task of Dask costs')
    parser.add_argument('--figure', type=Path, help='draw the plan into this file')
    options = parser.parse_args()
    if options.measure:
        measure()
        return
    tables()
    if options.figure:
        draw(options.figure)


if __name__ == '__main__':
    main()
