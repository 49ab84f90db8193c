# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Runs that are killed at any moment end as one run; two at once are refused."""

import re
import signal
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from helpers.archives import (
    cleaning,
    command_of,
    content,
    hidden,
    records,
    signalled,
    tree,
    write_clouds,
)

from lidar_outlier_filter.archive import publish
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


STEPS = ('Path.rename', 'Path.replace', 'new_files.publish')
VERBS = ((0, 'replay'), (1, 'clean'))


def pairs(steps: Sequence[str]) -> list[tuple[str, str, bool]]:
    """Give each step with both commands, one of them new: all pairs, and not their product."""
    return [(verb, step, (i + j) % 2 == 0) for i, step in enumerate(steps) for j, verb in VERBS]


def kill_at(patch: pytest.MonkeyPatch, step: str, number: int) -> None:
    """Kill the run at the n-th call of a step of publishing, and leave all as it is."""
    place, _, name = step.partition('.')
    home: Any = {'new_files': new_files, 'Path': Path}[place]
    known, calls, dead = getattr(home, name), list[Any](), list[str]()

    def call(*given: Any, **more: Any) -> Any:
        calls.append(given)
        if len(calls) == number:
            dead.append(step)
        if dead:
            raise KilledError
        return known(*given, **more)

    patch.setattr(home, name, call)
    # A process that was killed removes nothing.
    for owner, undo in ((new_files, 'remove_hidden'), (TemporaryDirectory, '_rmtree')):
        plain = getattr(owner, undo)
        keep = staticmethod(lambda *a, plain=plain, **k: None if dead else plain(*a, **k))
        patch.setattr(owner, undo, keep)


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
    assert kills or (is_new and step == 'Path.rename')


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


@pytest.mark.parametrize('words', ['replay', 'clean'], indirect=True)
def test_one_run_at_a_time(words: list[str], capsys: Capture) -> None:
    """While a run works in the folder of outputs, another is refused, and writes nothing."""
    with publish.locked(OUT.absolute()):
        before = tree(OUT)
        assert main(words) == 1
        assert tree(OUT) == before
    said = capsys.readouterr().err
    assert f'must be that of one run at a time, got {OUT.absolute()}, where another' in said
    assert main(words) == 0
    assert not hidden(OUT)
