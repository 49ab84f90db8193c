# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A hundred files in one call of `clean`: broken off, killed, resumed, refused one by one."""

from __future__ import annotations

import json
import signal
from typing import TYPE_CHECKING

import pytest
from helpers import many_clouds
from helpers.many_clouds import broken_off, content, entries, hidden, states, write_clouds

from lidar_outlier_filter.archive.manifest import BROKEN_OFF, NAME
from lidar_outlier_filter.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

    Capture = pytest.CaptureFixture[str]

COUNT, LAST = 100, 37


@pytest.fixture(scope='module')
def clouds(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Write a hundred small clouds."""
    return write_clouds(tmp_path_factory.mktemp('clouds'), COUNT)


@pytest.fixture(scope='module')
def unbroken(clouds: list[str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Clean all at once."""
    folder = tmp_path_factory.mktemp('unbroken')
    assert main(arguments(clouds, folder)) == 0
    return content(folder)


def arguments(clouds: list[str], folder: Path, *options: str) -> list[str]:
    """Return the arguments that clean some clouds into a folder, by two threads."""
    return many_clouds.arguments(clouds, folder, '--jobs', '2', *options)


@pytest.mark.parametrize(
    ('number', 'status'), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_broken_off_and_resumed(  # noqa: PLR0913  fixtures and cases
    clouds: list[str],
    unbroken: dict[str, bytes],
    tmp_path: Path,
    capsys: Capture,
    number: signal.Signals,
    status: int,
) -> None:
    """After Ctrl-C or a kill, `--resume` leaves what is done; all has the bytes of one run."""
    done, said = broken_off(arguments(clouds, tmp_path), number, LAST)
    assert done == status
    # The other thread may finish its file, and it be noted, before Ctrl-C is looked at.
    before = states(tmp_path).count('done')
    assert LAST <= before <= LAST + (number == signal.SIGINT)
    if number == signal.SIGINT:
        done_of_all = f'{before} of {COUNT} files are done in {tmp_path}'
        assert f'interrupted: {done_of_all}; the same command goes on with the others' in said
    else:
        assert said == ''
    assert before <= len(content(tmp_path)) <= LAST + 2
    assert main(arguments(clouds, tmp_path)) == 0
    assert content(tmp_path) == unbroken
    assert states(tmp_path) == ['done'] * COUNT
    assert (tmp_path / 'archive.html').read_text('utf-8').count('<tr id=') == COUNT
    assert not hidden(tmp_path)
    counts = f'\n{COUNT - before} cleaned, {before} done before, 0 refused, 0 incomplete\n'
    assert counts in capsys.readouterr().out


def test_what_a_kill_left_between_two_outputs(
    clouds: list[str], unbroken: dict[str, bytes], tmp_path: Path
) -> None:
    """Of a file whose log is missing, and that the manifest calls begun, all is made anew."""
    some = clouds[:3]
    assert main(arguments(some, tmp_path)) == 0
    (tmp_path / '001_cleaned.csv.json').unlink()
    lines = (tmp_path / NAME).read_text('utf-8').splitlines()
    begun = json.loads(lines[1]) | {'state': 'failed', 'error': BROKEN_OFF}
    with (tmp_path / NAME).open('a', encoding='utf-8') as stream:
        stream.write(json.dumps(begun) + '\n')
    assert main(arguments(some, tmp_path)) == 0
    expected = {name: data for name, data in unbroken.items() if name < '003'}
    assert content(tmp_path) == expected


def test_each_file_for_itself(clouds: list[str], tmp_path: Path, capsys: Capture) -> None:
    """What was changed by hand, or cannot be read, is refused; what is done is left."""
    wrong = tmp_path / 'wrong.las'
    wrong.write_bytes(b'LASF')
    some, folder = [*clouds[:3], str(wrong)], tmp_path / 'out' / 'cleaned'
    assert main(arguments(some, folder)) == 3
    (folder / '000_cleaned.csv').write_text('x,y,z\n')
    before = content(folder)
    capsys.readouterr()
    assert main(arguments(some, folder)) == 3
    printed = capsys.readouterr()
    must_be = 'a new file, or one of the manifest'
    sentence = f'the output must be {must_be}, got {folder}/000_cleaned.csv, which exists'
    assert printed.err.splitlines()[0] == sentence
    assert '0 cleaned, 2 done before, 2 refused' in printed.out
    assert main(arguments(some[:1], folder, '--set', 'sor.k=5')) == 1
    assert content(folder) == before
    # What the manifest says stays true.
    assert states(folder)[:3] == ['done'] * 3
    assert 'must be of at least 227 bytes, got 4' in states(folder)[3]


def test_other_parameters_are_another_question(clouds: list[str], tmp_path: Path) -> None:
    """What was made otherwise is made anew, with its log, as in an archive of recordings."""
    some = clouds[:2]
    assert main(arguments(some, tmp_path)) == 0
    before = content(tmp_path)
    assert main(arguments(some, tmp_path, '--set', 'sor.multiplier=0.5')) == 0
    assert content(tmp_path).keys() == before.keys()
    assert all(data != before[name] for name, data in content(tmp_path).items())
    log = json.loads((tmp_path / '000_cleaned.csv.json').read_text('utf-8'))
    assert log['parameters']['sor.multiplier'] == 0.5
    assert not hidden(tmp_path)


def test_a_folder_is_searched(tmp_path: Path, capsys: Capture) -> None:
    """Outputs lie as the files do, beside the folder; the same command has nothing left to do."""
    (source := tmp_path / 'strips' / 'day').mkdir(parents=True)
    write_clouds(source, 2)
    (source / '001.csv').rename(source.parent / 'first.csv')
    (source / 'notes.md').write_text('none')
    words = ['clean', str(source.parent), '--chain', 'sor']
    for counts in ('2 cleaned, 0 done before', '0 cleaned, 2 done before'):
        assert main(words) == 0
        printed = capsys.readouterr().out
        assert f'{counts}, 0 refused, 0 incomplete\n' in printed
        assert 'day/000.csv' in printed
    folder = tmp_path / 'strips_cleaned'
    made = sorted(str(path.relative_to(folder)) for path in folder.rglob('*.csv'))
    assert made == ['day/000_cleaned.csv', 'first_cleaned.csv']
    assert [entry['source'] for entry in entries(folder)] == ['day/000.csv', 'first.csv']
    page = (folder / 'archive.html').read_text('utf-8')
    assert 'href="./day/000_cleaned.csv"' in page
    assert main([*words, '--output', str(source.parent / 'out')]) == 1
    assert 'must be outside of' in capsys.readouterr().err


def test_nothing_tested_again_and_again(tmp_path: Path, capsys: Capture) -> None:
    """A file that could not be tested is written, and the status says so each time; so the page."""
    path = tmp_path / 'few.csv'
    path.write_text('x,y,z\n' + '1,2,3\n' * 3)
    (tmp_path / 'out').mkdir()
    for _ in range(2):
        assert main(arguments([str(path)], tmp_path / 'out')) == 3
        printed = capsys.readouterr()
        assert 'sor could test none' in printed.err
        assert 'untested' in printed.out
    (noted,) = entries(tmp_path / 'out')
    assert noted['topics']['the file']['untested_because'] == 'sor could test none'
    page = (tmp_path / 'out' / 'archive.html').read_text('utf-8')
    assert 'no point of the file could be tested: sor could test none' in page


def test_a_name_that_was_mistyped(clouds: list[str], tmp_path: Path, capsys: Capture) -> None:
    """It is refused, and no line stays behind."""
    words = arguments([clouds[0], str(tmp_path / 'none.csv')], tmp_path / 'out')
    assert main(words) == 3
    assert f'{tmp_path}/none.csv must be a file, got none' in capsys.readouterr().err
    assert [entry['source'] for entry in entries(tmp_path / 'out')] == ['000.csv']


def test_two_files_with_one_output(clouds: list[str], tmp_path: Path, capsys: Capture) -> None:
    """Files of one name in two folders are refused before any work."""
    other = tmp_path / '000.csv'
    other.write_text('x,y,z\n1,2,3\n')
    assert main(arguments([clouds[0], str(other)], tmp_path / 'out')) == 1
    assert 'must be that of one file, got' in capsys.readouterr().err
