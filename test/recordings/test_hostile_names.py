# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Names of files and folders that are no text: whatever the system allows is read and written."""

from __future__ import annotations

import json
import os
import shutil
from typing import TYPE_CHECKING

import pytest
from helpers.hostile import FORMATS, whole_file

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import Recording

if TYPE_CHECKING:
    from pathlib import Path

NAMES = [b'\xff\xfe', b'new\nline', b'%41 #?', '雲'.encode(), b'-x', b'[red]']


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('kind', [one for one in FORMATS if not one.startswith('e57')])
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
