# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Runs that are killed, disks that are full, folders that may not be written."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hostile import FORMATS, whole_file

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.hidden_folder import LOCK, hidden_folder
from lidar_outlier_filter.files.scratch import scratch

KILLING = Path(__file__).with_name('killing.py')
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
def test_killed_runs(recordings: Path, tmp_path: Path, what: str, source: str) -> None:
    """Nothing stands under the final name; the next run succeeds, and removes what was left."""
    command = [sys.executable, str(KILLING), what, str(recordings / source), str(tmp_path), '4']
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 4
    assert all(line.startswith('good') for line in lines), done.stdout
    assert list(tmp_path.iterdir()) == []


def test_what_is_left_is_removed(tmp_path: Path) -> None:
    """A folder whose lock is free was left by a killed run; one that is held, or new, stays."""
    output = tmp_path / 'out.las'
    for name in ('free', 'held', 'new', 'old', 'link'):
        if name != 'link':
            (tmp_path / f'.out.las.partial-{name}').mkdir()
    (tmp_path / '.out.las.partial-link').symlink_to(tmp_path)
    (tmp_path / '.other.las.partial-free').mkdir()
    os.utime(tmp_path / '.out.las.partial-old', (0, 0))
    for name in ('free', 'held'):
        (tmp_path / f'.out.las.partial-{name}' / LOCK).touch()
    with (tmp_path / '.out.las.partial-held' / LOCK).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with hidden_folder(output) as folder, hidden_folder(output) as other:
            assert folder != other
            assert folder.is_dir()
    kept = (
        '.other.las.partial-free',
        *(f'.out.las.partial-{name}' for name in ('held', 'link', 'new')),
    )
    assert {path.name for path in tmp_path.iterdir()} == set(kept)


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


def test_full_disk_of_tiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for the tiles is taken before it is used: writing beyond it would kill the process."""

    def full(*_: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'posix_fallocate', full)
    sentence = (
        'must be able to hold 2400 bytes beside the output, for the tiles, got "No space left'
    )
    with pytest.raises(CloudError, match=sentence), scratch(tmp_path / 'out.las', 1.0) as allocate:
        allocate((100, 3))
    assert list(tmp_path.iterdir()) == []
