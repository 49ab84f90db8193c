# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Runs that are killed at any moment, and two at once: the outputs end as those of one run."""

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
from helpers.archives import cleaning, command_of, content, hidden, records, signalled, write_clouds

from lidar_outlier_filter.archive import publish, run
from lidar_outlier_filter.archive.sidecar import read_folder
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.disk import new_files

Capture = pytest.CaptureFixture[str]

OUT = Path('out')
COUNT, LAST = 40, 17
ANEW = '--set=scores=true'


class KilledError(BaseException):
    """Ends a run as a kill does: nothing catches it, and nothing is tidied up."""


@pytest.fixture(params=['replay', 'clean'])
def words(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """Give a command with two tasks, and for files two outputs each."""
    monkeypatch.chdir(tmp_path)
    return command_of(request.param, Path())


STEPS = ('publish.write', 'publish._rename', 'new_files.publish', 'Path.rename')
FASTER = ('publish.find_outputs', 'publish._rename', 'publish.write')
VERBS = ((0, 'replay'), (1, 'clean'))


def pairs(steps: Sequence[str]) -> list[tuple[str, str, bool]]:
    """Give each step with both commands, one of them new: all pairs, and not their product."""
    return [(verb, step, (i + j) % 2 == 0) for i, step in enumerate(steps) for j, verb in VERBS]


def kill_at(patch: pytest.MonkeyPatch, step: str, number: int) -> None:
    """Kill the run at the n-th call of a step of publishing, and leave all as it is."""
    place, _, name = step.partition('.')
    home: Any = {'publish': publish, 'new_files': new_files, 'Path': Path}[place]
    known, calls, locks = getattr(home, name), list[Any](), list[Any]()
    dead: list[str] = []

    def call(*given: Any, **more: Any) -> Any:
        calls.append(given)
        if len(calls) == number:
            dead.append(step)
            for lock in locks:
                lock.close()
        if dead:
            raise KilledError
        return known(*given, **more)

    def lock_in(folder: Path) -> Any:
        locks.append(lock := plain_lock(folder))
        return lock

    plain_lock = new_files._lock_in
    patch.setattr(new_files, '_lock_in', lock_in)
    patch.setattr(home, name, call)
    # A process that was killed removes nothing, and puts nothing back.
    for module, undo in ((new_files, '_remove'), (publish, '_put_back'), (publish, '_discard')):
        plain = getattr(module, undo)
        patch.setattr(module, undo, lambda *a, plain=plain: None if dead else plain(*a))


@pytest.mark.parametrize(('words', 'step', 'is_new'), pairs(STEPS), indirect=['words'])
def test_killed_at_each_step(
    words: list[str], monkeypatch: pytest.MonkeyPatch, step: str, *, is_new: bool
) -> None:
    """However a run is killed while outputs get their names, the same command ends it."""
    options = [] if is_new else [ANEW]
    fresh = [str(Path('fresh')) if word == str(OUT) else word for word in words]
    assert main([*fresh, *options]) == 0
    expected = content(Path('fresh'))
    kills, killed = 0, True
    for number in range(1, 9):
        if not killed:
            break  # there are no more such steps
        if not is_new:
            assert main(words) == 0
        with monkeypatch.context() as patch:
            kill_at(patch, step, number)
            try:
                assert main([*words, *options]) == 0
                killed = False
            except KilledError:
                kills += 1
        assert main([*words, *options]) == 0, f'{step} {number}'
        assert content(OUT) == expected
        assert len(records(OUT)) == 2
        assert not hidden(OUT)
        for path in sorted(OUT.rglob('*'), reverse=True) if is_new else ():
            path.rmdir() if path.is_dir() else path.unlink()
    assert kills or is_new or step != 'publish.write'


@pytest.mark.parametrize(
    ('number', 'status'), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_broken_off_and_continued(
    tmp_path: Path, capsys: Capture, number: signal.Signals, status: int
) -> None:
    """After Ctrl-C or a kill the same command skips what is done; all has the bytes of one run."""
    clouds = write_clouds(tmp_path / 'in', COUNT)
    words = cleaning(clouds, tmp_path / 'out', '--jobs', '2')
    done, said = signalled(words, number, LAST)
    assert done == status
    before = len(records(tmp_path / 'out'))
    assert LAST <= before < COUNT
    if number == signal.SIGINT:
        assert f'of {COUNT} files are done; the same command continues with the others' in said
        assert not hidden(tmp_path / 'out')
    assert main(words) == 0
    counts = re.search(r'(\d+) cleaned, (\d+) done before, 0 ', capsys.readouterr().out)
    assert counts is not None
    # A file of which only the sidecar was missing is done, too.
    assert sum(map(int, counts.groups())) == COUNT
    assert before <= int(counts[2]) <= before + 2
    assert main(cleaning(clouds, tmp_path / 'whole')) == 0
    assert content(tmp_path / 'out') == content(tmp_path / 'whole')
    assert not hidden(tmp_path / 'out')
    assert (tmp_path / 'out' / 'archive.html').read_text('utf-8').count('<tr id=') == COUNT


def test_two_runs_at_once(tmp_path: Path) -> None:
    """Both end well, and the outputs are those of one run."""
    clouds = write_clouds(tmp_path / 'in', COUNT)
    command = [sys.executable, '-m', 'lidar_outlier_filter.cli.main']
    words = [*command, *cleaning(clouds, tmp_path / 'out', '--jobs', '2')]
    runs = [subprocess.Popen(words, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [[one for one in run.communicate()[1].splitlines() if '%' not in one] for run in runs]
    assert [run.returncode for run in runs] == [0, 0], said
    assert main(cleaning(clouds, tmp_path / 'whole')) == 0
    assert content(tmp_path / 'out') == content(tmp_path / 'whole')
    assert len(records(tmp_path / 'out')) == COUNT
    assert not hidden(tmp_path / 'out')


def test_folders_of_another_run_vanish(tmp_path: Path) -> None:
    """Sidecars are read while another run makes and removes hidden folders beside them."""
    (tmp_path / 'a').mkdir()
    ended = Event()

    def work() -> None:
        while not ended.is_set():
            with publish.workshop(tmp_path) as built:
                (built / 'one').touch()
                (built / 'more').mkdir()

    other = Thread(target=work)
    other.start()
    try:
        for _ in range(300):
            assert read_folder(tmp_path) == []
            publish._files_at(tmp_path, 'all')
    finally:
        ended.set()
        other.join()


@pytest.mark.parametrize(('words', 'step', 'is_same'), pairs(FASTER), indirect=['words'])
def test_another_run_is_faster(
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
    step: str,
    *,
    is_same: bool,
) -> None:
    """Its outputs are taken where they are the same; others are refused, and stay."""
    other = [*words, *([] if is_same else [ANEW])]
    fresh = [str(Path('fresh')) if word == str(OUT) else word for word in other]
    assert main(fresh) == 0
    name = step.split('.')[1]
    known: Callable[..., Any] = getattr(publish, name)
    command = [sys.executable, '-m', 'lidar_outlier_filter.cli.main', *other]
    begun, made = list[int](), list[int]()
    plain = publish.publish

    def late(*given: Any) -> Any:
        made.append(1)
        return plain(*given)

    def call(*given: Any, **more: Any) -> Any:
        if made and not begun:
            begun.append(1)
            subprocess.run(command, check=True, capture_output=True)
        return known(*given, **more)

    monkeypatch.setattr(run, 'publish', late)
    monkeypatch.setattr(publish, name, call)
    status = main(words)
    assert begun
    if is_same:
        assert status == 0
    else:
        assert status in (1, 3)
        assert 'must be' in capsys.readouterr().err
    expected = content(Path('fresh'))
    if not is_same:  # the second task began after the other run
        expected = {name: expected[name] for name in expected if name.startswith(('f', '000'))}
    assert content(OUT).items() >= expected.items()
    assert len(records(OUT)) == 2
    assert not hidden(OUT)
