# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Manifests: they go with their folders, and what is done stays done through kills and damage."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from helpers.drives import FAST, write_drive
from helpers.many_clouds import write_clouds

from lidar_outlier_filter.archive import logs, manifest
from lidar_outlier_filter.archive.manifest import NAME, Entry, opened_manifest
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Capture = pytest.CaptureFixture[str]
    Words = Callable[..., list[str]]

SET = f'--set=chain={json.dumps(FAST["chain"])}'
DONE_BEFORE = '0 {}, 2 done before, 0 '


class KilledError(Exception):
    """Ends a run as a kill does: nothing is tidied."""


def of_drives(source: Path | str, output: Path | str) -> list[str]:
    """Return the words that replay an archive."""
    return ['replay', str(source), '--output', str(output), '--jobs=1', SET]


def of_files(source: Path | str, output: Path | str) -> list[str]:
    """Return the words that clean the files of a folder, and leave what is done."""
    files = sorted(str(path) for path in Path(source).iterdir())
    return ['clean', *files, '--output', str(output), '--resume', '--chain=sor', '--jobs=2']


@pytest.fixture(params=['replay', 'clean'])
def command(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Words, str]:
    """Write two drives or files to ``a/in``; give what makes the command, and its word for done."""
    source = tmp_path / 'a' / 'in'
    source.mkdir(parents=True)
    if request.param == 'replay':
        (source / 'day').mkdir()
        write_drive(source / 'day' / 'first', 6, seed=1)
        write_drive(source / 'second', 6, seed=2)
        return of_drives, 'replayed'
    write_clouds(source, 2)
    return of_files, 'cleaned'


def lines(folder: Path) -> list[dict[str, Any]]:
    """Read the lines of a manifest."""
    return [json.loads(line) for line in (folder / NAME).read_text('utf-8').splitlines()]


def write(folder: Path, entries: Sequence[dict[str, Any] | str]) -> None:
    """Write lines of a manifest."""
    texts = (one if isinstance(one, str) else json.dumps(one) for one in entries)
    (folder / NAME).write_text(''.join(f'{text}\n' for text in texts), 'utf-8')


def times(folder: Path) -> dict[str, int]:
    """Find when the outputs below a folder were written."""
    found = [path for path in folder.rglob('*') if path.suffix in {'.mcap', '.csv'}]
    return {str(path.relative_to(folder)): path.stat().st_mtime_ns for path in found}


def test_the_same_folders_named_differently(
    command: tuple[Words, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """From within, through a link as a mount is, and moved: what is done is left."""
    words, verb = command
    monkeypatch.chdir(tmp_path)
    assert main(words('a/in', 'a/out')) == 0
    before, noted = times(tmp_path / 'a' / 'out'), lines(tmp_path / 'a' / 'out')
    assert len(before) == len(noted) == 2
    (tmp_path / 'mount').symlink_to(tmp_path / 'a')

    def check(source: Path | str, output: Path | str) -> None:
        capsys.readouterr()
        assert main(words(source, output)) == 0
        assert DONE_BEFORE.format(verb) in capsys.readouterr().out
        assert times(Path(output)) == before
        assert lines(Path(output)) == noted

    monkeypatch.chdir(tmp_path / 'a')
    check('in', 'out')
    check(tmp_path / 'mount' / 'in', tmp_path / 'mount' / 'out')
    monkeypatch.chdir(tmp_path / 'a' / 'out')
    check('../in', '.')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'a' / 'out').rename(tmp_path / 'other')
    (tmp_path / 'a' / 'in').rename(tmp_path / 'elsewhere')
    check(tmp_path / 'elsewhere', 'other')
    assert str(tmp_path) not in (tmp_path / 'other' / NAME).read_text('utf-8')


def test_whole_paths_of_before_are_read(
    command: tuple[Words, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Lines with an absolute source, and the output as it was typed, count as they did."""
    words, verb = command
    monkeypatch.chdir(tmp_path)
    assert main(words('a/in', 'a/out')) == 0
    noted = lines(tmp_path / 'a' / 'out')
    write(
        tmp_path / 'a' / 'out',
        [
            line
            | {
                'source': str(tmp_path / 'a' / 'in' / line['source']),
                'output': f'{typed}/{line["output"]}',
            }
            for line, typed in zip(noted, ('a/out', tmp_path / 'a' / 'out'), strict=True)
        ],
    )
    capsys.readouterr()
    assert main(words('a/in', 'a/out')) == 0
    assert DONE_BEFORE.format(verb) in capsys.readouterr().out
    assert lines(tmp_path / 'a' / 'out') == noted


@pytest.mark.parametrize(
    'damage',
    [
        lambda line: line.replace(':', ';', 1),
        lambda line: line.replace('"state"', '"stage"'),
        lambda line: line.replace('"done"', '"dome"'),
        lambda line: line.replace('"refused"', '"refuced"'),
        lambda line: line.replace('"topics": {', '"topics": 1, "x": {'),
        lambda line: '\\x00' * len(line),
        lambda line: line[: len(line) // 2],
    ],
)
def test_a_line_that_is_damaged(
    command: tuple[Words, str],
    tmp_path: Path,
    capsys: Capture,
    damage: Callable[[str], str],
) -> None:
    """It is named, and costs its own recording: what is there is in the way, and stays."""
    words, _ = command
    source, output = tmp_path / 'a' / 'in', tmp_path / 'a' / 'out'
    assert main(words(source, output)) == 0
    before, noted = times(output), lines(output)
    write(output, [damage(json.dumps(noted[0])), noted[1]])
    capsys.readouterr()
    assert main(words(source, output)) == 3
    printed = capsys.readouterr()
    assert f'line 1 of {output / NAME} must be an entry of a manifest, got' in printed.err
    assert 'which exists' in printed.err
    assert '1 done before' in printed.out
    assert times(output) == before
    assert [line for line in lines(output) if line['state'] == 'done'] == noted[1:]


def test_a_file_without_any_entry(tmp_path: Path) -> None:
    """It is somebody else's: it is refused with its first line, and stays, a cut-off line too."""
    for text in ('{"source": 1}\n', 'notes\n', 'notes', '{"notes": '):
        (tmp_path / NAME).write_text(text)
        with pytest.raises(RecordingError, match=f'{NAME} must be an entry of a manifest'):
            opened_manifest(tmp_path).__enter__()
        assert (tmp_path / NAME).read_text() == text


def entry(name: str, state: str = 'done', **more: Any) -> Entry:
    """Make an entry."""
    given = {'hash': 'h', 'lost': [], **more}
    return Entry(name, 1, parameters='p', version='v', model='m', output=name, state=state, **given)


def killed_at(folder: Path, *entries: Entry, rest: bytes = b'') -> None:
    """Add entries, and then a part of a line, as a run does that is killed."""

    def run() -> None:
        with opened_manifest(folder) as opened:
            for one in entries:
                opened.add(one)
            raise KilledError

    with pytest.raises(KilledError):
        run()
    with (folder / NAME).open('ab') as stream:
        stream.write(rest)


def test_a_second_kill(tmp_path: Path) -> None:
    """A line that was cut off is not the begin of the next one."""
    begin = manifest._line(entry('b'))
    for size in (1, len(begin) // 2, len(begin) - 1):
        folder = tmp_path / str(size)
        killed_at(folder, entry('a'), rest=begin[:size])
        killed_at(folder, entry('b'), entry('c'))
        with opened_manifest(folder) as opened:
            assert sorted(opened.entries) == ['a', 'b', 'c']


def test_the_first_line_of_all_is_cut_off(tmp_path: Path) -> None:
    """A manifest of which a kill has left the begin of one line is none yet."""
    begin = manifest._line(entry('a'))
    for size in (1, 20, len(begin) - 1):
        (tmp_path / NAME).write_bytes(begin[:size])
        with opened_manifest(tmp_path) as opened:
            assert opened.entries == {}
        assert (tmp_path / NAME).read_bytes() == b''


def test_a_refusal_leaves_what_is_done(tmp_path: Path) -> None:
    """Its run knows of it; the line says for the next one what was done, also after a kill."""
    done, begun = entry('a'), entry('a', 'failed', error=manifest.BROKEN_OFF)
    refused = entry('a', 'failed', error='no')
    with opened_manifest(tmp_path) as opened:
        for one in (done, begun, refused):
            opened.add(one)
        assert opened.entries['a'] == refused
    with opened_manifest(tmp_path) as opened:
        assert opened.entries == {'a': done}
    killed_at(tmp_path, begun)
    with opened_manifest(tmp_path) as opened:
        assert opened.entries == {'a': begun}  # its output may be on the way out
    killed_at(tmp_path, refused)
    with opened_manifest(tmp_path) as opened:
        assert opened.entries == {'a': done}
        opened.add(entry('a', hash='other'))
        opened.add(refused)
    with opened_manifest(tmp_path) as opened:
        assert opened.entries['a'].hash == 'other'


def test_a_refused_run_leaves_what_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Parameters that no recording can be replayed with cost nothing: the first ones find all."""
    (tmp_path / 'in').mkdir()
    write_drive(tmp_path / 'in' / 'first', 6, seed=1)
    words = of_drives(tmp_path / 'in', tmp_path / 'out')
    assert main(words) == 0
    before, noted = times(tmp_path / 'out'), lines(tmp_path / 'out')
    assert main([*words, '--set=motion.source=odometry', '--set=motion.topic=/none']) == 1
    assert '1 failed' in capsys.readouterr().out
    assert 'failed' in (tmp_path / 'out' / 'archive.html').read_text('utf-8')
    assert lines(tmp_path / 'out') == noted
    monkeypatch.chdir(tmp_path)
    assert main(words) == 0
    assert '0 replayed, 1 done before' in capsys.readouterr().out
    assert times(tmp_path / 'out') == before


def test_what_others_have_written_is_left_again_and_again(tmp_path: Path) -> None:
    """A run that was refused by it does not make it ours."""
    (tmp_path / 'in').mkdir()
    write_drive(tmp_path / 'in' / 'first', 6, seed=1)
    other = tmp_path / 'out' / 'first'
    other.mkdir(parents=True)
    (other / 'notes.txt').write_text('mine')
    for _ in range(3):
        assert main(of_drives(tmp_path / 'in', tmp_path / 'out')) == 1
        assert [path.name for path in other.iterdir()] == ['notes.txt']


def test_on_the_disk_before_it_takes_the_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a machine that loses power the old manifest is left, or all of the new one."""
    events: list[str] = []
    sync, replace = os.fsync, Path.replace

    def note_sync(number: int) -> None:
        events.append(f'sync {Path(f"/proc/self/fd/{number}").readlink().name}')
        sync(number)

    def note_replace(path: Path, target: Path) -> Path:
        events.append(f'replace {target.name}')
        return replace(path, target)

    with opened_manifest(tmp_path) as opened:
        opened.add(entry('a'))
        monkeypatch.setattr(os, 'fsync', note_sync)
        monkeypatch.setattr(Path, 'replace', note_replace)
    assert events == [f'sync {NAME}', f'replace {NAME}', f'sync {tmp_path.name}']


def test_a_manifest_that_was_replaced_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who opened it just before another run ended would write into a file without a name."""
    (tmp_path / NAME).touch()
    lock = logs._lock

    def late(path: Path, stream: Any) -> None:
        path.with_name('new').touch()
        path.with_name('new').replace(path)
        lock(path, stream)

    monkeypatch.setattr(logs, '_lock', late)
    with pytest.raises(RecordingError, match='must be used by one run at a time, got two'):
        opened_manifest(tmp_path).__enter__()
