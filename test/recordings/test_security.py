# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What SECURITY.md promises: nothing of an input is run, and its names lead nowhere else."""

from __future__ import annotations

import ast
import re
import shutil
from typing import TYPE_CHECKING

import pytest
import yaml
from helpers import ROOT
from helpers.damaged import FAST, content, write_recording

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters import yaml_files
from lidar_outlier_filter.recordings.bags import LARGEST, MAX_ALIASES
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from pathlib import Path

MODULES = {'pickle', 'cPickle', 'marshal', 'shelve', 'dill', 'joblib', 'code', 'codeop', 'pty'}
CALLS = {'eval', 'exec', 'compile', '__import__'}
METHODS = {('os', 'system'), ('os', 'popen'), ('yaml', 'load'), ('yaml', 'unsafe_load')}


def calls_that_run(tree: ast.AST) -> list[str]:
    """List what could run an input: modules, calls, a shell, arrays of objects."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] + [getattr(node, 'module', '') or '']
            found += [name for name in names if name.partition('.')[0] in MODULES]
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Name) and node.func.id in CALLS:
            found.append(node.func.id)
        if isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            name = (node.func.value.id, node.func.attr)
            loader = [ast.unparse(one.value) for one in node.keywords if one.arg == 'Loader']
            found += ['.'.join(name)] if name in METHODS and loader != ['_Loader'] else []
        for keyword in node.keywords:
            is_set = getattr(keyword.value, 'value', True) is not False
            if keyword.arg in {'shell', 'allow_pickle'} and is_set:
                found.append(keyword.arg)
    return found


@pytest.mark.parametrize(
    'text',
    [
        'import pickle',
        'from marshal import loads',
        'eval(a)',
        'os.system(a)',
        'yaml.load(a)',
        'run(a, shell=True)',
        'np.load(a, allow_pickle=b)',
    ],
)
def test_what_is_looked_for(text: str) -> None:
    """Each of these is found, and what is turned off is not."""
    assert calls_that_run(ast.parse(text)) != []
    assert calls_that_run(ast.parse('np.load(a, allow_pickle=False); re.compile(a)')) == []


def test_nothing_of_an_input_is_run() -> None:
    """There is no pickle, no eval, no shell and no other loader of YAML in the package."""
    found = {
        path.relative_to(ROOT): calls
        for name in ('lidar_outlier_filter', 'lidar_outlier_lab')
        for path in (ROOT / name).rglob('*.py')
        if (calls := calls_that_run(ast.parse(path.read_text('utf-8'))))
    }
    assert not found
    assert issubclass(yaml_files._Loader, yaml.SafeLoader)


def test_limits_are_those_of_the_page() -> None:
    """The limits that SECURITY.md gives are those of the code."""
    page = (ROOT / 'SECURITY.md').read_text('utf-8')
    assert re.search(rf'uncompressed \| {LARGEST // 10**6} MB \|', page)
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
