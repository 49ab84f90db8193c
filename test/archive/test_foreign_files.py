# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Only an output that a run noted, and that is unchanged, is replaced; all else is refused."""

import errno
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.archives import command_of, content, hidden, records, tree

from lidar_outlier_filter.archive import run
from lidar_outlier_filter.archive.jobs import Task
from lidar_outlier_filter.archive.publish import publish
from lidar_outlier_filter.archive.sidecar import MAX_BYTES
from lidar_outlier_filter.cli.main import main

Capture = pytest.CaptureFixture[str]
Words = Callable[..., list[str]]

OUT = Path('out')


@pytest.fixture(params=['replay', 'clean'], autouse=True)
def words(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """Give a command that has two outputs, of which one is ``out/first…`` or ``out/000…``."""
    monkeypatch.chdir(tmp_path)
    return command_of(request.param, Path())


def first(suffix: str = '') -> Path:
    """Return the first output, or a file of it that a user might edit, or its sidecar."""
    output = next(path for path in (OUT / 'first', OUT / '000_cleaned.csv') if path.exists())
    if suffix:
        return output.with_name(output.name + suffix)
    return output / 'metadata.yaml' if output.is_dir() else output


def edit(path: Path) -> Path:
    """Edit a file so that size and time stay as they were."""
    stat, data = path.stat(), path.read_bytes()
    path.write_bytes(data.swapcase())
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    return path


def replace(path: Path, text: str) -> Path:
    """Write another file in place of one."""
    path.unlink(missing_ok=True)
    path.write_text(text)
    return path


def append(path: Path) -> Path:
    """Add a line to a file."""
    return replace(path, path.read_text() + 'mine\n')


def link(path: Path) -> Path:
    """Put a link in place of a file, to an equal one."""
    path.rename('elsewhere')
    path.symlink_to(Path('elsewhere').absolute())
    return path


def lay(path: Path) -> Path:
    """Lay a file into the folder of a recording, or a folder in place of an output."""
    if path.name == 'metadata.yaml':
        return replace(path.with_name('notes.txt'), 'mine')
    path.unlink()
    path.mkdir()
    return path


def sidecar() -> Path:
    """Return the sidecar of the first output."""
    return first('.json')


EDITS: dict[str, Callable[[], Path]] = {
    'an output, edited': lambda: append(first()),
    'an output, edited within the same time': lambda: edit(first()),
    'a link': lambda: link(first()),
    'a file laid into an output': lambda: lay(first()),
    'a sidecar, edited': lambda: append(sidecar()),
    'a sidecar, linked': lambda: link(sidecar()),
    'a sidecar, too large': lambda: replace(sidecar(), sidecar().read_text() + ' ' * MAX_BYTES),
    'brackets': lambda: replace(sidecar(), '[' * 200_000),
    'other JSON': lambda: replace(sidecar(), '{"archive": []}'),
    'no text': lambda: Path(shutil.copy(sys.executable, sidecar())),
    'the page, edited': lambda: append(OUT / 'archive.html'),
    'another page': lambda: replace(OUT / 'archive.html', '<html>mine</html>'),
}


@pytest.mark.parametrize('what', EDITS)
def test_a_changed_file_is_refused_by_name(words: list[str], capsys: Capture, what: str) -> None:
    """It stays as it is, whether its output is to be made anew or not."""
    assert main(words) == 0
    path = EDITS[what]()
    before = tree(Path())
    for options in ([], ['--set=scores=true']):
        if what.endswith('time') and not options:
            continue  # equal state: this is taken for done, and nothing is written
        capsys.readouterr()
        assert main([*words, *options]) in (1, 3)
        printed = capsys.readouterr()
        assert 'the output must be new, or an unchanged' in printed.err
        assert str(path) in printed.err.replace('\n', '')
        assert 'Traceback' not in printed.err
        assert tree(Path())[str(path)] == before[str(path)]


@pytest.mark.parametrize('kind', ['file', 'folder', 'link', 'log'])
def test_what_was_there_before_is_refused(words: list[str], capsys: Capture, kind: str) -> None:
    """A file, an empty folder, a dead link, and a JSON file in the place of a sidecar."""
    OUT.mkdir()
    name = 'first' if words[0] == 'replay' else '000_cleaned.csv'
    path = OUT / (f'{name}.json' if kind == 'log' else name)
    if kind == 'folder':
        path.mkdir()
    elif kind == 'link':
        path.symlink_to('nowhere')
    else:
        path.write_text('{}')
    before = tree(OUT)
    assert main(words) == 3
    assert str(path) in capsys.readouterr().err.replace('\n', '')
    after = tree(OUT)
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize('which', ['output', 'sidecar', 'other'])
@pytest.mark.parametrize('is_new', [True, False])
def test_what_comes_while_a_run_works_stays(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Capture, which: str, *, is_new: bool
) -> None:
    """A file that appears or changes during a run is refused."""
    if not is_new:
        assert main(words) == 0
    path = OUT / ('first' if words[0] == 'replay' else '000_cleaned.csv')
    touched: list[Path] = []

    def late(task: Task, *given: Any) -> None:
        if task.outputs[0].name == path.name:
            target = path.with_name(f'{path.name}.json') if which == 'sidecar' else path
            if target.is_dir():
                target /= 'notes.txt' if which == 'other' else 'metadata.yaml'
            touched.append(replace(target, 'mine'))
        publish(task, *given)

    monkeypatch.setattr(run, 'publish', late)
    before = content(OUT)
    assert main([*words, *([] if is_new else ['--set=scores=true'])]) == 3
    assert touched[0].read_text() == 'mine'
    assert 'the output must be' in capsys.readouterr().err
    names = [name for name in before if name.startswith(path.name) and OUT / name != touched[0]]
    assert {name: content(OUT)[name] for name in names} == {name: before[name] for name in names}
    assert not hidden(OUT)


def test_a_full_disk(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """Where the sidecar cannot be written, older outputs stay; the next run does it all."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    assert main(words) == 0
    before, words = (content(OUT), records(OUT)), [*words, '--set=scores=true']
    with monkeypatch.context() as patch:
        patch.setattr(Path, 'write_text', full)
        assert main(words) in {1, 3}
    assert 'must be written in full, got "No space left on device"' in capsys.readouterr().err
    assert (content(OUT), records(OUT)) == before
    assert not hidden(OUT)
    assert main(words) == 0


def test_what_a_sidecar_says(words: list[str]) -> None:
    """It has the record of the archive; that of a cleaned file is its log, too."""
    assert main(words) == 0
    values = json.loads(first('.json').read_text())
    assert values['archive']['state'] == 'done'
    assert {'parameters', 'versions'} <= set(values) or words[0] == 'replay'
