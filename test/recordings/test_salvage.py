# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged recordings: the readable part is filtered as before, and losses are counted."""

import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from helpers.cloud_files import patch
from helpers.damaged import (
    COUNT,
    FAST,
    KINDS,
    TOPICS,
    Content,
    Damage,
    check,
    content,
    damages,
    inflict,
    salvage,
    write_recording,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import PREFIX, Recording
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.recordings.salvage import MAX_KEPT_REASONS, Losses

PACKED = 'folder file'  # which must be unpacked before it is salvaged


@pytest.fixture(scope='module')
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Write the drive in each kind of recording."""
    return {kind: write_recording(kind, tmp_path_factory.mktemp('drive')) for kind in KINDS}


@pytest.fixture(scope='module')
def unbroken(drives: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Content:
    """Read what the replay of the undamaged drive has, which is the same for each kind."""
    output = tmp_path_factory.mktemp('unbroken') / 'out'
    replay(drives['mcap'], output, parameters=FAST)
    return content(output)


def copied(recording: Path, folder: Path) -> Path:
    """Copy a recording to where it may be damaged."""
    target = folder / recording.name
    if recording.is_dir():
        return shutil.copytree(recording, target)
    return Path(shutil.copyfile(recording, target))


@pytest.mark.parametrize('kind', KINDS)
def test_undamaged(drives: dict[str, Path], unbroken: Content, tmp_path: Path, kind: str) -> None:
    """Nothing is lost of a recording that is whole: the same messages, the same verdicts."""
    if kind == PACKED:
        with pytest.raises(RecordingError, match='must be unpacked, as by `zstd -d`'):
            replay(drives[kind], tmp_path / 'out', parameters=FAST, salvage=True)
        return
    report = salvage(drives[kind], tmp_path / 'out')
    assert report is not None
    assert report.is_complete
    assert report.lost == Losses()
    assert content(tmp_path / 'out') == unbroken
    with Recording(tmp_path / 'out') as recording:
        custom = {'robot': 'seven'} if drives[kind].is_dir() else {}
        kept = dict(recording.custom_data)
        assert kept.pop(f'{PREFIX}replay')
        assert kept == custom
    assert [path.name for path in tmp_path.iterdir()] == ['out']


@pytest.mark.parametrize('kind', KINDS)
def test_cut_off(drives: dict[str, Path], unbroken: Content, tmp_path: Path, kind: str) -> None:
    """Cut off anywhere, a recording is refused by itself, and gives a beginning if it is salvaged.

    Of a folder, every lost message is counted.
    """
    counts = []
    for i in range(3):
        folder = tmp_path / f'{i}'
        folder.mkdir()
        recording = copied(drives[kind], folder)
        inflict(recording, Damage('cut', (i + 0.6) / 3, 0))
        tool = '`rosbag reindex`' if kind.startswith('bag') else ' must be '
        with pytest.raises(RecordingError, match=tool):
            replay(recording, folder / 'out', parameters=FAST)
        report = check(recording, folder / 'out', unbroken)
        if report is None:
            continue
        assert not report.is_complete
        found = content(folder / 'out')
        counts.append(len(found['/lidar']))
        if kind != 'folder split':  # which has lost a part of its middle
            assert found['/lidar'] == unbroken['/lidar'][: counts[-1]]
        if kind.startswith('folder'):
            lost = 2 * COUNT - counts[-1] - len(found.get('/text', []))
            assert report.lost.messages == lost
    assert counts == sorted(counts)
    assert counts or kind.startswith(('bag', 'folder', 'db3'))


@pytest.mark.parametrize('has_summary', [True, False])
@pytest.mark.parametrize('harm', ['body', 'head'])
def test_behind_a_damaged_chunk(
    drives: dict[str, Path], unbroken: Content, tmp_path: Path, harm: str, *, has_summary: bool
) -> None:
    """Other chunks are salvaged, behind a broken length by the summary; losses are counted.

    Without a summary the index behind a chunk counts its messages.
    """
    path = copied(drives['mcap zstd'], tmp_path)
    data, chunks, offset = bytearray(path.read_bytes()), [], 8
    while data[offset] != 15:  # the end of the data
        (length,) = struct.unpack_from('<Q', data, offset + 1)
        if data[offset] == 6:
            chunks.append((offset, offset + 9 + length))
        offset += 9 + length
    begin, end = chunks[1]
    if harm == 'body':
        data[end - 1] ^= 255
    else:
        data[begin + 1 : begin + 9] = b'\xff' * 8
    path.write_bytes(data if has_summary else data[:offset])
    report = check(path, tmp_path / 'out', unbroken)
    assert report is not None
    found = sum(len(content(tmp_path / 'out')[topic]) for topic in TOPICS)
    if harm == 'body' or has_summary:
        assert report.lost.messages == 2 * COUNT - found == 4
    else:
        assert found == 4
    assert report.lost.chunks == (harm == 'body')


@settings(
    max_examples=15,
    deadline=None,
    database=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(kind=st.sampled_from(KINDS), broken=damages())
def test_any_damage(
    drives: dict[str, Path],
    unbroken: Content,
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    broken: list[Damage],
) -> None:
    """With any damage, no loss is silent, and the output is complete."""
    folder = tmp_path_factory.mktemp('any')
    recording = copied(drives[kind], folder)
    for damage in broken:
        inflict(recording, damage)
    check(recording, folder / 'out', unbroken)
    shutil.rmtree(folder)


def test_command(
    drives: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --salvage the sentence of refusal names it; with it the exit status is 3."""
    path, output = copied(drives['mcap'], tmp_path), tmp_path / 'out'
    path.write_bytes(path.read_bytes()[:24_000])
    command = ['replay', str(path), '--output', str(output), '--set', 'chain=[sor]']
    assert main(command) == 1
    refusal = capsys.readouterr().err
    assert refusal.endswith('; --salvage filters what can be read of it\n')
    assert refusal.count('\n') == 1
    assert not output.exists()
    assert main([*command, '--salvage']) == 3
    losses = capsys.readouterr().err
    assert 'lost of the recording: at least ' in losses
    assert 'drive.mcap: no complete record at byte ' in losses
    assert len(content(output)['/lidar/cleaned']) == 8
    assert sorted(one.name for one in tmp_path.iterdir()) == ['drive.mcap', 'out']


def test_what_is_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files and folders that are something else, or nothing, are refused, salvaged or not."""
    for suffix in ('bag', 'mcap', 'db3'):
        (tmp_path / f'empty.{suffix}').touch()
        (tmp_path / f'noise.{suffix}').write_bytes(bytes(range(256)) * 40)
    (tmp_path / 'words.txt').write_text('hello')
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'broken').mkdir()
    (tmp_path / 'broken' / 'metadata.yaml').write_text('rosbag2_bagfile_information:\n  - [')
    before = sorted(tmp_path.iterdir())
    for path in (*before, tmp_path / 'missing.mcap', tmp_path / 'missing'):
        command = ['replay', str(path), '--output', str(tmp_path / 'out')]
        for more in ([], ['--salvage']):
            assert main([*command, *more]) == 1
            sentence = capsys.readouterr().err
            assert sentence.count('\n') == 1
            assert ' must be ' in sentence
            assert '/.' not in sentence  # the name of a hidden folder
            assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize('kind', ['mcap', 'db3'])
def test_too_large(drives: dict[str, Path], tmp_path: Path, kind: str) -> None:
    """Chunks and messages that are larger than allowed are refused, or lost and counted."""
    output = tmp_path / 'out'
    with pytest.raises(RecordingError, match='of at most 1500'):
        replay(drives[kind], output, parameters=FAST, largest=1500)
    report = replay(drives[kind], output, parameters=FAST, largest=1500, salvage=True)
    found = sum(map(len, content(output).values()))
    assert report.lost.messages == 2 * COUNT - found > 0


def break_chunk(path: Path) -> None:
    """Break a chunk of a ROS 1 bag so that it cannot be unpacked: what comes before is read."""
    data = bytearray(path.read_bytes())
    at = data.index(b'BZh', len(data) // 2)
    data[at + 20 : at + 40] = bytes(20)
    path.write_bytes(data)


def lose_page(path: Path) -> None:
    """Zero a page of a database: its rows are counted by the number of the last one."""
    with closing(sqlite3.connect(path)) as database:
        pages = "SELECT pageno FROM dbstat WHERE name = 'messages' AND pagetype = 'leaf'"
        try:
            page = database.execute(pages).fetchall()[2][0]
        except sqlite3.OperationalError:  # SQLite may be built without it
            page = 12
        (size,) = database.execute('PRAGMA page_size').fetchone()
    patch(path, page * size - size, bytes(size))


def set_back(path: Path) -> None:
    """Give a message a time before 1970, which no bag can have."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute('UPDATE messages SET timestamp = -5 WHERE id = 3')


def lose_part(recording: Path) -> None:
    """Remove a file of several."""
    inflict(recording, Damage('missing', 0, 0))


@pytest.mark.parametrize(
    ('kind', 'harm'),
    [('bag bz2', break_chunk), ('db3', lose_page), ('db3', set_back), ('folder split', lose_part)],
)
def test_losses_are_counted(
    drives: dict[str, Path],
    unbroken: Content,
    tmp_path: Path,
    kind: str,
    harm: Callable[[Path], None],
) -> None:
    """Whatever is lost, the others are filtered."""
    recording = copied(drives[kind], tmp_path)
    harm(recording)
    report = check(recording, tmp_path / 'out', unbroken)
    assert report is not None
    found = sum(len(content(tmp_path / 'out')[topic]) for topic in TOPICS)
    assert report.lost.messages == 2 * COUNT - found > 0
    assert found > 0
    assert report.lost.reasons[0] == 'part_1.mcap is missing' or harm is not lose_part


def test_log_of_a_database(drives: dict[str, Path], unbroken: Content, tmp_path: Path) -> None:
    """Messages that are still in the log beside a database are read; the input stays as it is."""
    path = copied(drives['db3'], tmp_path)
    open_one = sqlite3.connect(path)
    open_one.execute('PRAGMA journal_mode = WAL')
    open_one.execute('PRAGMA wal_autocheckpoint = 0')
    with open_one:
        open_one.execute(
            'INSERT INTO messages VALUES (NULL, 2, 5000000000, ?)', (b'\0\1\0\0\1\0\0\0\0',)
        )
    folder = tmp_path / 'crashed'
    folder.mkdir()
    for file in tmp_path.glob('drive.db3*'):
        shutil.copyfile(file, folder / file.name)
    open_one.close()
    before = {file: file.read_bytes() for file in folder.iterdir()}
    assert len(before) > 1
    report = salvage(folder / 'drive.db3', tmp_path / 'out')
    assert report is not None
    assert 'not closed by its recorder' in report.lost.reasons[0]
    found = content(tmp_path / 'out')
    assert found['/lidar'] == unbroken['/lidar']
    assert len(found['/text']) == COUNT + 1
    assert {file: file.read_bytes() for file in folder.iterdir()} == before


def test_many_losses() -> None:
    """However many losses there are, all are counted, and the first are kept."""
    losses = Losses()
    for number in range(MAX_KEPT_REASONS + 5):
        losses.add(f'the topic /{number}\n', messages=2)
    assert losses.messages == 2 * MAX_KEPT_REASONS + 10
    assert losses.said(2) == ['the topic /0', 'the topic /1', f'and {MAX_KEPT_REASONS + 3} more']
