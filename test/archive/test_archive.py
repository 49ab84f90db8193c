# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Archives: what is done is left, what has changed is replayed, and what fails fails alone."""

from __future__ import annotations

import json
import os
import re
import shutil
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from helpers import ROOT
from helpers.drives import FAST, hashes, write_drive

from lidar_outlier_filter.archive import fingerprints, manifest, one_recording, proof, run, workers
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.manifest import NAME, opened_manifest
from lidar_outlier_filter.cli import archive as command
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.disk import new_files
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters

SET = [f'--set=chain={json.dumps(FAST["chain"])}']


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    """Write two folders with a recording each, one of which is a lone file."""
    folder = tmp_path / 'drives'
    (folder / 'tuesday').mkdir(parents=True)
    write_drive(folder / 'first', 6, seed=1)
    second = write_drive(folder / 'tuesday' / 'x', 6, seed=2)
    (second / 'x.mcap').rename(folder / 'tuesday' / 'second.mcap')
    shutil.rmtree(second)
    return folder


def clean(folder: Path, *options: str) -> int:
    """Run the command on a folder, in this process."""
    return main(['replay', str(folder), '--jobs', '1', *SET, *options])


def lines(folder: Path) -> list[dict[str, Any]]:
    """Read the manifest."""
    return [json.loads(line) for line in (folder / NAME).read_text('utf-8').splitlines()]


def times(folder: Path) -> dict[str, int]:
    """Find when the files of the recordings below a folder were written."""
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob('*/*') if path.is_file()}


def test_every_recording_is_replayed(
    drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Outputs lie as the recordings do, with the bytes of a replay alone; the manifest counts."""
    assert clean(drives) == 0
    output = tmp_path / 'drives_cleaned'
    sources = {'first': drives / 'first', 'tuesday/second': drives / 'tuesday' / 'second.mcap'}
    entries = lines(output)
    assert len(entries) == 2
    for entry, (name, source) in zip(entries, sources.items(), strict=True):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        one = tmp_path / 'alone' / name
        one.parent.mkdir(parents=True)
        assert main(['replay', str(source), '--output', str(one), *SET]) == 0
        assert hashes(output / name) == hashes(one)
        assert (entry['source'], entry['output']) == (str(source.relative_to(drives)), name)
        assert (entry['state'], entry['error']) == ('done', None)
        assert entry['duration'] == pytest.approx(0.6)
        counts = entry['topics']['/lidar']
        assert (counts['messages'], counts['points'], counts['gaps']) == (6, 720, 0)
        assert counts['rejected'] == sum(counts['rejected_by'].values()) > 0
        assert counts['kept'] == counts['points'] - counts['rejected']
    second = sources['tuesday/second']
    assert entries[1]['hash'] == sha256(second.read_bytes()).hexdigest()
    assert '2 replayed, 0 done before, 0 failed' in capsys.readouterr().out


def test_what_is_done_is_left(
    drives: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A second run opens and hashes nothing."""
    assert clean(drives) == 0
    before = times(tmp_path / 'drives_cleaned')

    def refuse(*_: object) -> str:
        pytest.fail('a file was read')

    monkeypatch.setattr(proof, 'content_hash', refuse)
    monkeypatch.setattr(run, 'run_all', refuse)
    capsys.readouterr()
    assert clean(drives) == 0
    assert times(tmp_path / 'drives_cleaned') == before
    assert '0 replayed, 2 done before, 0 failed' in capsys.readouterr().out


def test_no_recording_has_the_folder_of_all_outputs_listed(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of n recordings each would list up to n outputs; none does."""
    output, listed, known = tmp_path / 'drives_cleaned', list[Path](), new_files._folders

    def note(path: Path, kind: str) -> list[Path]:
        listed.append(path)
        return known(path, kind)

    monkeypatch.setattr(new_files, '_folders', note)
    assert clean(drives) == 0
    assert output / 'manifest.jsonl' in listed
    assert not {output / 'first', output / 'tuesday' / 'second'} & set(listed)


def test_a_copy_with_other_times_is_the_same(drives: Path, tmp_path: Path) -> None:
    """Where times differ, hashes decide; the new times are noted."""
    assert clean(drives) == 0
    output = tmp_path / 'drives_cleaned'
    for path in [*drives.rglob('*.mcap'), *output.rglob('*.mcap')]:
        os.utime(path, ns=(10**18, 10**18))
    before, noted = times(output), lines(output)
    assert clean(drives) == 0
    assert times(output) == before
    states = [(entry['source_state'], entry['output_state']) for entry in lines(output)]
    assert states != [(entry['source_state'], entry['output_state']) for entry in noted]


def change_source(drives: Path, _output: Path) -> list[str]:
    """Write another recording over one."""
    shutil.rmtree(drives / 'first')
    write_drive(drives / 'first', 6, seed=3)
    return []


def change_output(_drives: Path, output: Path) -> list[str]:
    """Let an output lose a byte."""
    path = output / 'first' / 'first.mcap'
    path.write_bytes(path.read_bytes()[:-1])
    return []


def remove_output(_drives: Path, output: Path) -> list[str]:
    """Remove an output."""
    shutil.rmtree(output / 'first')
    return []


def break_line(_drives: Path, output: Path) -> list[str]:
    """Cut the manifest within a line, as a process does that is killed."""
    text = (output / NAME).read_bytes().splitlines(keepends=True)
    (output / NAME).write_bytes(text[1] + text[0][:-10])
    return []


def break_off(_drives: Path, output: Path) -> list[str]:
    """Leave a manifest as it is while a recording is replayed."""
    entry = lines(output)[0] | {'state': 'failed', 'error': manifest.BROKEN_OFF}
    with (output / NAME).open('a', encoding='utf-8') as stream:
        stream.write(json.dumps(entry) + '\n')
    return []


@pytest.mark.parametrize('change', [change_source, change_output, remove_output, break_off])
def test_what_has_changed_is_replayed(drives: Path, tmp_path: Path, change: Any) -> None:
    """And nothing else is."""
    assert clean(drives) == 0
    output = tmp_path / 'drives_cleaned'
    change(drives, output)
    before = times(output)
    assert clean(drives) == 0
    assert main(['replay', str(drives / 'first'), '--output', str(tmp_path / 'first'), *SET]) == 0
    assert hashes(output / 'first') == hashes(tmp_path / 'first')
    found = {path for path, time in times(output).items() if before.get(path) != time}
    assert {path for path in found if path.endswith('.mcap')} == {
        str(output / 'first' / 'first.mcap')
    }
    assert len(lines(output)) == 2


def test_a_line_that_was_cut_off_is_written_anew(drives: Path, tmp_path: Path) -> None:
    """What a killed process has left of a line is no entry; its output is in the way."""
    assert clean(drives) == 0
    output = tmp_path / 'drives_cleaned'
    break_line(drives, output)
    assert clean(drives) == 3
    entries = {entry['source']: entry for entry in lines(output)}
    assert 'must be a new folder, or one of the manifest' in entries['first']['error']


def test_other_parameters_are_another_question(drives: Path, tmp_path: Path) -> None:
    """All is replayed; not for another number of threads."""
    assert clean(drives) == 0
    output = tmp_path / 'drives_cleaned'
    first = hashes(output / 'first')
    before = times(output)
    assert clean(drives, '--set=threads=1') == 0
    assert times(output) == before
    assert clean(drives, '--set=scores=true') == 0
    assert hashes(output / 'first') != first


@pytest.mark.parametrize('name', ['version', 'model_hash'])
def test_another_version_is_another_question(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """All is replayed."""
    assert clean(drives) == 0
    before = times(tmp_path / 'drives_cleaned')
    monkeypatch.setattr(run, name, lambda *_: 'another')
    assert clean(drives) == 0
    after = times(tmp_path / 'drives_cleaned')
    files = [path for path in after if path.endswith('.mcap')]
    assert len(files) == 2
    assert all(after[path] != before[path] for path in files)


def test_a_damaged_recording_fails_alone(
    drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its sentence is in the manifest; the others are done; it is tried again."""
    (drives / 'bad.mcap').write_bytes(b'no recording')
    for _ in range(2):
        assert clean(drives) == 3
        captured = capsys.readouterr()
        assert 'bad.mcap must be readable, got' in captured.err
        assert '1 failed' in captured.out
    entry = lines(tmp_path / 'drives_cleaned')[0]
    assert (entry['state'], entry['output_hash']) == ('failed', '')
    assert 'bad.mcap must be readable, got' in entry['error']
    assert not (tmp_path / 'drives_cleaned' / 'bad').exists()


def test_nothing_to_test(drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What a replay alone says with status 3 is in manifest, table and page, again and again."""
    few = write_drive(tmp_path / 'few', 6, seed=4, points=8)
    spatial = ['--set=chain=[lof]', '--jobs=1']
    assert main(['replay', str(few), '--output', str(tmp_path / 'alone'), *spatial]) == 3
    assert 'no point of /lidar could be tested: lof needs more points' in capsys.readouterr().err
    few.rename(drives / 'few')
    for counts in ('3 replayed, 0 done before', '0 replayed, 3 done before'):
        assert main(['replay', str(drives), *spatial]) == 3
        captured = capsys.readouterr()
        sentence = f'no point of /lidar of {drives / "few"} could be tested: lof needs more points'
        assert sentence in captured.err
        assert f'{counts}, 0 failed, 1 incomplete' in captured.out
        assert '100.00%' in captured.out
    output = tmp_path / 'drives_cleaned'
    reasons = {
        Path(entry['source']).stem: entry['topics']['/lidar']['untested_because']
        for entry in lines(output)
    }
    assert reasons == {'few': 'lof needs more points', 'first': '', 'second': ''}
    assert 'no point of /lidar could be tested: lof needs more points' in (
        output / 'archive.html'
    ).read_text('utf-8')


def test_all_damaged(tmp_path: Path) -> None:
    """Where nothing is done, the exit status is that of what is refused."""
    (tmp_path / 'drives').mkdir()
    (tmp_path / 'drives' / 'bad.bag').write_bytes(b'no recording')
    assert clean(tmp_path / 'drives') == 1


def test_a_mask_that_was_learnt_anew_is_another(tmp_path: Path) -> None:
    """What its file holds decides what is written, and not its name."""
    found = []
    for name, text in (('car', 'a'), ('car', 'b'), ('bus', 'b')):
        (tmp_path / name).write_text(text)
        parameters = FilterParameters(mask=str(tmp_path / name))
        found.append(fingerprints.parameters_hash(parameters))
    assert found[0] != found[1] == found[2]
    assert fingerprints.parameters_hash(FilterParameters()) not in found


def test_any_error_costs_its_recording_only(
    drives: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whatever it is: here the memory is full."""
    known = fingerprints.content_hash

    def full(location: Any) -> str:
        if location.path.name == 'first':
            raise MemoryError
        return known(location)

    monkeypatch.setattr(one_recording, 'content_hash', full)
    assert clean(drives) == 3
    assert 'must be replayed, got' in lines(tmp_path / 'drives_cleaned')[0]['error']


def test_a_recording_that_changes_meanwhile(
    drives: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It is not taken for what it was, and has no output."""
    known = fingerprints.content_hash

    def change(location: Any) -> str:
        found = known(location)
        if location.path.name == 'first':
            with next(location.path.glob('*.mcap')).open('ab') as stream:
                stream.write(b'')
            os.utime(next(location.path.glob('*.mcap')))
        return found

    monkeypatch.setattr(one_recording, 'content_hash', change)
    assert clean(drives) == 3
    entry = lines(tmp_path / 'drives_cleaned')[0]
    assert 'must be unchanged while it is read' in entry['error']
    assert not (tmp_path / 'drives_cleaned' / 'first').exists()


def test_what_others_have_written_is_left(
    drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder that exists proves nothing, and is not ours to remove."""
    other = tmp_path / 'drives_cleaned' / 'first'
    other.mkdir(parents=True)
    (other / 'notes.txt').write_text('mine')
    assert clean(drives) == 3
    assert 'must be a new folder, or one of the manifest, got' in capsys.readouterr().err
    assert [path.name for path in other.iterdir()] == ['notes.txt']


def test_lines_of_the_readme(drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines for an archive do what they say, as they are written."""
    monkeypatch.chdir(tmp_path)
    assert drives == tmp_path / 'drives'
    readme = ROOT / 'README.md'
    found = re.findall(
        r'^lidar-outlier-filter (replay drives .*?)#', readme.read_text(), re.MULTILINE
    )
    assert len(found) == 2
    made = []
    for line in found:
        assert main([*line.split(), *SET]) == 0
        made.append(times(tmp_path / 'drives_cleaned'))
    assert made[0] == made[1]
    assert len(lines(tmp_path / 'drives_cleaned')) == 2


def test_a_pattern(drives: Path, tmp_path: Path) -> None:
    """Recordings that fit are replayed, others are not."""
    assert clean(drives / '*' / '*.mcap', '--output', str(tmp_path / 'out')) == 0
    made = {str(path.relative_to(tmp_path / 'out')) for path in (tmp_path / 'out').rglob('*.mcap')}
    assert 'tuesday/second/second.mcap' in made


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['--output={drives}/out'], 'the output must be outside of {drives}, which is searched'),
        (['--set=sor.k=none'], 'sor.k must be a whole number'),
        (['--jobs=0'], '--jobs must be at least 1, got 0'),
        (['--scheduler=tcp://x', '--jobs=2'], '--jobs must be left out with --scheduler'),
    ],
)
def test_refused_at_once(
    drives: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    """What is wrong with the command costs no recording."""
    options = [option.format(drives=drives) for option in options]
    assert main(['replay', str(drives), *options]) == 1
    assert sentence.format(drives=drives) in capsys.readouterr().err


def test_two_recordings_of_one_name(drives: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither is written over the other."""
    shutil.copy(next((drives / 'first').glob('*.mcap')), drives / 'first.mcap')
    assert clean(drives) == 1
    assert 'must be that of one recording, got' in capsys.readouterr().err


def test_one_run_at_a_time(drives: Path, tmp_path: Path) -> None:
    """A second run on the same output is refused."""
    with opened_manifest(tmp_path / 'drives_cleaned'):
        assert clean(drives) == 1
    assert clean(drives) == 0


def test_a_manifest_that_is_none(tmp_path: Path) -> None:
    """It is refused with its line, and stays."""
    (tmp_path / NAME).write_text('{"source": 1}\n')
    with pytest.raises(RecordingError, match=f'line 1 of .*{NAME} must be an entry of a manifest'):
        opened_manifest(tmp_path).__enter__()
    assert (tmp_path / NAME).read_text() == '{"source": 1}\n'


def test_several_processes_need_their_extra(
    drives: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without it one process does all, and more than one, asked for, is refused."""
    monkeypatch.setattr(workers, 'are_available', lambda: False)
    monkeypatch.setattr(command, 'SHORT', 0)
    assert main(['replay', str(drives), '--jobs', '2', *SET]) == 1
    assert 'pip install lidar_outlier_filter[archive]' in capsys.readouterr().err
    assert main(['replay', str(drives), *SET]) == 0


def test_hashes_are_of_content(tmp_path: Path) -> None:
    """A folder's hash sees the names, the order and the bytes of its files."""
    found = set()
    for number, files in enumerate([{'a': b'1', 'b': b'2'}, {'a': b'2', 'b': b'1'}, {'a': b'12'}]):
        folder = tmp_path / str(number)
        folder.mkdir()
        for name, data in files.items():
            (folder / name).write_bytes(data)
        found.add(fingerprints.content_hash(location_of(folder)))
    assert len(found) == 3


def test_entries_of_later_versions_are_read(tmp_path: Path) -> None:
    """A column that this version does not know is passed over."""
    with opened_manifest(tmp_path) as opened:
        opened.add(manifest.Entry('a', 1, 'h', 'p', 'v', 'm', 'o', 'done'))
    entry = lines(tmp_path)[0] | {'later': 1}
    (tmp_path / NAME).write_text(json.dumps(entry) + '\n')
    with opened_manifest(tmp_path) as opened:
        assert opened.entries['a'].output == 'o'
