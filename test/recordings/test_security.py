# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What SECURITY.md promises: nothing of an input is run, and its names lead nowhere else."""

from __future__ import annotations

import re
import shutil
from typing import TYPE_CHECKING

import pytest
import yaml
from helpers import ROOT
from helpers.damaged import FAST, content, write_recording

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters import yaml_files
from lidar_outlier_filter.recordings.bags import MAX_ALIASES, MAX_MESSAGE_BYTES
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from pathlib import Path


RUNS = re.compile(
    r'\b(import|from) (pickle|marshal|shelve|dill|joblib|code|pty)\b|allow_pickle=(?!False)'
    r'|(?<![\w.])(eval|exec|__import__)\(|shell=|os\.(system|popen)\(|yaml\.unsafe_load'
    r'|yaml\.load\((?!.*Loader=_Loader)'
)


def test_nothing_of_an_input_is_run() -> None:
    """There is no pickle, no eval, no shell and no other loader of YAML in the package."""
    for text in ('import pickle', 'eval(a)', 'yaml.load(a)', 'np.load(a, allow_pickle=b)'):
        assert RUNS.search(text)
    for name in ('lidar_outlier_filter', 'lidar_outlier_lab'):
        for path in (ROOT / name).rglob('*.py'):
            assert RUNS.search(path.read_text('utf-8')) is None, path
    assert issubclass(yaml_files._Loader, yaml.SafeLoader)


def test_limits_are_those_of_the_page() -> None:
    """The limits that SECURITY.md gives are those of the code."""
    page = (ROOT / 'SECURITY.md').read_text('utf-8')
    assert re.search(rf'uncompressed \| {MAX_MESSAGE_BYTES // 10**6} MB \|', page)
    assert f'aliases of a `metadata.yaml` | {MAX_ALIASES} |' in page


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
