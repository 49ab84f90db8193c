# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Files that workers clean: real processes of Dask, killed and poisoned, never cost a byte."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from dask import config
from distributed import LocalCluster  # noqa: F401  brings its settings, before a test changes one
from helpers.clusters import cluster
from helpers.many_clouds import (
    arguments,
    broken_off,
    content,
    die_of,
    entries,
    hidden,
    states,
    write_clouds,
)

from lidar_outlier_filter.archive import hands
from lidar_outlier_filter.archive.workers import local_workers
from lidar_outlier_filter.cli.main import main

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_filter.archive.workers import Workers

    Capture = pytest.CaptureFixture[str]

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings('ignore:.*:ResourceWarning')]
COUNT, LAST = 24, 9


@pytest.fixture(scope='module')
def clouds(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Write clouds, and a file that is none."""
    folder = tmp_path_factory.mktemp('clouds')
    write_clouds(folder, COUNT)
    (folder / 'wrong.las').write_bytes(b'LASF')
    return [str(path) for path in sorted(folder.iterdir())]


@pytest.fixture(scope='module')
def by_threads(clouds: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clean all by threads of this process."""
    folder = tmp_path_factory.mktemp('threads')
    assert main(arguments(clouds, folder, '--jobs', '2')) == 3
    return folder


@pytest.fixture(scope='module')
def two() -> Iterator[Workers]:
    """Start two workers, of a scheduler that gives up on what two died of: others start slowly."""
    with (
        config.set({'distributed.scheduler.allowed-failures': 1}),
        local_workers(2) as workers,
    ):
        yield workers


@pytest.fixture
def scheduler(two: Workers) -> tuple[str, str]:
    """Give the options that let them clean."""
    return '--scheduler', two.client.scheduler.address


def check(folder: Path, by_threads: Path, lost: tuple[str, ...] = ()) -> None:
    """Compare a folder with that of the threads; some files are lost."""
    expected = content(by_threads)
    for name in lost:
        del expected[f'{name}_cleaned.csv']
    assert content(folder) == expected
    assert len(list(folder.glob('*.json'))) == len(expected)
    assert not hidden(folder)
    assert [entry['state'] for entry in entries(folder)].count('done') == len(expected)


def test_workers_give_the_same_bytes(  # noqa: PLR0913  fixtures
    clouds: list[str],
    by_threads: Path,
    scheduler: tuple[str, str],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both clean; a refusal is that of threads; who goes on by threads has nothing to do."""
    monkeypatch.chdir(Path(clouds[0]).parent)
    names = [Path(path).name for path in clouds]
    assert main(arguments(names, tmp_path, *scheduler)) == 3
    check(tmp_path, by_threads)
    assert states(tmp_path) == states(by_threads)
    assert len({entry['worker'] for entry in entries(tmp_path) if entry['worker']}) == 2
    capsys.readouterr()
    assert main(arguments(clouds, tmp_path, '--resume')) == 3
    assert f'0 cleaned, {COUNT} done before, 1 refused' in capsys.readouterr().out


def test_a_dry_run(
    clouds: list[str], scheduler: tuple[str, str], tmp_path: Path, capsys: Capture
) -> None:
    """It writes nothing; the largest groups come from the workers."""
    folder = tmp_path / 'none'
    assert main(arguments(clouds[:2], folder, *scheduler, '--dry-run')) == 0
    printed = capsys.readouterr().out
    assert main(arguments(clouds[:2], folder, '--dry-run')) == 0

    def tables(text: str) -> list[str]:
        lines = text.splitlines()
        return lines[next(i for i, line in enumerate(lines) if 'rejected points' in line) :]

    assert tables(printed) == tables(capsys.readouterr().out)
    assert not folder.exists()


def test_killed_workers(  # noqa: PLR0913  fixtures
    clouds: list[str],
    by_threads: Path,
    scheduler: tuple[str, str],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A file whose worker is killed is tried again; one that kills all fails alone."""
    monkeypatch.setattr(hands, 'make_on_worker', die_of)
    assert main(arguments(clouds, tmp_path, *scheduler)) == 3
    check(tmp_path, by_threads, ('003',))
    sentence = f'the file {clouds[3]} must be judged without a worker that dies, got 2 that died'
    assert entries(tmp_path)[3]['error'] == sentence
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ('number', 'status'), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_broken_off_and_resumed(  # noqa: PLR0913  fixtures and cases
    clouds: list[str],
    by_threads: Path,
    scheduler: tuple[str, str],
    tmp_path: Path,
    number: signal.Signals,
    status: int,
) -> None:
    """After Ctrl-C nothing hidden is left, after a kill nothing by the next run."""
    words = arguments(clouds, tmp_path, *scheduler)
    done, said = broken_off(words, number, LAST)
    assert done == status
    assert said.startswith('interrupted: ') == (number == signal.SIGINT)
    assert len(said.splitlines()) == (number == signal.SIGINT)
    assert bool(hidden(tmp_path)) == (number == signal.SIGKILL)
    assert LAST <= len(content(tmp_path)) == states(tmp_path).count('done') < COUNT
    assert main([*words, '--resume']) == 3
    check(tmp_path, by_threads)


def test_workers_of_other_code_are_refused(
    clouds: list[str],
    scheduler: tuple[str, str],
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What they have cleaned gets no name."""
    monkeypatch.setattr(hands, 'judging_code', lambda _judge: '0.0.1+abc')
    assert main(arguments(clouds[:2], tmp_path, *scheduler)) == 1
    assert 'must be of version 0.0.1+abc, as this process, got' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['manifest.jsonl']


def test_a_scheduler_that_goes(
    clouds: list[str],
    by_threads: Path,
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One sentence; what is done stays done, and threads do the rest."""
    with cluster() as (address, process):
        plain, taken = hands.OnWorkers.take, []

        def take(*given: object) -> object:
            taken.append(plain(*given))  # type: ignore[arg-type,type-var]
            if len(taken) == LAST:
                process.kill()
            return taken[-1]

        with monkeypatch.context() as patched:
            patched.setattr(hands.OnWorkers, 'take', take)
            assert main(arguments(clouds, tmp_path, '--scheduler', address)) == 1
    said = capsys.readouterr().err
    wrong = f'the scheduler {address} must be there until the end, got no answer any more\n'
    assert said.endswith(wrong)
    assert 'Traceback' not in said
    assert not hidden(tmp_path)
    assert LAST <= len(content(tmp_path)) < COUNT
    assert main(arguments(clouds, tmp_path, '--resume')) == 3
    check(tmp_path, by_threads)


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['--jobs', '2'], '--jobs must be left out with --scheduler, whose cluster has its own'),
        (['--picture', 'a.png'], '--picture must be left out with --scheduler, got a.png'),
    ],
)
def test_refused(
    clouds: list[str], tmp_path: Path, options: list[str], sentence: str, capsys: Capture
) -> None:
    """What a cluster cannot do is refused, before it is asked."""
    words = arguments(clouds[:1], tmp_path, '--scheduler', 'tcp://127.0.0.1:9', *options)
    assert main(words) == 1
    assert capsys.readouterr().err.startswith(sentence)
    assert main(['clean', clouds[0], '--scheduler', 'tcp://127.0.0.1:9']) == 1
    assert '--scheduler must be with --output FOLDER' in capsys.readouterr().err
