# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What works where the extra ``lab`` is not installed: all of the product but pictures."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.drives import write_drive

if TYPE_CHECKING:
    from pathlib import Path

# None of these can be imported in the processes of this file.
BLOCK = """
import sys

class WithoutLab:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {'matplotlib', 'PIL', 'sklearn'}:
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, WithoutLab())
from lidar_outlier_filter.cli.main import main
"""
ONE_COMMAND = 'sys.exit(main(sys.argv[1:]))'
SENTENCE = (
    'the module {module} must be installed for this command: '
    "pip install '.[lab]' in the project, got none"
)
NO_PICTURE = SENTENCE.format(module='matplotlib') + '; no picture is drawn\n'
FAST = ['--set', 'chain=[alpha_beta_gamma]', '--set', 'scores=true']
CSV = ['--set', 'chain=[sor]']


def run(folder: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, in a process without what the laboratory needs."""
    return subprocess.run(
        [sys.executable, '-c', BLOCK + code, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={**os.environ, 'COLUMNS': '200'},
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Make a folder with a recording and a file."""
    write_drive(tmp_path / 'drive', 5)
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(-9, 9, (600, 2)), rng.normal(0, 0.02, 600), np.zeros(600)])
    xyz[::40, 2:] += [4, 1]
    cloud = tmp_path / 'cloud.csv'
    np.savetxt(cloud, xyz, delimiter=',', header='x,y,z,label', comments='', fmt='%.9g')
    return tmp_path


def test_the_product_works(folder: Path) -> None:
    """Recordings, files and arrays are cleaned, looked at and judged."""
    commands = [
        ['replay', 'drive', '--output', 'replayed', *FAST],
        ['info', 'drive'],
        ['report', 'drive', '--output', 'page.html', *FAST],
        ['clean', 'cloud.csv', '--output', 'cleaned.csv', *CSV],
        ['evaluate', 'cleaned.csv'],
    ]
    code = f"""
print([main(words) for words in {commands}])
import numpy as np
from lidar_outlier_filter import detect_outliers
xyz = np.loadtxt('cloud.csv', delimiter=',', skiprows=1)[:, :3]
print(detect_outliers(xyz, chain=['sor']).outlier.sum())
"""
    done = run(folder, code)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[-2] == '[0, 0, 0, 0, 0]'
    assert int(lines[-1]) > 0
    assert '"viridis"' in (folder / 'page.html').read_text(encoding='utf-8')


def test_what_cannot_be_drawn_is_said_once(folder: Path) -> None:
    """Nothing else is lost: the cloud is cleaned, and the page is written."""
    options = ['--output', 'cleaned.csv', '--picture', 'worst.png', *CSV]
    done = run(folder, ONE_COMMAND, 'clean', 'cloud.csv', *options)
    assert (done.returncode, done.stderr.count('matplotlib')) == (3, 1)
    assert done.stderr.startswith(NO_PICTURE)
    options = ['--output', 'page.html', '--figures', 'figures', *FAST]
    done = run(folder, ONE_COMMAND, 'report', 'drive', *options)
    assert (done.returncode, done.stderr) == (3, NO_PICTURE)
    names = {path.name for path in folder.iterdir()}
    assert names >= {'cleaned.csv', 'page.html'}
    assert not names & {'worst.png', 'figures'}


@pytest.mark.parametrize(
    ('module', 'command'),
    [
        ('matplotlib', ['evaluate', 'cloud.csv', '--output', 'out']),
        ('matplotlib', ['results', '--output', 'out.md']),
        ('matplotlib', ['demo', '--output', 'out']),
        ('sklearn', ['train', '--output', 'out.json']),
    ],
)
def test_what_needs_the_extra_says_so(folder: Path, module: str, command: list[str]) -> None:
    """In one sentence, before the work; nothing is left."""
    refused = run(folder, ONE_COMMAND, *command)
    assert (refused.returncode, refused.stderr) == (1, SENTENCE.format(module=module) + '\n')
    assert {path.name for path in folder.iterdir()} == {'drive', 'cloud.csv'}


def test_figures_alone_are_refused(folder: Path) -> None:
    """A report that would be figures only is not made."""
    refused = run(folder, ONE_COMMAND, 'report', 'drive', '--figures', 'figures')
    assert (refused.returncode, refused.stderr) == (1, NO_PICTURE)
    assert {path.name for path in folder.iterdir()} == {'drive', 'cloud.csv'}
