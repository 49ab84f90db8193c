# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Workers: real processes of Dask, killed, poisoned and interrupted, never cost a byte."""

from __future__ import annotations

import json
import os
import shutil
import signal
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pytest
from dask import config
from distributed import LocalCluster  # noqa: F401  brings its settings, before a test changes one
from helpers.clusters import (
    OWN,
    cluster,
    signalling,
    survivors,
    worker_processes,
)
from helpers.drives import FAST, die_at_first, die_of, faults_of_a_cloud, hashes, write_drive
from lidar_outlier_filter.archive.hands import ByWhom
from lidar_outlier_filter.archive.manifest import opened_manifest
from lidar_outlier_filter.archive.one_recording import ReplayOrder
from lidar_outlier_filter.archive.task import Task

from lidar_outlier_filter.archive import hands, worker_start
from lidar_outlier_filter.archive import workers as module
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.run import pending, run_all, run_alone
from lidar_outlier_filter.archive.workers import cluster_workers, local_workers
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.disk.new_files import hidden_folder
from lidar_outlier_filter.errors import RecordingError, SchedulerError
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from lidar_outlier_filter.archive.manifest import Entry
    from lidar_outlier_filter.archive.step import Step

    from lidar_outlier_filter.archive.workers import Workers

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings('ignore:.*:ResourceWarning')]
SET = f'--set=chain={json.dumps(FAST["chain"])}'
NICEST = 19  # of what the system has; who is that already, as beside other work, stays so


@pytest.fixture(scope='module')
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three recordings of 4 s."""
    folder = tmp_path_factory.mktemp('archive') / 'drives'
    folder.mkdir()
    for number in range(3):
        write_drive(folder / f'drive{number}', 40, seed=100 * number)
    return folder


@pytest.fixture(scope='module')
def expected(drives: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """Replay them in this process, each by itself."""
    made = {}
    for path in sorted(drives.iterdir()):
        output = tmp_path_factory.mktemp('alone') / path.name
        assert main(['replay', str(path), '--output', str(output), '--jobs', '1', SET]) == 0
        made[path.name] = hashes(output)
    return made


@pytest.fixture
def three() -> Iterator[Workers]:
    """Start three workers: of those that another test has killed, not all come back."""
    with local_workers(3) as workers:
        yield workers


def ignore(_step: Step) -> None:
    """Show nothing."""


def run(
    drives: Path, output: Path, workers: Workers | None, show: Callable[[Step], object] = ignore
) -> list[Entry]:
    """Replay what is pending of an archive; without workers, in this process."""
    order = ReplayOrder(parameters=FAST)
    tasks = [Task(location_of(path), output / path.name) for path in sorted(drives.iterdir())]
    with opened_manifest(output) as manifest, hidden_folder(output / 'recordings') as hidden:
        todo = pending(tasks, order, manifest)
        entries = run_all(todo, order, manifest, ByWhom(workers, hidden, show))
    assert not any(path.name.startswith('.') for path in output.iterdir())
    return entries


def made(output: Path) -> dict[str, dict[str, str]]:
    """Hash all outputs."""
    return {path.name: hashes(path) for path in sorted(output.iterdir()) if path.is_dir()}


def test_three_workers_give_the_same_bytes(
    drives: Path, expected: dict[str, Any], tmp_path: Path, three: Workers
) -> None:
    """Each replays a whole one; the manifest is that of one process; again, nothing is to do."""
    found = run(drives, tmp_path / 'out', three)
    assert made(tmp_path / 'out') == expected
    assert len({entry.worker for entry in found}) == 3
    alone = run(drives, tmp_path / 'alone', None)
    assert made(tmp_path / 'alone') == expected
    apart = {'output', 'output_state', 'worker', 'seconds', 'finished'}
    for one, other in zip(found, alone, strict=True):
        left, right = asdict(one), asdict(other)
        assert {k: v for k, v in left.items() if k not in apart} == {
            k: v for k, v in right.items() if k not in apart
        }
    assert run(drives, tmp_path / 'out', three) == []


def test_killed_workers_cost_their_recordings(
    drives: Path,
    expected: dict[str, Any],
    tmp_path: Path,
    three: Workers,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """SIGKILL in the middle of each: every recording is there once, byte for byte."""
    monkeypatch.setattr(hands, 'make_on_worker', die_at_first)
    entries = run(drives, tmp_path / 'out', three)
    assert len(list(tmp_path.glob('*.again'))) == 3
    assert [entry.state for entry in entries] == ['done'] * 3
    assert made(tmp_path / 'out') == expected


def test_a_damaged_recording_fails_alone(
    drives: Path, expected: dict[str, Any], tmp_path: Path, three: Workers
) -> None:
    """With the sentence of the worker that was to replay it."""
    copied = tmp_path / 'drives'
    shutil.copytree(drives, copied)
    file = copied / 'drive1' / 'drive1.mcap'
    file.write_bytes(file.read_bytes()[:-1000])
    entries = run(copied, tmp_path / 'out', three)
    assert [entry.state for entry in entries] == ['done', 'failed', 'done']
    assert 'drive1 must be readable, got' in str(entries[1].error)
    assert made(tmp_path / 'out') == {name: expected[name] for name in ('drive0', 'drive2')}


def test_workers_that_cannot_write_there(drives: Path, tmp_path: Path, three: Workers) -> None:
    """Each recording fails with the folder and the worker."""
    gone = tmp_path / 'gone'
    task = Task(location_of(drives / 'drive0'), tmp_path / 'out')
    with pytest.raises(RecordingError, match=f'{gone} must be a folder that .* can write to, got'):
        run_alone(task, ReplayOrder(parameters=FAST), ByWhom(three, gone))


def test_workers_keep_memory_and_leave_the_writer_first(three: Workers) -> None:
    """A cloud's memory is there for the next; who writes has the processor when it can go on."""
    faults = three.client.submit(faults_of_a_cloud, pure=False).result()
    assert faults < 1000  # of 10 000 pages
    nice = min(os.nice(0) + worker_start.NICER, NICEST)
    assert list(three.client.run(os.nice, 0).values()) == [nice] * 3


def test_workers_of_other_code_are_refused(
    drives: Path, tmp_path: Path, three: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever they judge; in one sentence that says both versions."""
    monkeypatch.setattr(hands, 'judging_code', lambda _judge: '0.0.1+abc')
    with pytest.raises(SchedulerError, match=r'the worker .* must be of version 0\.0\.1\+abc'):
        run(drives, tmp_path, three)


def test_one_worker_that_never_comes_back(drives: Path, tmp_path: Path) -> None:
    """Another one is started where Dask has given up on one that died; its bytes are the same."""
    patience = config.set({'distributed.deploy.lost-worker-timeout': '1ms'})
    with patience, local_workers(1) as workers:
        check_moving(drives / 'drive2', tmp_path, workers, worker_processes()[0].kill)


def test_a_recording_that_kills_its_workers(
    drives: Path,
    expected: dict[str, Any],
    tmp_path: Path,
    three: Workers,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It fails alone, with a sentence; none that was beside it does."""
    monkeypatch.setattr(hands, 'make_on_worker', die_of)
    entries = run(drives, tmp_path / 'out', three)
    assert [entry.state for entry in entries] == ['done', 'failed', 'done']
    assert 'must be judged without a worker that dies, got 4 that died' in str(entries[1].error)
    assert made(tmp_path / 'out') == {name: expected[name] for name in ('drive0', 'drive2')}


def check_moving(
    drive: Path, folder: Path, workers: Workers, first: Callable[[], object] = lambda: None
) -> None:
    """Compare the bytes by message and moving with those of this process; do something first."""
    given = {**FAST, 'motion.source': 'odometry', 'blocks': 'auto'}
    task = Task(location_of(drive), folder / 'bag')
    first()
    with hidden_folder(folder / 'bag') as hidden:
        run_alone(task, ReplayOrder(parameters=given), ByWhom(workers, hidden))
    (folder / 'alone').mkdir()
    replay(drive, folder / 'alone' / 'bag', parameters=given)
    assert hashes(folder / 'bag') == hashes(folder / 'alone' / 'bag')


def test_moving(drives: Path, tmp_path: Path, three: Workers) -> None:
    """Three give the same bytes, too, by message and moving."""
    check_moving(drives / 'drive2', tmp_path, three)


def test_a_cluster_that_runs(drives: Path, expected: dict[str, Any], tmp_path: Path) -> None:
    """Its workers give the same bytes; when its scheduler goes, what is done stays done."""
    words = ('replay', str(drives), '--output', str(tmp_path / 'out'), SET)
    alone = ('replay', str(drives / 'drive2'), '--output', str(tmp_path / 'drive2'), SET)
    with cluster() as (address, scheduler):
        assert main([*alone, '--scheduler', address]) == 0
        given = (*words, '--scheduler', address)
        with signalling(signal.SIGKILL, scheduler.process.pid, 2, given) as one:
            status, said = one.rest()
    assert hashes(tmp_path / 'drive2') == expected['drive2']
    assert status == 1
    assert f'the scheduler {address} must be there until the end, got no answer any more' in said
    assert 'Traceback' not in said
    done = made(tmp_path / 'out')
    assert done == {name: expected[name] for name in ('drive0', 'drive1')}
    assert main([*words, '--jobs', '1']) == 0
    assert made(tmp_path / 'out') == expected


def test_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    """An address where nobody answers is refused."""
    monkeypatch.setattr(module, 'PATIENCE', 0.5)
    with pytest.raises(SchedulerError, match='--scheduler must be that of a Dask scheduler'):
        cluster_workers('tcp://127.0.0.1:9').__enter__()


def test_ctrl_c_stops_and_goes_on(drives: Path, expected: dict[str, Any], tmp_path: Path) -> None:
    """No process and no torn output is left; the next run does the rest."""
    words = ('replay', str(drives), '--output', str(tmp_path), SET, '--jobs')
    with signalling(signal.SIGINT, OWN, 1, (*words, '2')) as one:
        status, said = one.rest()
    assert (status, 'Traceback' in said) == (130, False), said
    workers = [int(word) for word in said.splitlines()[-1].split()]
    assert workers
    assert not survivors(workers)
    left = made(tmp_path)
    assert 1 <= len(left) < 3
    assert all(hashed == expected[name] for name, hashed in left.items())
    assert main([*words, '1']) == 0
    assert made(tmp_path) == expected
