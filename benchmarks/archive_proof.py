# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""An archive is replayed to the same bytes, whatever is killed.

    python benchmarks/archive_proof.py FOLDER [PART ...] [--data DIR] [--few]

kills      200 recordings of 20 s; a worker is killed by SIGKILL ten times, at random moments
scheduler  six of them by a Dask cluster whose scheduler is killed, then by another one
again      the command on all of them, where nothing is left to do
memory     of a worker, for 20 s and 12 min of one sensor, and for 20 s of the largest

Everything is compared with the hashes of the replay in one process. Exit status 1 if any differs.
FOLDER is made. ``kills`` leaves its archive there, for those after it, and goes on
where it was broken off; it needs 8 GB, as ``memory`` does. ``--few`` takes 12 recordings.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))

import archive_failures as failures  # noqa: E402
from repeated_drives import sweeps_of, write_repeated  # noqa: E402

from lidar_outlier_filter.archive.fingerprints import judging_code  # noqa: E402
from lidar_outlier_filter.archive.hands import ByWhom  # noqa: E402
from lidar_outlier_filter.archive.locations import location_of  # noqa: E402
from lidar_outlier_filter.archive.one_recording import ReplayOrder  # noqa: E402
from lidar_outlier_filter.archive.run import run_alone  # noqa: E402
from lidar_outlier_filter.archive.task import Task  # noqa: E402
from lidar_outlier_filter.archive.workers import local_workers  # noqa: E402
from lidar_outlier_filter.disk.new_files import hidden_folder  # noqa: E402

if TYPE_CHECKING:
    import psutil

PARTS = ('kills', 'scheduler', 'again', 'memory')
ARCHIVE = 200  # recordings
LONG = 720.0  # seconds
MEMORY = (('vlp16_mrpt_mcap', 20.0), ('vlp16_mrpt_mcap', LONG), ('os1_128_db3', 20.0))


def kills(options: argparse.Namespace) -> None:
    """Replay an archive by workers that are killed."""
    expected = _archive(options)
    output = options.folder / 'cleaned'
    for line in failures.with_kills(options.folder / 'drives', output, expected, options.seed):
        print(line)


def _archive(options: argparse.Namespace) -> dict[str, dict[str, str]]:
    """Write the archive where there is none; return the hashes of what is made of it."""
    count = ARCHIVE // 16 if options.few else ARCHIVE
    drives, known = options.folder / 'drives', options.folder / 'expected.json'
    if not known.exists():
        failures.write_archive(options.data, drives, count)
        known.write_text(json.dumps(failures.expected_of(drives, options.folder)))
    expected: dict[str, dict[str, str]] = json.loads(known.read_text())
    return expected


def scheduler(options: argparse.Namespace) -> None:
    """Replay some of it by a cluster whose scheduler is killed."""
    expected = json.loads((options.folder / 'expected.json').read_text())
    for line in failures.without_scheduler(options.folder / 'drives', options.folder, expected):
        print(line)


def again(options: argparse.Namespace) -> None:
    """Run the command where nothing is left to do."""
    for line in failures.done_before(options.folder / 'drives', options.folder / 'cleaned'):
        print(line)


def memory(options: argparse.Namespace) -> None:
    """Print the most memory that a worker and this process take."""
    for name, seconds in MEMORY:
        length = seconds / 12 if options.few else seconds
        drive = write_repeated(
            options.folder / 'long', [sweeps_of(options.data / 'bags' / name)], length
        )
        task = Task(location_of(drive), options.folder / 'out')
        order = ReplayOrder(drop_input=True)
        with local_workers(1) as workers, hidden_folder(task.output) as hidden:
            run_alone(task, order, ByWhom(workers, hidden))
            peaks = [peak(one) for one in failures.worker_processes()]
        size = task.location.size / 1e9
        print(f'{name}, {length:g} s, {size:.2f} GB: a worker {max(peaks):.0f} MB at most')
        shutil.rmtree(drive)
        shutil.rmtree(options.folder / 'out')


def peak(process: psutil.Process) -> float:
    """Return the most memory that a process has taken so far, MB."""
    status = Path(f'/proc/{process.pid}/status').read_text('ascii')
    return int(status.partition('VmHWM:')[2].split()[0]) * 1.024e-3


def main() -> None:
    """Run the parts that are named, or all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('folder', type=Path)
    parser.add_argument(
        'parts', nargs='*', metavar='PART', help=', '.join(PARTS) + '; default: all'
    )
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--few', action='store_true')
    parser.add_argument('--seed', type=int, default=1, help='of the moments of the kills')
    options = parser.parse_args()
    options.folder = options.folder.resolve()
    options.folder.mkdir(exist_ok=True)
    works = dict(zip(PARTS, (kills, scheduler, again, memory), strict=True))
    if unknown := set(options.parts) - set(works):
        parser.error(f'PART must be one of {", ".join(works)}, got {", ".join(unknown)}')
    print(f'code {judging_code()}')
    for name in options.parts or PARTS:
        before, began = used(), perf_counter()
        print(f'\n{name}', flush=True)
        works[name](options)
        print(f'{perf_counter() - began:.0f} s, {used() - before:.0f} s of processors', flush=True)


def used() -> float:
    """Return the processor seconds of this process, and of all that it has waited for."""
    return sum(os.times()[:4])


if __name__ == '__main__':
    main()
