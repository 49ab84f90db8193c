# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""An archive whose workers are killed, whose scheduler goes away, and that is done already."""

# ruff: noqa: INP001  a module of scripts, in no package

from __future__ import annotations

import json
import os
import random
import shutil
import signal
from dataclasses import dataclass, field
from time import perf_counter
from typing import TYPE_CHECKING

from helpers.clusters import COMMAND, cluster, program, worker_processes
from helpers.drives import hashes
from repeated_drives import sweeps_of, write_repeated

from lidar_outlier_filter.archive.hands import ByWhom
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.manifest import NAME, opened_manifest
from lidar_outlier_filter.archive.one_recording import ReplayOrder
from lidar_outlier_filter.archive.run import pending, run_all
from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.archive.workers import local_workers
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.disk.new_files import hidden_folder
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from lidar_outlier_filter.archive.step import Step

SENSORS = ('vlp16_mrpt_mcap', 'hdl32_mrpt_mcap', 'vlp32_nebula_db3', 'os0_32.bag')
LENGTH = 20.0  # seconds of a recording
SECTOR = 22.0  # degrees of each sweep that is kept
KILLS = 10
LAST = 0.95  # of the bytes: a kill after the last message would be none
CHAIN = {'chain': ['alpha_beta_gamma']}
SOME = 6  # recordings, for the cluster
SET = f'--set=chain={json.dumps(CHAIN["chain"])}'
APART = 3600 * SECOND  # from the beginning of one recording to that of the next


def write_archive(data: Path, drives: Path, count: int) -> None:
    """Write recordings of several sensors, each of another sector and an hour later."""
    drives.mkdir()
    sensors = [sweeps_of(data / 'bags' / name) for name in SENSORS]
    for number in range(count):
        sweeps = sensors[number % len(sensors)].sector(360 * number / count, SECTOR)
        begin = 1_750_000_000 * SECOND + number * APART
        write_repeated(drives / f'drive{number:03}', [sweeps], LENGTH, begin, poses=False)


def expected_of(drives: Path, folder: Path) -> dict[str, dict[str, str]]:
    """Replay each recording by itself, in this process; keep the hashes only."""
    found = {}
    alone = folder / 'alone'
    alone.mkdir()
    for path in sorted(drives.iterdir()):
        replay(path, alone / path.name, parameters={**CHAIN, 'threads': 1})
        found[path.name] = hashes(alone / path.name)
        shutil.rmtree(alone / path.name)
    return found


@dataclass
class Killer:
    """Kills a worker at each of some random moments, in bytes of the archive that are done."""

    moments: list[float]
    rng: random.Random
    killed: list[int] = field(default_factory=list)

    def __call__(self, step: Step) -> None:
        """Kill a worker if a moment has come."""
        if self.moments and step.bytes_done >= self.moments[0]:
            del self.moments[0]
            process = self.rng.choice(worker_processes())
            process.send_signal(signal.SIGKILL)
            self.killed.append(process.pid)


def with_kills(
    drives: Path, output: Path, expected: dict[str, dict[str, str]], seed: int
) -> Iterator[str]:
    """Replay all with two workers, of which one is killed again and again; say what is there."""
    order = ReplayOrder(parameters=CHAIN)
    tasks = [Task(location_of(path), output / path.name) for path in sorted(drives.iterdir())]
    rng = random.Random(seed)  # noqa: S311  no secret
    total = sum(task.location.size for task in tasks)
    killer = Killer(sorted(rng.uniform(0, LAST * total) for _ in range(KILLS)), rng)
    with (
        opened_manifest(output) as manifest,
        hidden_folder(output / 'recordings') as hidden,
        local_workers(2) as workers,
    ):
        todo = pending(tasks, order, manifest)
        entries = run_all(todo, order, manifest, ByWhom(workers, hidden, killer))
    made = made_in(output)
    sources = [json.loads(line)['source'] for line in (output / NAME).read_text().splitlines()]
    done = sum(entry.state == 'done' for entry in entries)
    other = sum(made.get(name) != known for name, known in expected.items())
    twice = len(sources) - len(set(sources))
    yield f'{len(killer.killed)} workers killed, {len(tasks)} recordings: {done} done'
    yield f'{other} with other bytes or lost, {len(made) - len(expected)} too many, {twice} twice'
    if other or twice or len(made) != len(expected) or len(killer.killed) != KILLS:
        raise SystemExit('workers that are killed must cost their recordings only')


def made_in(output: Path) -> dict[str, dict[str, str]]:
    """Hash all outputs."""
    return {path.name: hashes(path) for path in sorted(output.iterdir()) if path.is_dir()}


def without_scheduler(
    drives: Path, folder: Path, expected: dict[str, dict[str, str]]
) -> Iterator[str]:
    """Replay some by a cluster whose scheduler is killed in the middle, then by another one."""
    some = drives / f'drive00[0-{SOME - 1}]'
    output = folder / 'by_cluster'
    words = ('replay', str(some), '--output', str(output), SET)
    with (
        cluster(2) as (address, scheduler),
        program('-m', COMMAND, *words, '--scheduler', address) as one,
    ):
        one.until(f': {SOME // 2 + 1} of {SOME}')
        scheduler.kill()
        status, said = one.rest()
    last = said.strip().splitlines()[-1]
    left = made_in(output)
    yield f'scheduler killed: exit status {status}, "{last}"'
    yield f'{len(left)} of {SOME} were done'
    with cluster(2) as (address, _), program('-m', COMMAND, *words, '--scheduler', address) as one:
        again, said = one.rest()
    made = made_in(output)
    other = sum(made.get(name) != expected[name] for name in sorted(expected)[:SOME])
    yield f'with another one: exit status {again}, {len(made)} are done, {other} with other bytes'
    torn = any(found != expected[name] for name, found in left.items())
    if (status, again, other) != (1, 0, 0) or torn or 'Traceback' in last:
        raise SystemExit('a scheduler that goes away must cost what is under way only')


def done_before(drives: Path, output: Path) -> Iterator[str]:
    """Time the command where nothing is left to do."""
    words = ('replay', str(drives), '--output', str(output), SET)
    took, used = [], []
    for _ in range(3):
        before, began = os.times(), perf_counter()
        with program('-m', COMMAND, *words) as one:
            _, said = one.rest()
        took.append(perf_counter() - began)
        after = os.times()
        used.append(sum(after[2:4]) - sum(before[2:4]))
    count = len([*drives.iterdir()])
    yield said.strip().splitlines()[-1]
    yield (
        f'{min(took):.2f} s for {count} recordings with the start of the process, '
        f'{min(used):.2f} s of a processor: {100 * min(took) / count:.2f} s for a hundred'
    )
