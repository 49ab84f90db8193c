# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""New files appear whole, together, or not at all; and files that are none are refused."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.new_files import new_files

if TYPE_CHECKING:
    from pathlib import Path


def names(folder: Path) -> list[str]:
    """List the names in a folder, hidden ones too."""
    return sorted(path.name for path in folder.iterdir())


def test_they_appear_together(tmp_path: Path) -> None:
    """Until the end nothing is there under its name; afterwards all are, and nothing else."""
    (tmp_path / 'other').mkdir()
    paths = [tmp_path / 'a.las', tmp_path / 'other' / 'b.las']
    with new_files(paths) as built:
        assert [path.name for path in built] == ['a.las', 'b.las']
        for path in built:
            path.write_text(path.name)
        assert not any(path.exists() for path in paths)
    assert [path.read_text() for path in paths] == ['a.las', 'b.las']
    assert names(tmp_path) == ['a.las', 'other']
    assert names(tmp_path / 'other') == ['b.las']


@pytest.mark.parametrize('error', [KeyboardInterrupt, OSError, SystemExit])
def test_nothing_is_left_behind(tmp_path: Path, error: type[BaseException]) -> None:
    """Whatever goes wrong leaves nothing behind."""

    def fail() -> None:
        with new_files([tmp_path / 'a', tmp_path / 'b']) as built:
            built[0].write_text('half')
            raise error

    with pytest.raises(error):
        fail()
    assert names(tmp_path) == []


def test_refused(tmp_path: Path) -> None:
    """Files that exist, that are one, and folders that do not exist are refused."""
    there = tmp_path / 'there'
    there.write_text('mine')
    for paths, sentence in (
        ([there], 'the output must be a new file, got .*there, which exists'),
        ([tmp_path / 'a', tmp_path / 'other' / '..' / 'a'], 'the outputs must be different files'),
        (
            [tmp_path / 'no' / 'a'],
            'the output .*a must be written, got "No such file or directory"',
        ),
    ):
        with pytest.raises(CloudError, match=sentence), new_files(paths):
            pytest.fail('never comes here')
    assert there.read_text() == 'mine'
    assert names(tmp_path) == ['there']


def test_unknown_formats(tmp_path: Path) -> None:
    """A suffix that is unknown, a folder, and a file that is not there are refused."""
    for name, sentence in (
        ('cloud.e57', r"must be one of \.las \.laz .*, got '\.e57'"),
        ('cloud', "must be one of .*, got ''"),
        ('cloud.las', r'cloud\.las must be a file, got none'),
        ('folder.las', r'folder\.las must be a file, got a folder'),
    ):
        if name.startswith('folder'):
            (tmp_path / name).mkdir()
        with pytest.raises(CloudError, match=sentence):
            open_cloud(tmp_path / name)


def test_a_table_for_databases_only(recordings: Path) -> None:
    """A file that has no tables must not be asked for one."""
    with pytest.raises(CloudError, match=r"given for a database only, not for \.ply, got 'points'"):
        open_cloud(recordings / 'clouds' / 'source.ply', 'points')


@pytest.mark.parametrize(
    ('module', 'library', 'extra'),
    [('las', 'laspy', 'files'), ('pcd', 'lzf', 'files'), ('parquet', 'pyarrow', 'parquet')],
)
def test_missing_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, library: str, extra: str
) -> None:
    """Where a library is not installed, the sentence says how to install it."""
    path = tmp_path / f'cloud.{module}'
    path.touch()
    monkeypatch.delitem(sys.modules, f'lidar_outlier_filter.files.{module}', raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    must_be = rf"must be installed, as by pip install 'lidar_outlier_filter\[{extra}\]', got none"
    with pytest.raises(CloudError, match=f'the module {library} for {path.suffix} files {must_be}'):
        open_cloud(path)
