# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Runs that are killed, disks that are full, folders that may not be written."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from helpers import HELPERS
from helpers.damaged import write_recording
from helpers.hostile import FORMATS, whole_file

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.disk import new_files
from lidar_outlier_filter.disk.new_files import LOCK, hidden_folder
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.clean import _allocator

if TYPE_CHECKING:
    from pathlib import Path

KILLING = HELPERS / 'killing.py'
FULL = """
import resource, sys
from lidar_outlier_filter.cli.main import main
import lidar_outlier_filter.files.clean
resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200))
print([main(['clean', '--chain', 'sor', path]) for path in sys.argv[1:]])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ('what', 'source'),
    [('clean', 'clouds/plane.laz'), ('replay', 'bags/vlp16_mrpt_mcap')],
)
def test_killed_runs(real_data: Path, tmp_path: Path, what: str, source: str) -> None:
    """Nothing stands under the final name; the next run succeeds, and removes what was left."""
    command = [sys.executable, str(KILLING), what, str(real_data / source), str(tmp_path), '4']
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 4
    assert all(line.startswith('good') for line in lines), done.stdout
    assert list(tmp_path.iterdir()) == []


def test_what_is_left_is_removed(tmp_path: Path) -> None:
    """A folder whose lock is free, or missing, was left by a killed run; one that is held stays."""
    output = tmp_path / 'out.las'
    for name in ('free', 'held', 'files', 'empty', 'x-gone'):
        (tmp_path / f'.out.las.partial-{name}').mkdir()
    (tmp_path / '.out.las.partial-link').symlink_to(tmp_path)
    (tmp_path / '.other.las.partial-free').mkdir()
    for name in ('files', 'x-gone'):
        (tmp_path / f'.out.las.partial-{name}' / 'out.las').touch()
    for name in ('free', 'held'):
        (tmp_path / f'.out.las.partial-{name}' / LOCK).touch()
    with (tmp_path / '.out.las.partial-held' / LOCK).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with hidden_folder(output) as folder, hidden_folder(output) as other:
            assert folder != other
            assert folder.is_dir()
    kept = (
        '.other.las.partial-free',
        *(f'.out.las.partial-{name}' for name in ('held', 'link')),
    )
    assert {path.name for path in tmp_path.iterdir()} == set(kept)


@pytest.mark.parametrize('moment', ['mkdtemp', '_take'])
def test_a_folder_removed_before_its_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    """Where another run takes a folder without a lock for one that was left, a second is made."""
    output, original, calls = tmp_path / 'out.las', getattr(new_files, moment), list[int]()

    def with_another_run(*given: object, **more: object) -> object:
        result = original(*given, **more)
        if not calls:
            calls.append(1)
            with hidden_folder(output):
                pass
        return result

    monkeypatch.setattr(new_files, moment, with_another_run)
    with hidden_folder(output) as folder:
        assert (folder / LOCK).is_file()
        assert list(tmp_path.iterdir()) == [folder]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_full_disk(tmp_path: Path) -> None:
    """Where no more can be written, one sentence names the output, and nothing is left."""
    paths = []
    for kind in FORMATS:
        suffix, _, form = kind.partition(' ')
        paths.append(tmp_path / f'cloud_{form}.{suffix}')
        whole_file(kind, paths[-1])
    command = [sys.executable, '-c', FULL, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f'{[1] * len(paths)}\n'
    sentences = done.stderr.splitlines()
    assert len(sentences) == len(paths)
    for sentence in sentences:
        assert sentence.startswith('the output ')
        assert 'must be written in full, got "' in sentence
    assert set(tmp_path.iterdir()) == set(paths)


def test_full_disk_of_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for the arrays is taken before it is used: writing beyond it would kill the process."""

    def full(*_: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'posix_fallocate', full)
    sentence = 'must be able to hold 2400 bytes beside the output, for --tile, got "No space left'
    with pytest.raises(CloudError, match=sentence):
        _allocator(tmp_path / 'out.las', 1.0)((100, 3))
    assert list(tmp_path.iterdir()) == []


# Replays ------------------------------------------------------------------------------------------

FULL_REPLAY = """
import resource, sys
from lidar_outlier_filter.cli.main import main
import lidar_outlier_filter.recordings.replay
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
print(main(['replay', '--set', 'chain=[sor]', *sys.argv[2:]]))
"""


@pytest.mark.parametrize(('limit', 'more'), [(1000, []), (6000, ['--salvage'])])
def test_full_disk_of_a_replay(tmp_path: Path, limit: int, more: list[str]) -> None:
    """Where no more can be written, of the bag or of a copy, one sentence says so."""
    source, output = write_recording('folder', tmp_path), tmp_path / 'out'
    arguments = [str(limit), str(source), '--output', str(output), *more]
    command = [sys.executable, '-c', FULL_REPLAY, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == '1\n'
    sentence = done.stderr.splitlines()[-1]
    assert sentence.startswith(f'the output {tmp_path}/')
    assert sentence.endswith(' must be written in full, got "File too large"')
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize('more', [[], ['--salvage']])
@pytest.mark.parametrize('folder', ['/proc', '/no/such/folder'])
def test_target_that_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], folder: str, more: list[str]
) -> None:
    """A folder that nobody may write to, or that is not there, is refused in one sentence."""
    source = write_recording('mcap', tmp_path)
    command = ['replay', str(source), '--output', f'{folder}/out', '--set', 'chain=[sor]', *more]
    assert main(command) == 1
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert sentence.startswith(f'the output {folder}/out must be written in full, got "')
