# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged recordings: what can be read is filtered, what is lost is counted, no verdict changes."""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
import time
from itertools import permutations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.damaged import (
    CLOUD,
    COUNT,
    FAST,
    JAZZY,
    KINDS,
    PERIOD,
    TEXT,
    TOPICS,
    Damage,
    check,
    content,
    damages,
    inflict,
    is_near,
    salvage,
    write_recording,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import LATEST, NewBag, Recording, Topic
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.recordings.salvage.losses import MOST, Losses
from lidar_outlier_filter.recordings.salvage.sqlite import DamagedDatabase

if TYPE_CHECKING:
    from helpers.damaged import Content


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
    report = salvage(drives[kind], tmp_path / 'out')
    assert report is not None
    assert report.is_complete
    assert report.lost == Losses()
    assert content(tmp_path / 'out') == unbroken
    with Recording(tmp_path / 'out') as recording:
        custom = {'robot': 'seven'} if drives[kind].is_dir() else {}
        assert recording.custom_data == custom
    assert [path.name for path in tmp_path.iterdir()] == ['out']


@pytest.mark.parametrize('kind', KINDS)
def test_cut_off(drives: dict[str, Path], unbroken: Content, tmp_path: Path, kind: str) -> None:
    """Cut off anywhere, a recording is refused by itself, and gives a beginning if it is salvaged.

    In the order of the recording, each message that comes out is before each that is lost.
    """
    counts = []
    for i in range(3):
        folder = tmp_path / f'{i}'
        folder.mkdir()
        recording = copied(drives[kind], folder)
        inflict(recording, Damage('cut', (i + 0.6) / 3, 0))
        report = check(recording, folder / 'out', unbroken)
        if report is None:
            continue
        assert not report.is_complete
        found = content(folder / 'out')
        counts.append(len(found['/lidar']))
        if kind != 'folder split':  # which has lost a part of its middle
            assert found['/lidar'] == unbroken['/lidar'][: counts[-1]]
            assert found.get('/text', []) == unbroken['/text'][: len(found.get('/text', []))]
        if kind.startswith('folder'):
            lost = 2 * COUNT - counts[-1] - len(found.get('/text', []))
            assert report.lost.messages == lost
    assert counts == sorted(counts)
    assert kind.startswith('folder') or (len(counts) > 1 and counts[-1] > counts[0])


@pytest.mark.parametrize('kind', ['mcap', 'mcap zstd'])
def test_whole_chunks_come_out(
    drives: dict[str, Path], unbroken: Content, tmp_path: Path, kind: str
) -> None:
    """Of an MCAP file that was cut off, the messages of its whole chunks come out.

    Of the chunk that was cut, its whole messages come out if it is not compressed. Equal are the
    answers to all clouds but those within a block and its halo of the lost ones.
    """
    data = drives[kind].read_bytes()
    with drives[kind].open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    order = [(topic, unbroken[topic][i]) for i in range(COUNT) for topic in ('/text', '/lidar')]
    path, output = tmp_path / 'drive.mcap', tmp_path / 'out'
    for share in (0.3, 0.5, 0.7):
        cut = int(share * len(data))
        path.write_bytes(data[:cut])
        chunks = summary.chunk_indexes
        whole = 4 * sum(one.chunk_start_offset + one.chunk_length <= cut for one in chunks)
        assert whole > 0
        report = check(path, output, unbroken)
        assert report is not None
        found = content(output)
        count = len(found['/lidar']) + len(found['/text'])
        assert whole <= count <= whole + (3 if kind == 'mcap' else 0)
        for topic in ('/lidar', '/text'):
            assert found[topic] == [one for name, one in order[:count] if name == topic]
        lost = [i * PERIOD for i in range(len(found['/lidar']), COUNT)]
        same = [time for time, _ in found['/lidar'] if not is_near(time, lost)]
        assert len(same) == len(found['/lidar']) - 1
        shutil.rmtree(output)


@pytest.mark.parametrize('harm', ['body', 'head', 'disguise'])
def test_behind_a_damaged_chunk(drives: dict[str, Path], tmp_path: Path, harm: str) -> None:
    """All other chunks come out, and what only looks like a message among the bytes is none.

    The summary is cut off: what is lost is counted by the index behind the chunk.
    """
    path = copied(drives['mcap zstd'], tmp_path)
    data, chunks, offset = bytearray(path.read_bytes()), [], 8
    while data[offset] != 15:  # the end of the data
        (length,) = struct.unpack_from('<Q', data, offset + 1)
        if data[offset] == 6:
            chunks.append((offset, offset + 9 + length))
        offset += 9 + length
    (begin, end), (following, _) = chunks[1:3]
    first, last = struct.unpack_from('<QQ', data, begin + 9)
    if harm == 'body':
        data[end - 1] ^= 255
    else:
        data[begin] = 255
    if harm == 'disguise':
        at = begin + 60
        struct.pack_into('<BQHIQQ', data, at, 5, following + 20 - at - 9, 999, 0, 0, 0)
    path.write_bytes(data[:offset])
    report = salvage(path, tmp_path / 'out')
    assert report is not None
    whole, found = content(drives['mcap zstd']), content(tmp_path / 'out')
    for topic in TOPICS:
        others = {time for time, _ in whole[topic] if not first <= time <= last}
        assert others <= {time for time, _ in found[topic]} < {time for time, _ in whole[topic]}
    if harm == 'body':
        assert report.lost.messages == 2 * COUNT - sum(len(found[topic]) for topic in TOPICS)
    assert not any('999' in reason for reason in report.lost.reasons)


def records_of_a_bag(data: bytes | bytearray) -> list[tuple[int, int, int]]:
    """List the records of a ROS 1 bag: what they are, where they begin and where their data do."""
    records, offset = [], len(b'#ROSBAG V2.0\n')
    while offset < len(data):
        (length,) = struct.unpack_from('<I', data, offset)
        begin = offset + 4 + length
        header = data[offset + 4 : begin]
        records.append((header[header.index(b'op=') + 3], offset, begin + 4))
        offset = begin + 4 + struct.unpack_from('<I', data, begin)[0]
    return records


@pytest.mark.parametrize(
    ('harm', 'order'), [('body', (0, 1, 2)), *(('head', order) for order in permutations(range(3)))]
)
def test_behind_a_damaged_chunk_of_ros1(
    drives: dict[str, Path], tmp_path: Path, harm: str, order: tuple[int, ...]
) -> None:
    """All other chunks come out, whatever the order of the fields in the header of the next one.

    What follows the chunks is cut off, so that a lost one is counted by the header of the bag, and
    its messages by their index behind it.
    """
    path = copied(drives['bag bz2'], tmp_path)
    data = bytearray(path.read_bytes())
    records = records_of_a_bag(data)
    chunks = [k for k, (kind, *_) in enumerate(records) if kind == 5]
    end = records[next(k for k in range(chunks[-1], len(records)) if records[k][0] == 7)][1]
    (_, begin, inside), (_, following, behind) = (records[k] for k in chunks[1:3])
    fields = ros1_fields(bytes(data[following + 4 : behind - 4]))
    data[following + 4 : behind - 4] = b''.join(fields[k] for k in order)
    data[inside if harm == 'body' else begin] ^= 255
    path.write_bytes(data[:end])
    report = salvage(path, tmp_path / 'out')
    assert report is not None
    assert report.lost.chunks == 1
    found = sum(len(content(tmp_path / 'out')[topic]) for topic in TOPICS)
    assert 0 < 2 * COUNT - found <= 4
    if harm == 'body':
        assert report.lost.messages == 2 * COUNT - found


def test_messages_of_a_lost_connection(drives: dict[str, Path], tmp_path: Path) -> None:
    """Where no record says what a connection of a ROS 1 bag is, its messages are lost.

    They are counted one by one: what follows the chunks, and counts them, is cut off.
    """
    path = copied(drives['bag'], tmp_path)
    data = path.read_bytes()
    end = next(offset for kind, offset, _ in records_of_a_bag(data) if kind == 7)
    known = re.compile(b'conn=....(?=....topic=/text)', re.DOTALL)
    data, count = known.subn(b'conn=\x63\0\0\0', data[:end])
    assert count
    path.write_bytes(data)
    report = salvage(path, tmp_path / 'out')
    assert report is not None
    assert report.lost.messages == COUNT
    found = content(tmp_path / 'out')
    assert (len(found['/lidar']), len(found.get('/text', []))) == (COUNT, 0)


def ros1_fields(header: bytes) -> list[bytes]:
    """Cut the header of a record of a ROS 1 bag into its fields, each with its length."""
    fields = []
    while header:
        end = 4 + struct.unpack_from('<I', header)[0]
        fields.append(header[:end])
        header = header[end:]
    return fields


def test_flipped_bytes(drives: dict[str, Path], unbroken: Content, tmp_path: Path) -> None:
    """A byte that is flipped in a chunk with a checksum costs this chunk, and no other."""
    data = drives['mcap'].read_bytes()
    rng = np.random.default_rng(1)
    counts = set()
    for offset in rng.integers(600, len(data) - 3000, 25):
        path = tmp_path / 'drive.mcap'
        path.write_bytes(data[:offset] + bytes([data[offset] ^ 85]) + data[offset + 1 :])
        report = check(path, tmp_path / 'out', unbroken)
        assert report is not None
        found = content(tmp_path / 'out')
        assert all(set(found[topic]) <= set(unbroken[topic]) for topic in ('/lidar', '/text'))
        counts.add(2 * COUNT - len(found['/lidar']) - len(found['/text']))
        assert report.lost.chunks <= 1
        assert report.lost.size < 6000
        shutil.rmtree(tmp_path / 'out')
    assert max(counts) == 4


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
    """Whatever is done to a recording, nothing is lost quietly, and the output is whole."""
    folder = tmp_path_factory.mktemp('any')
    recording = copied(drives[kind], folder)
    for damage in broken:
        inflict(recording, damage)
    check(recording, folder / 'out', unbroken)
    shutil.rmtree(folder)


# What else may be missing -------------------------------------------------------------------------


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """Return what was written to stderr, without breaks of lines."""
    return capsys.readouterr().err


def test_command(
    drives: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --salvage the sentence of refusal names it; with it the exit status is 3."""
    path, output = copied(drives['mcap'], tmp_path), tmp_path / 'out'
    path.write_bytes(path.read_bytes()[:20_000])
    command = ['replay', str(path), '--output', str(output), '--set', 'chain=[sor]']
    assert main(command) == 1
    refusal = said(capsys)
    assert 'must be readable, got "' in refusal
    assert refusal.endswith('; --salvage filters what can be read of it\n')
    assert refusal.count('\n') == 1
    assert not output.exists()
    assert main([*command, '--salvage']) == 3
    losses = said(capsys)
    assert 'lost of the recording are at least 0 messages, 0 chunks, ' in losses
    assert 'drive.mcap: it ends at byte 20000 without a footer' in losses
    assert len(content(output)['/lidar/cleaned']) == 8
    assert sorted(one.name for one in tmp_path.iterdir()) == ['drive.mcap', 'out']


@pytest.mark.parametrize('name', ['missing.mcap', 'words.txt', 'empty', 'empty.mcap', 'noise.db3'])
def test_nothing_to_salvage(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """What is no recording, or has no cloud left, is refused, salvaged or not."""
    (tmp_path / 'words.txt').write_text('hello')
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'empty.mcap').touch()
    (tmp_path / 'noise.db3').write_bytes(bytes(range(256)) * 40)
    before = sorted(tmp_path.iterdir())
    for more in ([], ['--salvage']):
        assert main(['replay', str(tmp_path / name), '--output', str(tmp_path / 'out'), *more]) == 1
        sentence = said(capsys)
        assert sentence.count('\n') == 1
        assert ' must be ' in sentence
        assert sorted(tmp_path.iterdir()) == before


def test_too_large(drives: dict[str, Path], tmp_path: Path) -> None:
    """Messages that are larger than allowed are refused, or lost and counted; so are chunks."""
    command = ['replay', str(drives['db3']), '--output', str(tmp_path / 'out')]
    assert main([*command, '--largest-message', '0']) == 1
    output = tmp_path / 'out'
    for kind in ('mcap', 'bag'):
        with pytest.raises(RecordingError, match='of at most 1500'):
            replay(drives[kind], output, parameters=FAST, largest=1500)
        report = replay(drives[kind], output, parameters=FAST, largest=1500, salvage=True)
        assert report.lost.messages == 2 * COUNT
        assert report.lost.chunks > 1
        assert not any(content(output).values())
        shutil.rmtree(output)
    with pytest.raises(RecordingError, match='of at most 1500'):
        replay(drives['db3'], output, parameters=FAST, largest=1500)
    report = replay(drives['db3'], output, parameters=FAST, largest=1500, salvage=True)
    assert report.lost.messages == COUNT
    assert len(content(output)['/text']) == COUNT


@pytest.mark.parametrize('kind', ['folder', 'folder split', 'folder db3', 'folder file'])
def test_without_metadata(
    drives: dict[str, Path], unbroken: Content, tmp_path: Path, kind: str
) -> None:
    """Without metadata.yaml all messages are found; it is said that it is missing."""
    recording = copied(drives[kind], tmp_path)
    inflict(recording, Damage('metadata', 0, 0))
    report = check(recording, tmp_path / 'out', unbroken)
    assert report is not None
    assert report.lost == Losses(reasons=['metadata.yaml is missing, or empty'])
    assert content(tmp_path / 'out') == unbroken


def test_without_a_part(drives: dict[str, Path], unbroken: Content, tmp_path: Path) -> None:
    """Where a file of several is missing, the others are filtered, and its messages counted."""
    recording = copied(drives['folder split'], tmp_path)
    inflict(recording, Damage('missing', 0, 0))
    report = check(recording, tmp_path / 'out', unbroken)
    assert report is not None
    assert report.lost.messages == 8
    assert report.lost.reasons[0] == 'part_1.mcap is missing'
    assert len(content(tmp_path / 'out')['/lidar']) == COUNT - 4


@pytest.mark.parametrize('known', [True, False])
def test_without_schema(drives: dict[str, Path], tmp_path: Path, *, known: bool) -> None:
    """Where the schema of a topic is lost, metadata say its type, or its messages are lost."""
    recording = copied(drives['folder'], tmp_path)
    (path,) = recording.glob('*.mcap')
    name = struct.pack('<I', len(TEXT)) + TEXT.encode()
    data = path.read_bytes()
    assert data.count(name) == 2
    path.write_bytes(data.replace(name, struct.pack('<I', 2**31) + TEXT.encode()))
    if not known:
        inflict(recording, Damage('metadata', 0, 0))
    report = salvage(recording, tmp_path / 'out')
    if report is None:
        return
    assert report.lost.reasons


def test_rows_are_those_of_sqlite(drives: dict[str, Path], recordings: Path) -> None:
    """Each row is found as SQLite finds it, with rows that need one page or several."""
    paths = [drives['db3'], *sorted((recordings / 'bags').glob('vlp*_db3/*.db3'))]
    for path in paths:
        losses = Losses()
        database = DamagedDatabase(path, 10**9, losses)
        with sqlite3.connect(path) as whole:
            rows = whole.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id')
            assert list(database.messages()) == rows.fetchall()
            names = whole.execute('SELECT id, name, type FROM topics ORDER BY id').fetchall()
        whole.close()
        assert [(c.id, c.topic, c.msgtype) for c in database.connections] == names
        assert losses == Losses()


@pytest.mark.parametrize('page', [512, 1024, 65536])
def test_pages_of_any_size(drives: dict[str, Path], tmp_path: Path, page: int) -> None:
    """Rows in small and large pages are the same."""
    path = copied(drives['db3'], tmp_path)
    expected = list(DamagedDatabase(path, 10**9, Losses()).messages())
    with sqlite3.connect(path) as database:
        database.execute(f'PRAGMA page_size = {page}')
    database.execute('VACUUM')
    database.close()
    losses = Losses()
    assert list(DamagedDatabase(path, 10**9, losses).messages()) == expected
    assert losses == Losses()


def test_rows_of_a_lost_page(drives: dict[str, Path], tmp_path: Path) -> None:
    """Rows of a page that was zeroed are counted by the gap in the numbers of the others."""
    path = copied(drives['db3'], tmp_path)
    whole = DamagedDatabase(path, 10**9, Losses())
    page = whole._rows[COUNT].page
    lost = sum(message.page == page for message in whole._rows.values())
    data = bytearray(path.read_bytes())
    data[page * whole._page - whole._page : page * whole._page] = bytes(whole._page)
    path.write_bytes(data)
    report = salvage(path, tmp_path / 'out')
    assert report is not None
    found = sum(len(content(tmp_path / 'out')[topic]) for topic in TOPICS)
    assert report.lost.messages == 2 * COUNT - found == lost


PAGE, LEAVES, OVERFLOW = 512, 500, 4000  # bytes; pages of rows, and pages that all of them share
LONG = 39 + OVERFLOW * (PAGE - 4)  # bytes of such a row: 39 are in its cell
HEADS = {  # of rows: its length, a type for each column, and the first columns
    'messages': b'\x05\0\1\1\x0c' + b'\1\1',  # row, topic, time, and no bytes
    'definitions': b'\x09\0\x13\x1b' + b'\xfa\x89\x0d' + b'\x0d\x0d' + b'a/Bros2msg',
}


@pytest.mark.parametrize('kind', HEADS)
def test_rows_that_share_their_pages(tmp_path: Path, kind: str) -> None:
    """The pages are not read again for each row: the time would be rows times pages."""
    path, first = tmp_path / 'drive.db3', LEAVES + 2
    with path.open('wb') as stream:
        stream.write(b'SQLite format 3\0' + struct.pack('>H', PAGE) + bytes(PAGE - 18))
        for leaf in range(LEAVES):
            stream.write(leaf_page(HEADS[kind], range(10 * leaf + 128, 10 * leaf + 138), first))
        for page in range(first, first + OVERFLOW):
            following = page + 1 if page + 1 < first + OVERFLOW else 0
            stream.write(struct.pack('>I', following) + b'a' * (PAGE - 4))
    losses, begin = Losses(), time.process_time()
    assert list(DamagedDatabase(path, 10**9, losses).messages()) == []
    assert time.process_time() - begin < 5
    first_one = {
        'messages': 'row 128 has lost pages',
        'definitions': 'row 129 of page 2 is damaged',
    }
    assert losses.reasons[0] == f'drive.db3: {first_one[kind]}'
    assert len(losses.reasons) == MOST
    assert losses.more + MOST >= 10 * LEAVES - 1
    assert losses.messages == {'messages': 10 * LEAVES, 'definitions': 0}[kind]


def leaf_page(head: bytes, rows: range, overflow: int) -> bytes:
    """Make a page of rows that begin alike, and go on at the same page."""
    cells = [
        varint(LONG) + varint(row) + head.ljust(39, b'a') + struct.pack('>I', overflow)
        for row in rows
    ]
    begin = PAGE - sum(map(len, cells))
    offsets = [begin + i * len(cells[0]) for i in range(len(cells))]
    start = struct.pack('>BHHHB', 13, 0, len(cells), begin, 0)
    return (start + struct.pack(f'>{len(cells)}H', *offsets)).ljust(begin, b'\0') + b''.join(cells)


def varint(number: int) -> bytes:
    """Write a number as SQLite does: seven bits a byte, all but the last with the eighth set."""
    data = bytes([number & 127])
    while number := number >> 7:
        data = bytes([number & 127 | 128]) + data
    return data


def test_times_that_cannot_be(drives: dict[str, Path], tmp_path: Path) -> None:
    """A message of a time before 1970, which no bag can have, is lost and counted."""
    path = copied(drives['db3'], tmp_path)
    with sqlite3.connect(path) as database:
        database.execute('UPDATE messages SET timestamp = -5 WHERE id = 3')
        database.execute('UPDATE messages SET timestamp = ? WHERE id = 5', (LATEST,))
    database.close()
    report = salvage(path, tmp_path / 'out')
    assert report is not None
    assert report.lost == Losses(1, reasons=['a message of /text has the time -5 ns'])
    assert LATEST in [time for time, _ in content(tmp_path / 'out')['/text']]


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


def test_no_messages_at_all(tmp_path: Path) -> None:
    """A recording with a topic of clouds and no message gives an output without one."""
    with NewBag(tmp_path / 'drive') as bag:
        bag.add(Topic('/lidar', CLOUD, JAZZY.generate_msgdef(CLOUD, ros_version=2)[0], ''))
    for number, more in enumerate((False, True)):
        output = tmp_path / f'out{number}'
        report = replay(tmp_path / 'drive', output, parameters=FAST, salvage=more)
        assert report.is_complete
        assert not any(content(output).values())


def test_two_layouts_on_one_topic(drives: dict[str, Path], tmp_path: Path) -> None:
    """Clouds of two layouts share a topic: each comes out in its own, cut off or not."""
    path = tmp_path / 'drive.mcap'
    with Recording(drives['mcap']) as source, NewBag(tmp_path / 'both') as bag:
        for topic in source.topics:
            bag.add(topic)
        for topic, time, data in source.messages():
            bag.write(
                topic, time, wider(data) if topic.msgtype == CLOUD and time % 200_000_000 else data
            )
    (tmp_path / 'both' / 'both.mcap').rename(path)
    whole = replay(path, tmp_path / 'whole', parameters=FAST)
    assert whole.is_complete
    path.write_bytes(path.read_bytes()[:-200])
    report = salvage(path, tmp_path / 'out')
    assert report is not None
    assert report.lost.messages == 0
    assert content(tmp_path / 'out') == content(tmp_path / 'whole')


def wider(data: bytes) -> bytes:
    """Give each point of a cloud four bytes more, which no field has."""
    cloud = JAZZY.deserialize_cdr(data, CLOUD)
    rows = cloud.data.reshape(-1, cloud.point_step)  # type: ignore[attr-defined]
    cloud.data = np.pad(rows, ((0, 0), (0, 4))).reshape(-1)  # type: ignore[attr-defined]
    cloud.point_step += 4  # type: ignore[attr-defined]
    cloud.row_step = cloud.point_step * cloud.width  # type: ignore[attr-defined]
    return bytes(JAZZY.serialize_cdr(cloud, CLOUD))
