# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Many small clouds that one call of `clean` cleans, a call that ends itself, and what is left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.archive.hands import make_on_worker
from lidar_outlier_filter.archive.manifest import NAME

if TYPE_CHECKING:
    from pathlib import Path

    from lidar_outlier_filter.archive.one_file import CleanOrder, FileTask
    from lidar_outlier_filter.archive.order import Made
    from lidar_outlier_filter.errors import FilterError
    from lidar_outlier_filter.files.judged_file import JudgedFile

# Sends itself a signal when so many files are done.
PROGRAM = """
import os, sys
from lidar_outlier_filter.archive import run
from lidar_outlier_filter.cli.main import main
number, last, *arguments = sys.argv[1:]
plain, done = run._Run.end, []
def end(*given):
    plain(*given)
    done.append(given)
    if len(done) == int(last):
        os.kill(os.getpid(), int(number))
run._Run.end = end
sys.exit(main(arguments))
"""


def write_clouds(folder: Path, count: int) -> list[str]:
    """Write small clouds, each with a point above it; return their paths."""
    rng = np.random.default_rng(1)
    for number in range(count):
        xyz = rng.uniform((0.0, 0.0, 0.0), (5.0, 5.0, 0.02), (60, 3))
        xyz[number % 60, 2] = 30.0
        np.savetxt(
            folder / f'{number:03}.csv', xyz, '%.3f', delimiter=',', header='x,y,z', comments=''
        )
    return [str(path) for path in sorted(folder.iterdir())]


def arguments(clouds: list[str], folder: Path, *options: str) -> list[str]:
    """Return the arguments that clean some clouds into a folder."""
    return ['clean', *clouds, '--output', str(folder), '--chain', 'sor', *options]


def broken_off(words: list[str], number: signal.Signals, last: int) -> tuple[int, str]:
    """Run a command that ends itself by a signal after so many files.

    Return the status, and what it says but for how far it is.
    """
    command = [sys.executable, '-c', PROGRAM, str(int(number)), str(last), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stderr.splitlines(keepends=True)
    return done.returncode, ''.join(line for line in lines if not line.startswith('cleaning: '))


def content(folder: Path) -> dict[str, bytes]:
    """Read the clouds in a folder; logs have times."""
    return {path.name: path.read_bytes() for path in folder.glob('*.csv')}


def hidden(folder: Path) -> list[str]:
    """List what is hidden in a folder."""
    return [path.name for path in folder.iterdir() if path.name.startswith('.')]


def entries(folder: Path) -> list[dict[str, Any]]:
    """Read what the manifest says last of each file, by their names."""
    lines = (folder / NAME).read_text('utf-8').splitlines()
    found = {entry['source']: entry for entry in map(json.loads, lines)}
    return [found[name] for name in sorted(found)]


def states(folder: Path) -> list[str]:
    """List the state of each file, or why there is none, sorted."""
    return sorted(str(entry['error'] or entry['state']) for entry in entries(folder))


def die_of(
    task: FileTask, order: CleanOrder, folder: Path, prefix: str, topic: str
) -> Made | FilterError:
    """Clean a file on a worker; one kills each that tries, another one the first that does."""
    first = not list(folder.glob(f'{prefix}*'))
    if task.path.stem == '003' or (task.path.stem == '005' and first):
        order = replace(order, look=kill)
    return make_on_worker(task, order, folder, prefix, topic)


def kill(_judged: JudgedFile) -> None:
    """End this process in the middle of a file."""
    os.kill(os.getpid(), signal.SIGKILL)
