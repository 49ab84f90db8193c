# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Prove archives by kills and two runs at once, and measure what they cost per recording.

scripts/environment python benchmarks/archive.py FOLDER [--drives N] [--seconds S] [--tiny N …]

``FOLDER`` must be new. It prints two tables. The exit status is 1 if an output has other bytes than
the replay in one process.
"""

# ruff: noqa: INP001, S603, T201  a script, no package

from __future__ import annotations

import argparse
import os
import random
import resource
import signal
import subprocess
import sys
from pathlib import Path
from time import perf_counter, sleep
from typing import TYPE_CHECKING

import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from helpers.archives import content, hidden
from helpers.drives import write_drive

if TYPE_CHECKING:
    from collections.abc import Callable

COMMAND = [sys.executable, '-m', 'lidar_outlier_filter.cli.main', 'replay']
CHAIN = ['--chain', 'alpha_beta_gamma,elevation']
PERIOD_S = 0.1  # of clouds
MAX_RUNS = 200  # of one command that is killed again and again
CLOUDS, POINTS = 6, 120  # of a tiny recording


def main() -> int:
    """Write recordings, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--drives', type=int, default=12, help='recordings that are proved')
    parser.add_argument('--seconds', type=float, default=20.0, help='of each')
    parser.add_argument('--tiny', type=int, nargs='*', default=[50, 500], help='recordings')
    parser.add_argument('--workers', type=int, default=2)
    options = parser.parse_args()
    options.folder.mkdir(parents=True)
    wrong = prove(options)
    measure(options)
    return int(wrong > 0)


def start(drives: Path, output: Path, workers: int) -> subprocess.Popen[bytes]:
    """Start the command in a process group of its own."""
    words = [*COMMAND, str(drives), '--output', str(output), '--jobs', str(workers), *CHAIN]
    return subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def prove(options: argparse.Namespace) -> int:
    """Compare outputs of disturbed runs with those of one process; count the different ones."""
    drives = options.folder / 'drives'
    drives.mkdir()
    for number in range(options.drives):
        clouds = round(options.seconds / PERIOD_S)
        write_drive(drives / f'{number:03}', clouds, seed=1000 * number, points=2000)
    began = perf_counter()
    start(drives, options.folder / 'whole', 1).wait()
    whole = perf_counter() - began
    expected = content(options.folder / 'whole')
    print('| disturbed by | times | recordings | with other bytes | left hidden |')
    print('| --- | ---: | ---: | ---: | ---: |')
    cases: dict[str, Callable[[Path, float], int]] = {
        'SIGKILL of the command and its workers': lambda path, t: kill_runs(
            drives, path, t, options.workers
        ),
        'SIGINT': lambda path, t: kill_runs(drives, path, t, options.workers, signal.SIGINT),
        'SIGKILL of a worker': lambda path, t: kill_workers(drives, path, t, options.workers),
        'a second run at once': lambda path, _: two_runs(drives, path, options.workers),
    }
    total = 0
    for number, (name, disturb) in enumerate(cases.items()):
        output = options.folder / f'disturbed{number}'
        times = disturb(output, whole)
        found = content(output)
        names = expected.keys() | found.keys()
        wrong = {one.partition('/')[0] for one in names if found.get(one) != expected.get(one)}
        left = len(hidden(output))
        print(f'| {name} | {times} | {options.drives} | {len(wrong)} | {left} |', flush=True)
        total += len(wrong) + left
    return total


def kill_runs(
    drives: Path, output: Path, whole: float, workers: int, number: int = signal.SIGKILL
) -> int:
    """Kill the command at random moments until it ends by itself; count the kills."""
    rng = random.Random(1)  # noqa: S311  moments
    for kills in range(MAX_RUNS):
        run = start(drives, output, workers)
        try:
            # In later runs more time, so that each makes progress however long a start takes.
            run.wait(rng.uniform(0.5, 1.0) * (4 + whole * (kills + 1) / 40))
        except subprocess.TimeoutExpired:
            children = psutil.Process(run.pid).children(recursive=True)
            os.killpg(run.pid, number)
            run.wait()
            for one in children if number == signal.SIGKILL else ():
                if one.is_running():
                    one.kill()
            psutil.wait_procs(children, timeout=60)
        else:
            return kills
    raise SystemExit(f'the command did not end in {MAX_RUNS} runs')


def kill_workers(drives: Path, output: Path, whole: float, workers: int) -> int:
    """Kill a random worker again and again while one command works; count the kills."""
    rng, kills = random.Random(2), 0  # noqa: S311  workers
    run = start(drives, output, workers)
    while run.poll() is None:
        sleep(max(3.0, whole / 8))
        found = [
            one
            for one in psutil.Process(run.pid).children(recursive=True)
            if any('spawn_main' in word for word in one.cmdline())
        ]
        if run.poll() is None and found and kills < 2 * workers:
            rng.choice(found).kill()
            kills += 1
    return kills


def two_runs(drives: Path, output: Path, workers: int) -> int:
    """Run the command twice at once."""
    runs = [start(drives, output, workers) for _ in range(2)]
    return sum(run.wait() == 0 for run in runs) - 1


def measure(options: argparse.Namespace) -> None:
    """Print what tiny recordings cost, which is what an archive adds to a replay."""
    print('\n| recordings | ms of processor each | s | again, ms of processor each | again, s |')
    print('| ---: | ---: | ---: | ---: | ---: |')
    for count in options.tiny:
        drives = options.folder / f'tiny{count}'
        drives.mkdir()
        for number in range(count):
            write_drive(drives / f'{number:05}', CLOUDS, seed=number, points=POINTS)
        cells = []
        for _ in range(2):
            began, before = perf_counter(), used()
            start(drives, options.folder / f'tiny{count}_out', options.workers).wait()
            cells += [1000 * (used() - before) / count, perf_counter() - began]
        print(f'| {count:,} | ' + ' | '.join(f'{cell:.1f}' for cell in cells) + ' |', flush=True)


def used() -> float:
    """Return the seconds of processor time of processes that ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == '__main__':
    sys.exit(main())
