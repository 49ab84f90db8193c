# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Distributions of others, installed into a folder of their own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from helpers import ROOT

EXAMPLE = ROOT / 'doc' / 'examples' / 'new_detector'


def write_installed(folder: Path, name: str, code: str) -> dict[str, str]:
    """Write a module with a ``DETECTOR`` as if it had been installed; return what finds it."""
    about = folder / f'{name}-1.0.dist-info'
    about.mkdir(parents=True)
    (folder / f'{name}.py').write_text(code, 'utf-8')
    (about / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n', 'utf-8')
    entry = f'[lidar_outlier_filter.detectors]\n{name} = {name}:DETECTOR\n'
    (about / 'entry_points.txt').write_text(entry, 'utf-8')
    return _found_in(folder)


def install(folder: Path, source: Path = EXAMPLE) -> dict[str, str]:
    """Install a distribution into a folder; return what finds it there: the environment.

    The source is copied, as building writes beside it.
    """
    copy = Path(shutil.copytree(source, folder / 'source'))
    target = folder / 'installed'
    words = ['--quiet', '--no-deps', '--no-build-isolation', '--no-index', '--target', str(target)]
    subprocess.run([sys.executable, '-m', 'pip', 'install', *words, str(copy)], check=True)
    return _found_in(target)


def _found_in(*folders: Path) -> dict[str, str]:
    paths = [*map(str, folders), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {'PYTHONPATH': os.pathsep.join(paths)}
