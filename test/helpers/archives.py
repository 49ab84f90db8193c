# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Archives for tests: small inputs, commands, a command that kills itself, records for pages."""

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from helpers.drives import FAST, write_drive
from lidar_outlier_filter.archive.sidecar import FAILED, ArchiveRecord, read_folder

SET = f'--set=chain={json.dumps(FAST["chain"])}'
# Sends a group of processes a signal when so many tasks are done, after it has named its children:
# what the signal finds under way does not depend on the machine.
SIGNALLING = """
import os, sys
import psutil
from lidar_outlier_filter.archive import run
from lidar_outlier_filter.cli.main import main
number, group, last, *arguments = sys.argv[1:]
plain, done = run.Progress.finish, []
def finish(*given):
    plain(*given)
    done.append(given)
    if len(done) == int(last):
        print(*(one.pid for one in psutil.Process().children(recursive=True)), flush=True)
        os.killpg(int(group), int(number))
run.Progress.finish = finish
sys.exit(main(arguments))
"""


def write_drives(folder: Path) -> Path:
    """Write two recordings: a folder, and a lone file in a folder of its own."""
    (folder / 'tuesday').mkdir(parents=True)
    write_drive(folder / 'first', 6, seed=1)
    second = write_drive(folder / 'tuesday' / 'x', 6, seed=2)
    (second / 'x.mcap').rename(folder / 'tuesday' / 'second.mcap')
    shutil.rmtree(second)
    return folder


def write_clouds(folder: Path, count: int) -> Path:
    """Write small clouds, each with a point above it."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(1)
    for number in range(count):
        xyz = rng.uniform((0.0, 0.0, 0.0), (5.0, 5.0, 0.02), (60, 3))
        xyz[number % 60, 2] = 30.0
        path = folder / f'{number:03}.csv'
        np.savetxt(path, xyz, '%.3f', delimiter=',', header='x,y,z', comments='')
    return folder


def replaying(drives: Path | str, output: Path | str, *options: str) -> list[str]:
    """Return the arguments that replay an archive, by one process unless options say more."""
    jobs = [] if any(one.startswith(('--jobs', '--sched')) for one in options) else ['--jobs=1']
    return ['replay', str(drives), '--output', str(output), *jobs, SET, *options]


def cleaning(clouds: Path | str, output: Path | str, *options: str) -> list[str]:
    """Return the arguments that clean a folder of clouds."""
    return ['clean', str(clouds), '--output', str(output), '--chain', 'sor', *options]


def command_of(verb: str, folder: Path) -> list[str]:
    """Write two inputs to ``folder/in``; return a command that makes their outputs in ``out``."""
    source, output = folder / 'in', folder / 'out'
    if verb == 'replay':
        write_drives(source)
        return replaying(source, output)
    write_clouds(source, 2)
    return cleaning(source, output, '--rejected', 'separate')


def signalled(words: list[str], number: signal.Signals, last: int) -> tuple[int, str]:
    """Run a command that sends itself a signal after so many tasks; return status and stderr."""
    command = [sys.executable, '-c', SIGNALLING, str(int(number)), '0', str(last), *words]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, start_new_session=True
    )
    return done.returncode, done.stderr


def records(folder: Path) -> dict[str, ArchiveRecord]:
    """Read the sidecars of a folder by the names of their sources."""
    return {record.source: record for record in read_folder(folder)}


def content(folder: Path) -> dict[str, bytes]:
    """Read the outputs below a folder; sidecars and the page have times."""
    found = (path for path in folder.rglob('*') if path.suffix in {'.mcap', '.yaml', '.csv'})
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def tree(folder: Path) -> dict[str, object]:
    """Describe all that is in a folder, hidden files too."""
    return {
        str(path.relative_to(folder)): path.readlink()
        if path.is_symlink()
        else path.read_bytes()
        if path.is_file()
        else None
        for path in sorted(folder.rglob('*'))
    }


def hidden(folder: Path) -> list[str]:
    """List what is hidden below a folder."""
    return [path.name for path in folder.rglob('.*')]


def record(name: str, **changes: Any) -> ArchiveRecord:
    """Make the record of a usual recording of 20 s; ``changes`` are of counts or of the record."""
    counts: dict[str, Any] = {
        'messages': 200,
        'points': 1_000_000,
        'rejected': 2000,
        'untested': 100,
        'refused': 0,
        'gaps': 0,
        'rejected_by': {'boosted_trees': 1500, 'sor': 700},
        'untested_because': '',
    }
    own = {key: value for key, value in changes.items() if key not in counts}
    counts.update((key, value) for key, value in changes.items() if key in counts)
    values: dict[str, Any] = {
        'source': name,
        'size': 50_000_000,
        'output': f'out/{name}',
        'source_state': '',
        'parameters': '0123456789abcdef',
        'code': '1.0.0+abc',
        'finished': '2026-03-01T12:30:15+00:00',
        'state': 'done',
        'seconds': 5.0,
        'duration': 20.0,
        'topics': {'/lidar': counts},
    }
    return ArchiveRecord(**values | own)


def failed(name: str, error: str) -> ArchiveRecord:
    """Make the record of a recording without an output."""
    return replace(record(name), state=FAILED, error=error, duration=0.0, topics={})


def archive(count: int) -> list[ArchiveRecord]:
    """Make an archive of usual recordings, and one of each oddness among the first."""
    rng = np.random.default_rng(1)
    found = []
    for number in range(count):
        boosted_trees, sor = rng.poisson(1500), rng.poisson(700)
        by = {'boosted_trees': int(boosted_trees), 'sor': int(sor)}
        rejected = int(boosted_trees + sor - 200)
        name = f's3://drives/2026-03/{number:04}.mcap'
        found.append(record(name, rejected=rejected, rejected_by=by))
    changes: Iterable[dict[str, Any]] = [
        {'rejected': 21_000, 'rejected_by': {'boosted_trees': 1500, 'sor': 20_000}},
        {'refused': 3},
        {'gaps': 5},
        {'unread': 17},
        {'untested': 1_000_000, 'untested_because': 'lof needs more points', 'rejected': 0},
        {'lost': ['a chunk at byte 7 is cut off', 'another one']},
        {'rejected': 0, 'rejected_by': {'boosted_trees': 0, 'sor': 0}},
    ]
    for number, change in enumerate(changes):
        found[5 * number + 3] = record(found[5 * number + 3].source, **change)
    sentence = 'the recording <b>.mcap must be readable, got "an end at byte 7 without a footer"'
    found[5] = failed(found[5].source, sentence)
    return found
