# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Distributions of others, installed into a folder of their own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / 'doc' / 'examples' / 'new_detector'


def install(folder: Path, source: Path = EXAMPLE) -> dict[str, str]:
    """Install a distribution into a folder; return what finds it there: the environment.

    The source is copied, as building writes beside it.
    """
    copy = Path(shutil.copytree(source, folder / 'source'))
    target = folder / 'installed'
    words = ['--quiet', '--no-deps', '--no-build-isolation', '--no-index', '--target', str(target)]
    subprocess.run([sys.executable, '-m', 'pip', 'install', *words, str(copy)], check=True)
    paths = [str(target), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {'PYTHONPATH': os.pathsep.join(paths)}
