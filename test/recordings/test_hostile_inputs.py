# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs that would run, lead elsewhere or garble a terminal: names, words and metadata."""

import json
import os
import pickle
import re
import shutil
import struct
from itertools import cycle
from pathlib import Path

import pytest
import yaml
from helpers import ROOT
from helpers.clouds import cloud, table
from helpers.damaged import FAST, content, write_recording
from helpers.hostile import FORMATS, whole_file

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.cli.terminal import say
from lidar_outlier_filter.errors import CloudError, JudgingError, RecordingError, quote_error
from lidar_outlier_filter.files.cloud_file import readable
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import (
    MAX_EXPANDED,
    MAX_MESSAGE_BYTES,
    Recording,
    _readable,
)
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.recordings.salvage import Losses


def test_limits_are_those_of_the_page() -> None:
    """The limits that SECURITY.md gives are those of the code."""
    page = (ROOT / 'SECURITY.md').read_text('utf-8')
    assert re.search(rf'uncompressed \| {MAX_MESSAGE_BYTES // 10**6} MB \|', page)
    assert f'{MAX_EXPANDED // 10**6} million characters' in page


@pytest.mark.parametrize(
    ('kind', 'salvage'), [('folder', False), ('folder', True), ('folder file', False)]
)
@pytest.mark.parametrize('name', ['../outside.mcap', '..'])
def test_names_in_metadata(tmp_path: Path, name: str, kind: str, *, salvage: bool) -> None:
    """A file that metadata name is looked up in the folder of the recording only."""
    recording = write_recording(kind, tmp_path)
    (file,) = (one for one in recording.iterdir() if one.name != 'metadata.yaml')
    packed = '.zstd' if kind == 'folder file' else ''
    shutil.copyfile(file, tmp_path / f'outside.mcap{packed}')
    metadata = recording / 'metadata.yaml'
    bag = yaml.safe_load(metadata.read_text())
    bag['rosbag2_bagfile_information']['relative_file_paths'] = [name + packed]
    metadata.write_text(yaml.safe_dump(bag))
    before = {one: one.stat().st_mtime_ns for one in tmp_path.rglob('*')}
    with pytest.raises(RecordingError, match=' must be '):
        replay(recording, tmp_path / 'out', parameters=FAST, salvage=salvage)
    assert {one: one.stat().st_mtime_ns for one in tmp_path.rglob('*')} == before
    bag['rosbag2_bagfile_information']['relative_file_paths'] = [f'../../{file.name}']
    metadata.write_text(yaml.safe_dump(bag))
    replay(recording, tmp_path / 'out', parameters=FAST, salvage=salvage)
    assert content(tmp_path / 'out')['/lidar']


NAMES = [b'\xff\xfe', b'new\nline', b'%41 #?', '雲'.encode(), b'-x', b'[red]']


@pytest.mark.parametrize(
    ('kind', 'name'), [*zip([one for one in FORMATS if one != 'e57'], cycle(NAMES), strict=False)]
)
def test_clean(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: bytes, kind: str) -> None:
    """A file is cleaned under any name, and the log names it."""
    path = tmp_path / os.fsdecode(name + b'.' + kind.split(maxsplit=1)[0].encode())
    whole_file(kind, made := path.with_name(f'made{path.suffix}'))
    made.rename(path)
    assert main(['clean', '--chain', 'sor', '--', str(path)]) == 0
    written = path.with_name(path.stem + '_cleaned' + path.suffix)
    log = json.loads(written.with_name(written.name + '.json').read_text())
    assert log['input'] == str(path)
    assert 'Traceback' not in capsys.readouterr().err
    assert main(['clean', str(path.with_suffix('.none'))]) == 1
    assert capsys.readouterr().err.removesuffix('\n').isprintable()


@pytest.mark.parametrize('name', NAMES)
def test_replay(recordings: Path, tmp_path: Path, name: bytes) -> None:
    """So is a recording."""
    source = shutil.copytree(
        recordings / 'bags' / 'vlp16_mrpt_mcap',
        tmp_path / os.fsdecode(name),
        copy_function=shutil.copyfile,
    )
    assert main(['replay', '--set', 'chain=[sor]', '--', str(source)]) == 0
    with Recording(tmp_path / (os.fsdecode(name) + '_cleaned')) as recording:
        assert recording.message_count == 12


OWN = '"bytes that its format does not allow"'


@pytest.mark.parametrize(
    ('error', 'said'),
    [
        (IndexError('list index out of range'), OWN),
        (struct.error('unpack requires a buffer of 8 bytes'), OWN),
        (UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte'), OWN),
        (AssertionError(), OWN),
        (ValueError(''), OWN),
        (ValueError('a sentence\non two lines'), '"a sentence on two lines"'),
        (ValueError('a \x1b[2J or a \x07'), r'"a \\x1b\[2J or a \\x07"'),
        (PermissionError(13, 'Permission denied', 'x'), '"Permission denied"'),
    ],
)
def test_said_by(error: Exception, said: str) -> None:
    """Sentences of libraries on a file are quoted, others are replaced."""
    assert re.fullmatch(said, quote_error(error))
    with (
        pytest.raises(CloudError, match=f'^the file x must be readable, got {said}$'),
        readable(Path('x')),
    ):
        raise error
    with (
        pytest.raises(RecordingError, match=f'must be readable, got {said}$'),
        _readable(Path('x')),
    ):
        raise error


@pytest.mark.parametrize('name', ['z\n', '\x1b[2J', 'z\r', 'z\x9b', 'z\u2028', '\u202e', '\udcff'])
def test_names_that_a_terminal_obeys(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A name from a cloud or a recording stays on its line, and is read as it is."""
    escaped = name.encode('unicode_escape').decode()
    msg = cloud(table(3))
    msg.fields[2].name = name
    with pytest.raises(CloudError) as refused:
        Decoder(FilterParameters()).decode(msg)
    assert escaped in str(refused.value)
    assert str(refused.value).isprintable()
    assert CloudError(name, 'another', 'it').what == escaped
    losses = Losses()
    losses.add(f'the topic /{name} has no schema')
    assert losses.reasons[0].isprintable()
    say(f'no point of /{name} could be tested')
    assert capsys.readouterr().err.removesuffix('\n').isprintable()


def test_an_error_of_another_process() -> None:
    """It keeps its type, its sentence and its attributes."""
    damage = RecordingError('the bag', 'whole', 'half of it')
    damage.is_damage = True
    for error in (damage, CloudError('a', 'b', '\n'), JudgingError(ValueError('no'))):
        again = pickle.loads(pickle.dumps(error))  # noqa: S301  our own bytes
        assert (type(again), str(again)) == (type(error), str(error))
        assert vars(again) == vars(error)
