# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Archives of recordings: what is done is skipped, changes are replayed, failures stay alone."""

import os
import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from helpers.archives import SET, content, hidden, records, replaying, tree, write_drives
from helpers.drives import hashes, rows_of_turn, topic_of, write_drive
from helpers.labelled import write

from lidar_outlier_filter.archive import jobs, run, sidecar, workers
from lidar_outlier_filter.cli import archive as command
from lidar_outlier_filter.cli import tables
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import NewBag
from lidar_outlier_filter.recordings.replay import replay

Capture = pytest.CaptureFixture[str]

DRIVES = Path('drives')
OUT = Path('out')


@pytest.fixture(autouse=True)
def drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with two recordings below ``drives``."""
    monkeypatch.chdir(tmp_path)
    write_drives(DRIVES)


def run_on(drives: Path = DRIVES, *options: str) -> int:
    """Replay an archive in this process."""
    return main(replaying(drives, OUT, *options))


def test_every_recording_is_replayed(capsys: Capture) -> None:
    """Outputs lie as the recordings do, with the bytes of a single replay; sidecars count."""
    assert run_on() == 0
    found = records(OUT)
    second = DRIVES / 'tuesday' / 'second.mcap'
    for source, name in ((DRIVES / 'first', 'first'), (second, 'tuesday/second')):
        (Path('alone') / name).parent.mkdir(parents=True, exist_ok=True)
        assert main(['replay', str(source), '--output', f'alone/{name}', SET]) == 0
        assert hashes(OUT / name) == hashes(Path('alone') / name)
        record = found[str(source.relative_to(DRIVES))]
        assert (record.output, record.state, record.error) == (name, 'done', None)
        assert record.duration == pytest.approx(0.6)
        counts = record.topics['/lidar']
        assert (counts['messages'], counts['points'], counts['gaps']) == (6, 720, 0)
        assert counts['rejected'] == sum(counts['rejected_by'].values()) > 0
        assert counts['kept'] == counts['points'] - counts['rejected']
        hashed = {name: mark.sha256 for name, mark in record.outputs.items()}
        assert hashed == {f'{name}/{file}': one for file, one in hashes(OUT / name).items()}
    assert found['tuesday/second.mcap'].source_hash == sha256(second.read_bytes()).hexdigest()
    assert '2 replayed, 0 done before, 0 failed' in capsys.readouterr().out
    assert not hidden(OUT)


def test_what_is_done_is_left(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """The same command reads no file; with other times the contents decide; copies go along."""
    assert run_on() == 0
    before = tree(OUT)
    with monkeypatch.context() as patch:
        patch.setattr(sidecar, 'file_hash', lambda _: pytest.fail('a file was read'))
        capsys.readouterr()
        assert run_on(DRIVES, '--set=threads=1') == 0
    assert '0 replayed, 2 done before, 0 failed' in capsys.readouterr().out
    for path in [*DRIVES.rglob('*.mcap'), *OUT.rglob('*.mcap')]:
        os.utime(path, ns=(10**18, 10**18))
    Path('moved').mkdir()
    shutil.move(DRIVES, 'moved')
    monkeypatch.setattr(jobs, 'replay', lambda *_: pytest.fail('a recording was replayed'))
    assert run_on(Path('moved/drives')) == 0
    assert tree(OUT) == before


def change_source() -> None:
    """Write another recording over one."""
    shutil.rmtree(DRIVES / 'first')
    write_drive(DRIVES / 'first', 6, seed=3)


def written(path: Path) -> tuple[int, int]:
    """Tell a file that was written anew; an inode alone may be used again."""
    return path.stat().st_ino, path.stat().st_mtime_ns


@pytest.mark.parametrize(
    ('change', 'options', 'count'),
    [
        (change_source, [], 1),
        (lambda: shutil.rmtree(OUT / 'first'), [], 1),
        (bool, ['--set=scores=true'], 2),
        ('code_version', [], 2),
    ],
)
def test_what_has_changed_is_replayed(
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
    change: Callable[[], object] | str,
    options: list[str],
    count: int,
) -> None:
    """And nothing else is; the outputs are those of a run without an earlier one."""
    assert run_on() == 0
    before = {path: written(path) for path in OUT.rglob('*.mcap')}
    capsys.readouterr()
    if isinstance(change, str):
        monkeypatch.setattr(jobs, change, lambda: 'another')
    else:
        change()
    assert run_on(DRIVES, *options) == 0
    assert f'{count} replayed, {2 - count} done before' in capsys.readouterr().out
    assert sum(written(path) != before[path] for path in OUT.rglob('*.mcap')) == count
    assert main(replaying(DRIVES, 'fresh', *options)) == 0
    assert content(OUT) == content(Path('fresh'))
    assert not hidden(OUT)


def test_parameters_that_decide() -> None:
    """The content of a mask decides, not its name; the options do; threads do not."""

    def of(parameters: FilterParameters, **options: object) -> str:
        return sidecar.parameters_hash(parameters, options)

    found = []
    for name, text in (('car', 'a'), ('car', 'b'), ('bus', 'b')):
        Path(name).write_text(text)
        found.append(of(FilterParameters(mask=name)))
    assert found[0] != found[1] == found[2]
    plain = FilterParameters()
    assert of(plain) == of(FilterParameters(threads=1)) not in found
    assert of(plain) != of(plain, topics=['/lidar'])
    assert sidecar.code_version() == sidecar.code_version()


def test_a_damaged_recording_fails_alone(capsys: Capture) -> None:
    """The others are done; it is tried again; where nothing is done the status is 1."""
    (DRIVES / 'bad.mcap').write_bytes(b'no recording')
    for _ in range(2):
        assert run_on() == 3
        printed = capsys.readouterr()
        assert 'bad.mcap must be readable, got' in printed.err
        assert '--salvage filters what can be read' in printed.err
        assert '1 failed' in printed.out
        assert 'bad.mcap must be readable, got' in (OUT / 'archive.html').read_text('utf-8')
    assert not (OUT / 'bad').exists()
    assert not (OUT / 'bad.json').exists()
    assert run_on(DRIVES / '*.mcap') == 1


def test_nothing_to_test(capsys: Capture) -> None:
    """What a single replay reports with status 3 an archive does, too, each time."""
    write_drive(DRIVES / 'few', 6, seed=4, points=8)
    for counts in ('3 replayed, 0 done before', '0 replayed, 3 done before'):
        assert run_on(DRIVES, '--set=chain=[lof]') == 3
        printed = capsys.readouterr()
        assert 'no point of /lidar' in printed.err
        assert 'could be tested: lof needs more points' in printed.err
        assert f'{counts}, 0 failed, 1 incomplete' in printed.out
    assert [one.source for one in records(OUT).values() if one.untested] == ['few']


def test_a_recording_without_clouds_is_no_failure(capsys: Capture) -> None:
    """It has a state of its own, and a sidecar; it is not opened again; alone it is a failure."""
    with NewBag(DRIVES / 'texts') as bag:
        bag.add(topic_of('/text', 'std_msgs/msg/String'))
    for counts in ('2 replayed, 0 done before', '0 replayed, 2 done before'):
        assert run_on() == 0
        printed = capsys.readouterr()
        assert f'{counts}, 0 failed, 0 incomplete, 1 without clouds: texts\n' in printed.out
    assert '<dt>without clouds</dt><dd>1</dd>' in (OUT / 'archive.html').read_text('utf-8')
    assert main(replaying(str(DRIVES / 't*ts'), 'other')) == 1
    shutil.rmtree(DRIVES / 'texts')
    write_drive(DRIVES / 'texts', 6, seed=2)
    assert run_on() == 0
    assert records(OUT)['texts'].state == 'done'


def test_all_clouds_refused(capsys: Capture) -> None:
    """Nothing is written, alone with a sentence; of an archive it is a failure."""
    Path('in').mkdir()
    bag = write(Path('in/bag'), {'/lidar': [rows_of_turn(1)[['x', 'time']]] * 3})
    assert main(['replay', str(bag), '--output', 'alone', SET]) == 1
    assert 'must be such that one at least can be filtered, got 3' in capsys.readouterr().err
    assert not Path('alone').exists()
    assert main(replaying('in', OUT)) == 1
    assert not records(OUT)


def test_any_error_costs_its_recording_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever it is."""
    known = sidecar.content_hash

    def fail(location: Any) -> str:
        if location.path.name == 'first':
            raise MemoryError
        return known(location)

    monkeypatch.setattr(run, 'content_hash', fail)
    assert run_on() == 3
    assert [*records(OUT)] == ['tuesday/second.mcap']
    assert not hidden(OUT)


def test_a_recording_that_changes_meanwhile(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """It has no output."""
    known = replay

    def change(path: Path, *given: Any, **more: Any) -> Any:
        report = known(path, *given, **more)
        os.utime(next(path.glob('*.mcap')) if path.is_dir() else path, ns=(1, 1))
        return report

    monkeypatch.setattr(jobs, 'replay', change)
    assert run_on() == 1
    assert 'must be unchanged while it is read' in capsys.readouterr().err
    assert not content(OUT)


@pytest.mark.parametrize(
    'name', ['first.mcap', 'archive.html.mcap', 'first.json.mcap', 'tuesday.mcap']
)
def test_names_of_outputs_that_meet(capsys: Capture, name: str) -> None:
    """Two outputs, or an output and a sidecar, the page or a folder of outputs, are refused."""
    shutil.copy(next((DRIVES / 'first').glob('*.mcap')), DRIVES / name)
    assert run_on() == 1
    said = capsys.readouterr().err
    assert 'the output ' in said
    assert str(Path(name).stem) in said
    assert not OUT.exists()


def test_names_that_are_no_text(capsys: Capture) -> None:
    """A name in other bytes than UTF-8 gives a row, a sidecar and a link, or a sentence."""
    name = os.fsdecode(b'caf\xe9.mcap')
    shutil.copy(DRIVES / 'tuesday' / 'second.mcap', DRIVES / name)
    (DRIVES / 'first' / f'{name}.txt').touch()
    status = run_on()
    printed = capsys.readouterr()
    assert 'Traceback' not in printed.err
    assert (OUT / 'tuesday' / 'second').is_dir()
    assert 'first' in records(OUT)
    assert status == (0 if name in records(OUT) else 3)
    assert r'caf\udce9' in (OUT / 'archive.html').read_text('utf-8')


def test_several_processes_need_their_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Without it one process does all, and more than one, asked for, is refused."""
    monkeypatch.setattr(workers, 'are_available', lambda: False)
    monkeypatch.setattr(command, 'MIN_SHARED_BYTES', 0)
    assert run_on(DRIVES, '--jobs=2') == 1
    assert 'pip install lidar_outlier_filter[archive]' in capsys.readouterr().err
    assert main(['replay', 'drives', '--output', 'out', SET]) == 0


def test_the_table(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """It fits 80 columns with every digit and every letter; of very many it shows failed ones."""
    name = 'a_recording_with_a_long_name_' + 'x' * 40
    (DRIVES / 'first').rename(DRIVES / name)
    (DRIVES / 'zz.mcap').write_bytes(b'no recording')
    monkeypatch.setenv('COLUMNS', '80')
    known = jobs._counts

    def many(topic: Any) -> dict[str, Any]:
        large = {'messages': 123_456, 'refused': 12_345, 'gaps': 12_345, 'points': 9_876_543_210}
        return known(topic) | large

    monkeypatch.setattr(jobs, '_counts', many)
    assert run_on() == 3
    table = capsys.readouterr().out.partition('written to')[0]
    assert max(map(len, table.splitlines())) <= 80
    for text in ('123,456', ' 12,345 ', '9,876,543,210', 'recording', 'rejected', 'untested'):
        assert text in table
    assert name in ''.join(line.split()[0] for line in table.splitlines() if line.strip())
    monkeypatch.setattr(tables, 'MAX_ROWS', 1)
    assert run_on() == 3
    printed = capsys.readouterr().out
    assert '2 more are on the page' in printed
