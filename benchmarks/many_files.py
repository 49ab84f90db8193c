# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Real clouds cut into many files, cleaned by one call that is ended twice, and goes on each time.

    scripts/environment python benchmarks/many_files.py [--files 100]

The first run ends itself by SIGINT when 31 files are done, the second by SIGKILL after 66, the
third does the rest: once by threads, once by two workers, of which one is killed meanwhile. Each
output is compared with that of a run that nothing ends. The exit status is 1 if one differs, is
missing, was made twice, or anything else is left in the folder.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import signal
import sys
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer
from typing import TYPE_CHECKING

TESTS = Path(__file__).resolve().parents[1] / 'test'
sys.path.insert(0, str(TESTS))

import laspy  # noqa: E402
import numpy as np  # noqa: E402
from helpers.clusters import worker_processes  # noqa: E402  after the path is known
from helpers.many_clouds import broken_off, entries, hidden  # noqa: E402  after the path is known

from lidar_outlier_filter.archive.workers import local_workers  # noqa: E402
from lidar_outlier_filter.cli.main import main as command  # noqa: E402

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from lidar_outlier_filter.archive.workers import Workers

DATA = Path(__file__).resolve().parents[2] / 'shared' / 'data' / 'clouds'
REAL = (
    'autzen_trim.laz',
    'sample_lareunion_epsg2975.laz',
    'test_semis_2021_0382_6565_LA93_IGN69_cropped.laz',
    'plane.laz',
)
POINTS = 4000  # of a cut
FIRST, SECOND = 31, 66  # files that are done when a run is ended
KILL_AFTER = 3.0  # seconds from the start of the second run to the death of a worker


def cut(folder: Path, count: int) -> list[str]:
    """Cut squares out of real clouds, each around a point at random; return the paths."""
    clouds = [laspy.read(DATA / name) for name in REAL]
    rng = np.random.default_rng(5)
    for number in range(count):
        cloud = clouds[number % len(clouds)]
        xy = np.column_stack([cloud.x, cloud.y])
        away = np.abs(xy - xy[rng.integers(len(xy))]).max(axis=1)
        made = laspy.LasData(cloud.header)
        made.points = cloud.points[away <= np.partition(away, POINTS)[POINTS]]
        made.write(folder / f'cut{number:03}.{"laz" if number % 3 else "las"}')
    return [str(path) for path in sorted(folder.iterdir())]


def content(folder: Path) -> dict[str, bytes]:
    """Read the clouds in a folder; logs have times."""
    return {path.name: path.read_bytes() for path in folder.glob('*.la[sz]')}


def kill_one() -> None:
    """Kill a worker."""
    worker_processes()[0].kill()


def stamps(folder: Path) -> dict[str, int]:
    """Say of each output that the manifest calls done when it was written."""
    done = [entry['output'] for entry in entries(folder) if entry['state'] == 'done']
    return {output: (folder / output).stat().st_mtime_ns for output in done}


def broken_twice(words: list[str], folder: Path, workers: Workers | None) -> list[int]:
    """Run a command that is ended twice; return how many files were done after each run."""
    again, done = [*words, '--resume'], []
    statuses = [broken_off(words, signal.SIGINT, FIRST)[0]]
    done.append(stamps(folder))
    if workers is not None:
        Timer(KILL_AFTER, kill_one).start()
    statuses.append(broken_off(again, signal.SIGKILL, SECOND - len(done[0]))[0])
    done.append(stamps(folder))
    statuses.append(command(again))
    done.append(stamps(folder))
    twice = [name for name, time in {**done[0], **done[1]}.items() if done[-1].get(name) != time]
    counts = [len(one) for one in done]
    print(f'exit statuses {statuses}, done {counts}, twice {twice}', flush=True)
    return [0] if twice else counts


def check(clouds: list[str], folder: Path, expected: dict[str, bytes], *, remote: bool) -> bool:
    """Let threads, or workers, clean all; return whether all is as if nothing had ended it."""
    context: AbstractContextManager[Workers | None] = local_workers(2) if remote else nullcontext()
    with context as workers:
        words = ['clean', *clouds, '--output', str(folder)]
        if workers is not None:
            words += ['--scheduler', workers.client.scheduler.address]
        done = broken_twice(words, folder, workers)
    made = content(folder)
    equal = sum(made.get(name) == data for name, data in expected.items())
    extra = sorted(set(made) - set(expected)) + hidden(folder)
    print(f'{"workers" if remote else "threads"}: {equal} of {len(expected)} equal, left {extra}')
    return equal == len(expected) == done[-1] and not extra


def main() -> int:
    """Clean all three times."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0] if __doc__ else '')
    parser.add_argument('--files', type=int, default=100)
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        source, *folders = (Path(name, one) for one in ('cuts', 'whole', 'threads', 'workers'))
        source.mkdir()
        clouds = cut(source, options.files)
        if command(['clean', *clouds, '--output', str(folders[0])]):
            return 1
        expected = content(folders[0])
        good = [
            check(clouds, folder, expected, remote=i > 0) for i, folder in enumerate(folders[1:])
        ]
    return int(not all(good))


if __name__ == '__main__':
    sys.exit(main())
