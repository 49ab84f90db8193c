# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A shell that asks how the command line may go on."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path


def answers(line: str, folder: Path) -> set[str]:
    """Ask as the code of argcomplete in a shell does."""
    path = folder / 'answers'
    asked = {
        '_ARGCOMPLETE': '1',
        '_ARGCOMPLETE_STDOUT_FILENAME': str(path),
        'COMP_LINE': line,
        'COMP_POINT': str(len(line)),
        'COMP_TYPE': '9',
    }
    command = [sys.executable, '-m', 'lidar_outlier_filter.cli.main']
    done = subprocess.run(command, env={**os.environ, **asked}, check=False, cwd=folder)
    assert done.returncode == 0
    return {one.strip() for one in path.read_text('utf-8').split('\v')}


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        ('rep', {'replay', 'report'}),
        ('tr', {'train'}),
        ('clean --keep', {'--keep-classes'}),
        ('replay a --set max_d', {'max_delay='}),
        ('replay a --set sor.mult', {'sor.multiplier='}),
        ('clean a --chain h', {'hierarchical'}),
        ('clean a --chain sor,lo', {'sor,lof'}),
        ('clean a --mark ', {'class', 'noise', 'withheld'}),
    ],
)
def test_answers(line: str, expected: set[str], tmp_path: Path) -> None:
    """Verbs, options, choices, parameters and detectors are completed."""
    assert answers(f'lidar-outlier-filter {line}', tmp_path) == expected


def test_files(tmp_path: Path) -> None:
    """Where a file is awaited, files are what a line goes on with."""
    (tmp_path / 'drive_a').mkdir()
    (tmp_path / 'drive_b.mcap').touch()
    found = answers('lidar-outlier-filter info dr', tmp_path)
    assert found == {'drive_a/', 'drive_b.mcap'}
