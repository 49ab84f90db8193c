# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Names of files and folders that are no text: whatever the system allows is read and written."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import laspy
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import Recording

if TYPE_CHECKING:
    from pathlib import Path

NAMES = [b'\xff\xfe', b'new\nline', b'%41 #?', '雲'.encode(), b'-x', b'[red]']
COUNT = 50
HEAD = 'FIELDS x y\nSIZE 4 4\nTYPE F F\nWIDTH 50\nHEIGHT 1\nDATA ascii\n'


def write(path: Path) -> None:
    """Write a small cloud in the format that its suffix says."""
    x, y = np.arange(COUNT, dtype=np.float64), np.arange(COUNT, dtype=np.float64) ** 2 % 7
    text = '\n'.join(f'{a} {b}' for a, b in zip(x, y, strict=True)) + '\n'
    if path.suffix in {'.las', '.laz'}:
        header = laspy.LasHeader(point_format=1, version='1.2')
        points = laspy.ScaleAwarePointRecord.zeros(COUNT, header=header)
        points['X'], points['Y'] = x * 100, y * 100
        with path.open('wb') as stream, laspy.open(stream, 'w', header=header) as writer:
            writer.write_points(points)
    elif path.suffix == '.pcd':
        path.write_text(HEAD + text)
    elif path.suffix == '.ply':
        head = (
            f'ply\nformat ascii 1.0\nelement vertex {COUNT}\nproperty float x\nproperty float y\n'
        )
        path.write_text(f'{head}end_header\n{text}')
    elif path.suffix == '.csv':
        path.write_text('x y\n' + text)
    elif path.suffix == '.parquet':
        with path.open('wb') as stream:
            parquet.write_table(pa.table({'x': x, 'y': y}), stream)
    else:
        with closing(sqlite3.connect(path)) as database, database:
            database.execute('CREATE TABLE t (x, y)')
            rows = zip(x.tolist(), y.tolist(), strict=True)
            database.executemany('INSERT INTO t VALUES (?, ?)', rows)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('suffix', ['.las', '.laz', '.pcd', '.ply', '.csv', '.parquet', '.db'])
def test_clean(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: bytes, suffix: str
) -> None:
    """A file is cleaned under any name, and the log names it."""
    path = tmp_path / os.fsdecode(name + suffix.encode())
    write(path)
    assert main(['clean', '--chain', 'sor', '--columns', 'x,y', '--', str(path)]) == 0
    written = path.with_name(path.stem + '_cleaned' + path.suffix)
    assert written.is_file()
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
