# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Workers: real processes of Dask, killed, poisoned and interrupted, never cost a byte."""

import os
import re
import signal
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from dask import config
from distributed import LocalCluster  # noqa: F401  brings its settings, before a test changes one
from helpers.archives import cleaning, content, hidden, records, replaying, write_clouds
from helpers.clusters import OWN, cluster, signalling, survivors, worker_processes
from helpers.drives import faults_of_a_cloud, write_drive
from helpers.programs import Program

from lidar_outlier_filter.archive import jobs, run
from lidar_outlier_filter.archive import workers as module
from lidar_outlier_filter.archive.workers import Workers, cluster_workers, local_workers
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import SchedulerError

Capture = pytest.CaptureFixture[str]

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings('ignore:.*:ResourceWarning')]


@pytest.fixture(scope='module')
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three recordings of 4 s."""
    folder = tmp_path_factory.mktemp('archive') / 'drives'
    folder.mkdir()
    for number in range(3):
        write_drive(folder / f'drive{number}', 40, seed=100 * number)
    return folder


@pytest.fixture(scope='module')
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write clouds, and an invalid file."""
    folder = write_clouds(tmp_path_factory.mktemp('clouds') / 'in', 12)
    (folder / 'wrong.las').write_bytes(b'LASF')
    return folder


@pytest.fixture(scope='module')
def whole(
    drives: Path, clouds: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[Path, dict[str, bytes]]:
    """Do all in this process."""
    folder = tmp_path_factory.mktemp('whole')
    assert main(replaying(drives, folder / 'drives')) == 0
    assert main(cleaning(clouds, folder / 'clouds')) == 3
    return {drives: content(folder / 'drives'), clouds: content(folder / 'clouds')}


@pytest.fixture(scope='module')
def two() -> Iterator[Workers]:
    """Start two workers of a scheduler that gives up after two deaths: others start slowly."""
    patience = {'distributed.deploy.lost-worker-timeout': '10 minutes'}
    settings = config.set(patience | {'distributed.scheduler.allowed-failures': 1})
    with settings, local_workers(2) as workers:
        yield workers


@pytest.fixture
def scheduler(two: Workers) -> tuple[str, str]:
    """Give the options that let them work."""
    return '--scheduler', two.client.scheduler.address


def check(output: Path, expected: dict[str, bytes]) -> None:
    """Compare outputs with those of this process; nothing hidden is left."""
    assert content(output) == expected
    assert not hidden(output)


def test_workers_give_the_same_bytes(  # noqa: PLR0913  fixtures
    drives: Path,
    clouds: Path,
    whole: dict[Path, dict[str, bytes]],
    scheduler: tuple[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    """Both work; who continues in one process has nothing to do, and refuses the same."""
    monkeypatch.chdir(drives.parent)
    assert main(replaying('drives', tmp_path / 'drives', *scheduler)) == 0
    check(tmp_path / 'drives', whole[drives])
    monkeypatch.chdir(clouds.parent)
    assert main(cleaning('in', tmp_path / 'clouds', *scheduler)) == 3
    check(tmp_path / 'clouds', whole[clouds])
    found = records(tmp_path / 'clouds').values()
    assert len({record.worker for record in found}) == 2
    assert jobs.THIS_PROCESS not in {record.worker for record in found}
    capsys.readouterr()
    assert main(cleaning(clouds, tmp_path / 'clouds')) == 3
    assert '0 cleaned, 12 done before, 1 refused' in capsys.readouterr().out


def test_jobs(drives: Path, whole: dict[Path, dict[str, bytes]], tmp_path: Path) -> None:
    """The command starts workers of its own, which end with it."""
    before = worker_processes()
    assert main(replaying(drives, tmp_path / 'out', '--jobs=2')) == 0
    check(tmp_path / 'out', whole[drives])
    assert jobs.THIS_PROCESS not in {record.worker for record in records(tmp_path / 'out').values()}
    assert worker_processes() == before


def test_a_dry_run(
    clouds: Path, scheduler: tuple[str, str], tmp_path: Path, capsys: Capture
) -> None:
    """It writes nothing; the largest groups come from the workers."""
    found = []
    for options in (scheduler, ()):
        assert main(cleaning(clouds, tmp_path / 'none', '--dry-run', *options)) == 3
        lines = capsys.readouterr().out.splitlines()
        found.append(lines[next(i for i, line in enumerate(lines) if 'rejected points' in line) :])
    assert found[0] == found[1]
    assert not (tmp_path / 'none').exists()


class Poisoned:
    """Cleans a file on a worker; one kills each worker that tries it, one only the first."""

    def __init__(self, folder: Path) -> None:
        """Note in a folder what was tried."""
        self.folder, self.known = folder, run.attempt_on_worker

    def __call__(self, task: jobs.Task, job: jobs.Job, *given: Any) -> Any:
        """Work on a task."""
        tried = self.folder / task.source
        if task.source == '003.csv' or (task.source == '005.csv' and not tried.exists()):
            tried.touch()
            job = replace(job, inspect=die)
        return self.known(task, job, *given)


def die(_judged: object) -> None:
    """Kill this process."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_killed_workers(  # noqa: PLR0913  fixtures
    clouds: Path,
    whole: dict[Path, dict[str, bytes]],
    scheduler: tuple[str, str],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A file whose worker is killed is tried again; one that kills each fails alone."""
    (tmp_path / 'tried').mkdir()
    monkeypatch.setattr(run, 'attempt_on_worker', Poisoned(tmp_path / 'tried'))
    assert main(cleaning(clouds, tmp_path / 'out', *scheduler)) == 3
    expected = {name: data for name, data in whole[clouds].items() if '003' not in name}
    check(tmp_path / 'out', expected)
    said = capsys.readouterr().err
    assert (
        f'the file {clouds / "003.csv"} must be cleaned without a worker that dies, got 2' in said
    )


def test_a_worker_that_does_not_come_back(
    drives: Path, whole: dict[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    """One that Dask gives up is replaced."""
    others = worker_processes()
    patience = config.set({'distributed.deploy.lost-worker-timeout': '1ms'})
    with patience, local_workers(1) as workers:
        next(one for one in worker_processes() if one not in others).kill()
        words = replaying(drives, tmp_path / 'out', '--scheduler', workers.address)
        plain = partial(module.Workers.check)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module.Workers, 'check', lambda own: (workers.keep(), plain(own))[1])
            assert main(words) == 0
    check(tmp_path / 'out', whole[drives])


def test_workers_of_other_code_are_refused(
    clouds: Path,
    scheduler: tuple[str, str],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They do not begin."""
    monkeypatch.setattr(jobs, 'code_version', lambda: '0.0.1+abc')
    assert main(cleaning(clouds, tmp_path / 'out', *scheduler)) == 1
    assert 'must be of version 0.0.1+abc' in capsys.readouterr().err
    assert not content(tmp_path / 'out')


def test_a_cluster_that_runs(
    drives: Path, whole: dict[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    """When its scheduler goes, what is done stays done; it may be found by its file."""
    words = replaying(drives, tmp_path / 'out')
    with cluster() as (address, scheduler):
        words = replaying(drives, tmp_path / 'out', '--scheduler', address)
        with signalling(signal.SIGKILL, scheduler.pid, 2, words) as one:
            status, said = one.wait(), '\n'.join(one.output)
    assert status == 1
    assert f'the scheduler {address} must be there until the end, got no response' in said
    assert 'Traceback' not in said
    before = len(records(tmp_path / 'out'))
    assert before >= 2
    assert main(replaying(drives, tmp_path / 'out')) == 0
    check(tmp_path / 'out', whole[drives])


def test_a_cluster_of_a_file(
    two: Workers, drives: Path, whole: dict[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    """A scheduler that wrote its address to a file is found by it."""
    path = tmp_path / 'scheduler.json'
    two.client.write_scheduler_file(str(path))
    assert main(replaying(drives, tmp_path / 'out', f'--scheduler-file={path}')) == 0
    check(tmp_path / 'out', whole[drives])


def test_a_cluster_without_workers(drives: Path, tmp_path: Path) -> None:
    """A run says that it waits for one."""
    with cluster(0) as (address, _):
        words = replaying(drives, tmp_path / 'out', '--scheduler', address)
        with Program('-P', '-m', 'lidar_outlier_filter.cli.main', *words) as one:
            one.wait_for('the cluster has no worker: waiting for one')


def test_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    """An address where nothing responds is refused."""
    monkeypatch.setattr(module, 'MAX_WAIT_S', 0.5)
    with pytest.raises(SchedulerError, match='--scheduler must be that of a Dask scheduler'):
        cluster_workers('tcp://127.0.0.1:9').__enter__()


def test_ctrl_c_stops_and_continues(
    drives: Path, whole: dict[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    """No process and nothing hidden is left; the next run does the rest."""
    words = replaying(drives, tmp_path / 'out', '--jobs=2')
    with signalling(signal.SIGINT, OWN, 1, words) as one:
        status, said = one.wait(), '\n'.join(one.output)
    assert (status, 'Traceback' in said) == (130, False), said
    workers = [int(n) for line in one.output if re.fullmatch(r'[\d ]+', line) for n in line.split()]
    assert workers
    assert not survivors(workers)
    assert content(tmp_path / 'out').items() <= whole[drives].items()
    assert not hidden(tmp_path / 'out')
    assert main(replaying(drives, tmp_path / 'out')) == 0
    check(tmp_path / 'out', whole[drives])


def test_workers_keep_memory(two: Workers) -> None:
    """The memory of one cloud serves the next, and the command goes first."""
    faults, nice = two.client.submit(measure, pure=False).result()
    assert faults < 1000  # of 10 000 pages
    assert nice == min(19, os.nice(0) + module.NICENESS)


def measure() -> tuple[int, int]:
    """Count page faults of a cloud, and say how nice this process is."""
    return faults_of_a_cloud(), os.nice(0)
