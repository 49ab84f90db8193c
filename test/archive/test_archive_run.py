# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Runs over an archive: what is counted, what it says in its table and at its end."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.drives import rows_of_turn, topic_of, write_drive
from helpers.labelled import write

from lidar_outlier_filter.archive import one_recording
from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.manifest import NAME
from lidar_outlier_filter.cli import archive_progress, archive_tables
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import NewBag, Recording
from lidar_outlier_filter.recordings.message_times import count_times

if TYPE_CHECKING:
    from pathlib import Path

    Capture = pytest.CaptureFixture[str]

FAST = ['--chain', 'elevation', '--jobs', '1']


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    """Write a drive with clouds and one of texts alone."""
    folder = tmp_path / 'drives'
    folder.mkdir()
    write_drive(folder / 'first', 6, seed=1)
    write_texts(folder / 'texts')
    return folder


def write_texts(path: Path) -> None:
    """Write a recording without clouds."""
    with NewBag(path) as bag:
        bag.add(topic_of('/text', 'std_msgs/msg/String'))


def states(folder: Path) -> dict[str, str]:
    """Read the state of each recording."""
    lines = map(json.loads, (folder / NAME).read_text('utf-8').splitlines())
    return {line['source']: line['state'] for line in lines}


def test_a_recording_without_clouds_is_no_failure(
    drives: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """It has a state of its own, in manifest, table and page; it is not opened again."""
    monkeypatch.setattr(archive_progress, 'LINE_PERIOD', 0)
    output = drives.with_name('drives_cleaned')
    for counts in ('1 replayed, 0 done before', '0 replayed, 1 done before'):
        assert main(['replay', str(drives), *FAST]) == 0
        printed = capsys.readouterr()
        assert f'{counts}, 0 failed, 0 incomplete, 1 without clouds: texts\n' in printed.out
        assert ' no clouds' in printed.out
        assert 'must be' not in printed.err
        assert ('2 of 2' in printed.err) == ('1 replayed' in counts)
        assert states(output) == {'first': 'done', 'texts': 'no clouds'}
    page = (output / 'archive.html').read_text('utf-8')
    assert '<dt>without clouds</dt><dd>1</dd>' in page
    assert '<dt>failed</dt><dd>0</dd>' in page
    assert '>no clouds</td>' in page
    shutil.rmtree(drives / 'texts')
    write_drive(drives / 'texts', 6, seed=2)
    assert main(['replay', str(drives), *FAST]) == 0
    assert states(output) == {'first': 'done', 'texts': 'done'}


def test_only_recordings_without_clouds(tmp_path: Path) -> None:
    """Where none has clouds, nothing is done: the folder is probably another one."""
    (tmp_path / 'drives').mkdir()
    write_texts(tmp_path / 'drives' / 'texts')
    assert main(['replay', str(tmp_path / 'drives'), *FAST]) == 1


def test_all_clouds_refused(tmp_path: Path, capsys: Capture) -> None:
    """Nothing is written, and the sentence says why; of an archive it is a failure."""
    (tmp_path / 'in').mkdir()
    bag = write(tmp_path / 'in' / 'bag', {'/lidar': [rows_of_turn(1)[['x', 'time']]] * 3})
    before = sorted(tmp_path.rglob('*'))
    assert main(['replay', str(bag), '--output', str(tmp_path / 'out'), *FAST]) == 1
    said = capsys.readouterr().err
    assert f'the clouds of {bag} must be such that one at least can be filtered, got 3' in said
    assert '(3)' in said
    assert sorted(tmp_path.rglob('*')) == before
    assert main(['replay', str(bag.parent), '--output', str(tmp_path / 'all'), *FAST]) == 1
    assert states(tmp_path / 'all') == {'bag': 'failed'}


def test_table_of_80_columns(
    drives: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Every number is whole, and every letter of a long name is there."""
    name = 'a_recording_with_a_long_name_' + 'x' * 40
    (drives / 'first').rename(drives / name)
    monkeypatch.setenv('COLUMNS', '80')
    known = one_recording._counts

    def many(topic: Any) -> dict[str, Any]:
        large = {'messages': 123_456, 'refused': 12_345, 'gaps': 12_345, 'points': 9_876_543_210}
        return known(topic) | large

    monkeypatch.setattr(one_recording, '_counts', many)
    assert main(['replay', str(drives), *FAST]) == 3
    table = capsys.readouterr().out.partition('written to')[0]
    assert max(map(len, table.splitlines())) <= 80
    for text in ('123,456', ' 12,345 ', '9,876,543,210', 'recording', 'rejected', 'untested'):
        assert text in table
    assert name in ''.join(line.split()[0] for line in table.splitlines())


def test_a_table_of_very_many(
    drives: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """It has what failed, and says how many rows it leaves out; the page has them all."""
    write_drive(drives / 'second', 6, seed=2)
    (drives / 'zz.mcap').write_bytes(b'no recording')
    monkeypatch.setattr(archive_tables, 'MOST_ROWS', 2)
    assert main(['replay', str(drives), *FAST]) == 3
    printed = capsys.readouterr().out
    assert 'zz ' in printed
    assert 'second ' not in printed
    assert '2 more are on the page' in printed
    page = (drives.with_name('drives_cleaned') / 'archive.html').read_text('utf-8')
    assert page.count('<tr id=') == 4


def test_a_chain_of_replay(drives: Path, tmp_path: Path) -> None:
    """``--chain`` says what ``--set chain=`` says."""
    found = []
    for number, option in enumerate(('--chain=elevation,lof', '--set=chain=[elevation, lof]')):
        output = tmp_path / str(number) / 'out'
        output.parent.mkdir()
        assert main(['replay', str(drives / 'first'), '--output', str(output), option]) == 0
        with Recording(output) as bag:
            found.append([(topic.name, time, data) for topic, time, data in bag.messages()])
    assert found[0] == found[1]
    assert main(['replay', str(drives / 'first'), '--chain=elevation,none']) == 1


@pytest.mark.parametrize('number', [0, 1])
def test_ctrl_c_says_how_to_go_on(
    drives: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, number: int
) -> None:
    """How many are done, and that the same command goes on, with ``--resume`` as well."""
    known = content_hash

    def interrupt(location: Any) -> str:
        if location.path.name == ('first', 'texts')[number]:
            raise KeyboardInterrupt
        return known(location)

    with monkeypatch.context() as patch:
        patch.setattr(one_recording, 'content_hash', interrupt)
        assert main(['replay', str(drives), *FAST]) == 130
    output = drives.with_name('drives_cleaned')
    sentence = f'interrupted: {number} of 2 recordings are done in {output}; the same command goes'
    assert sentence in capsys.readouterr().err
    assert main(['replay', str(drives), *FAST]) == 0
    assert f'{2 - number - 1} replayed, {number} done before' in capsys.readouterr().out


def test_gaps() -> None:
    """A cloud is missing where a distance is longer than twice the median of all distances."""
    for distances, gaps in (
        ([10] * 9 + [20], 0),
        ([10] * 9 + [21], 1),
        ([21] + [10] * 5 + [1000] * 3 + [10] * 5, 4),
        ([0, 0, 0, 1], 0),  # they come at once
        ([10], 0),
        ([], 0),
    ):
        assert count_times(np.cumsum([0, *distances]).tolist()).gaps == gaps
    assert count_times([]).gaps == 0
