# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kill runs at moments spread over their time: a program of its own, that has no threads to lose.

``killing.py clean|replay INPUT FOLDER COUNT`` prints what was found, a line for each kill.
"""

import hashlib
import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter, sleep

from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.replay import replay

IMPORTED = Chain  # with all that it needs, before the first fork
VALUES: dict[str, object] = {'chain': ('alpha_beta_gamma',), 'threads': 1}


def start(work: Callable[[], object]) -> int:
    """Begin to work in a process of its own; return its number."""
    process = os.fork()
    if process == 0:
        try:
            work()
        finally:
            os._exit(0)
    return process


def digest(path: Path) -> str:
    """Sum up a file or a folder with all its files."""
    files = sorted(path.rglob('*')) if path.is_dir() else [path]
    return hashlib.sha256(b''.join(file.read_bytes() for file in files)).hexdigest()


def kill(what: str, source: Path, folder: Path, count: int) -> None:
    """Kill so many runs, and run once more after each kill."""
    output = folder / ('out' if source.is_dir() else f'out{source.suffix}')
    if what == 'replay':
        work: Callable[[], object] = partial(replay, source, output, parameters=VALUES)
    else:
        parameters = FilterParameters().changed({'chain': ('sor',), 'threads': 1})
        work = partial(clean_file, source, output, parameters)
    before = digest(source)
    begin = perf_counter()
    os.waitpid(start(work), 0)
    whole = perf_counter() - begin
    expected = content(output)
    remove(folder)
    for i in range(count):
        process = start(work)
        sleep(whole * (i + 0.5) / count)
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        seen = sorted(path.name for path in folder.iterdir())
        torn = [name for name in seen if not name.startswith('.')]
        if torn and (output.name not in torn or content(output) != expected):
            print(f'torn: {torn}')  # noqa: T201
        left = len(seen) - len(torn)
        if not torn:
            os.waitpid(start(work), 0)
        hidden = [path.name for path in folder.iterdir() if path.name.startswith('.')]
        good = (
            content(output) == expected and (bool(torn) or not hidden) and digest(source) == before
        )
        print(f'{"good" if good else "bad"}: {left} left, {"done" if torn else "again"}')  # noqa: T201
        remove(folder)


def content(output: Path) -> str:
    """Sum up an output, without what says when it was made."""
    if not output.exists():
        return ''
    if output.is_dir():
        return digest(next(output.glob('*.mcap')))
    return digest(output)


def remove(folder: Path) -> None:
    """Empty a folder."""
    for path in sorted(folder.rglob('*'), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


if __name__ == '__main__':
    kill(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
