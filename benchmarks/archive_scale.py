# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Many tiny recordings: what each costs the workers, the scheduler and the command, and a store.

    scripts/environment python benchmarks/archive_scale.py FOLDER [--recordings 1000 10000]
        [--workers 2] [--store 10 100 1000]

Each recording has 6 clouds of 120 points: nearly all of its time goes into what an archive adds.
First a cluster of a scheduler and ``--workers`` replays so many, with ``--scheduler``, and the same
command runs again. Then one process replays so many from one bucket of a server of S3 (moto) to the
same. ``FOLDER`` is made, and removed.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

import psutil
from helpers.clusters import cluster
from helpers.drives import FAST, write_drive
from helpers.stores import running_store
from werkzeug.serving import WSGIRequestHandler

from lidar_outlier_filter.archive.manifest import NAME
from lidar_outlier_filter.cli.main import main as command

if TYPE_CHECKING:
    from collections.abc import Iterator

SET = f'--set=chain={json.dumps(FAST["chain"])}'
CLOUDS = 6
IN_A_FOLDER = 1000


def run(*words: str) -> float:
    """Run a command, which must do all; return its seconds."""
    began = perf_counter()
    with redirect_stdout(StringIO()) as out:
        status = command(list(words))
    if status:
        raise SystemExit(f'{words} left with {status}: {out.getvalue()[-500:]}')
    return perf_counter() - began


def used(process: psutil.Process) -> float:
    """Return the processor seconds of a process."""
    times = process.cpu_times()
    return float(times.user + times.system)


def peak(process: psutil.Process) -> float:
    """Return the most memory that a process has taken so far, MB."""
    status = Path(f'/proc/{process.pid}/status').read_text('ascii')
    return int(status.partition('VmHWM:')[2].split()[0]) * 1.024e-3


def by_cluster(folder: Path, number: int, workers: int) -> None:
    """Let so many workers of a cluster replay so many recordings."""
    folder.mkdir()
    tiny = next(write_drive(folder / 'tiny', CLOUDS).glob('*.mcap'))
    drives, output = folder / 'drives', folder / 'cleaned'
    for one in range(number):
        path = drives / f'{one // IN_A_FOLDER:03}' / f'{one:06}.mcap'
        path.parent.mkdir(parents=True, exist_ok=True)
        os.link(tiny, path)
    words = ('replay', str(drives), '--output', str(output), SET)
    with cluster(workers) as (address, scheduler):
        me, others = psutil.Process(), psutil.Process().children(recursive=True)
        first = [one for one in others if one.pid == scheduler.process.pid]
        roles = {
            'command': [me],
            'scheduler': first,
            'workers': [one for one in others if one not in first],
        }
        before = {
            role: (sum(map(used, some)), max(map(peak, some))) for role, some in roles.items()
        }
        elapsed = run(*words, '--scheduler', address)
        print(f'{number} recordings, {workers} workers: {elapsed:.0f} s', flush=True)
        for role, some in roles.items():
            seconds, memory = before[role]
            each = (sum(map(used, some)) - seconds) / number
            most = max(map(peak, some))
            print(
                f'  {role}: {1000 * each:.1f} ms of processor each, '
                f'{most:.0f} MB at most, {memory:.0f} MB before'
            )
    of_command = sum(os.times()[:2])
    again = run(*words, '--jobs', '1')
    of_command = sum(os.times()[:2]) - of_command
    sizes = [(output / name).stat().st_size / 1e6 for name in (NAME, 'archive.html')]
    print(f'  again: {again:.1f} s, {of_command:.1f} s of processor')
    print(f'  manifest {sizes[0]:.1f} MB, page {sizes[1]:.1f} MB', flush=True)
    shutil.rmtree(folder)


@contextmanager
def traffic() -> Iterator[list[tuple[str, int]]]:
    """Note each request of a store: what is asked, and the bytes that are sent with it."""
    seen: list[tuple[str, int]] = []
    plain = WSGIRequestHandler.log_request

    def note(self: Any, *given: Any) -> None:
        length = self.headers.get('x-amz-decoded-content-length') or self.headers['Content-Length']
        seen.append((f'{self.command} {self.path}', int(length or 0)))
        plain(self, *given)

    WSGIRequestHandler.log_request = note  # type: ignore[method-assign]
    try:
        yield seen
    finally:
        WSGIRequestHandler.log_request = plain  # type: ignore[method-assign]


def by_store(folder: Path, numbers: list[int]) -> None:
    """Replay so many from a bucket to the same, and count what the store is asked."""
    folder.mkdir()
    drive = next(write_drive(folder / 'tiny', CLOUDS).glob('*.mcap')).read_bytes()
    with traffic() as seen, running_store() as store:
        for number in numbers:
            bucket = store.new_bucket(f'tiny{number}')
            for one in range(number):
                store.put(f'{bucket}/in/{one:05}.mcap', drive)
            words = ('replay', f'{bucket}/in', '--output', f'{bucket}/out', SET, '--jobs', '1')
            seen.clear()
            seconds = run(*words)
            asked = len(seen)
            noted = [size for text, size in seen if f'/{NAME}' in text or '/.manifest/' in text]
            written = sum('PUT' in text and '.manifest/' in text for text, _ in seen)
            sent = sum(size for _, size in seen)
            seen.clear()
            again = run(*words)
            print(
                f'{number} recordings on a store: {asked:,} requests, {sent:,} bytes sent; of the '
                f'manifest {written:,} objects, {sum(noted):,} bytes; {seconds:.0f} s; '
                f'again {len(seen):,} requests, {again:.1f} s',
                flush=True,
            )
    shutil.rmtree(folder)


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('folder', type=Path)
    parser.add_argument('--recordings', type=int, nargs='*', default=[1000, 10_000])
    parser.add_argument('--workers', type=int, default=2, help='of the cluster')
    parser.add_argument('--store', type=int, nargs='*', default=[10, 100, 1000])
    options = parser.parse_args()
    folder = options.folder.resolve()
    folder.mkdir()
    print(f'load average {os.getloadavg()[0]:.1f} before')
    for number in options.recordings:
        by_cluster(folder / 'local', number, options.workers)
    if options.store:
        by_store(folder / 'store', options.store)
    print(f'load average {os.getloadavg()[0]:.1f} after')
    shutil.rmtree(folder)


if __name__ == '__main__':
    main()
