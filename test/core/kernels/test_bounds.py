# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""No kernel reads or writes outside of its arrays: numba checks every index, in another process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CORE = Path(__file__).parents[1]
# What reads beside points, on clouds of many sizes: the kernels of the default, and of neighbours.
# Every kernel is compiled for it, which is what takes the time.
TESTS = [
    *(
        f'neighbours/test_neighbours.py::test_{name}'
        for name in ('small_clouds', 'all_equally_far', 'some_lists_are_those_of_all')
    ),
    'detectors/evidence/test_profile_pattern.py',
    'detectors/evidence/test_scan_pattern.py',
]


def run(*words: str, cache: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with kernels that check bounds, of a cache of their own."""
    env = {**os.environ, 'NUMBA_BOUNDSCHECK': '1', 'NUMBA_CACHE_DIR': str(cache)}
    command = [sys.executable, *words]
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_no_kernel_leaves_its_arrays(tmp_path: Path) -> None:
    """The tests that call kernels pass where an index out of bounds raises."""
    tests = [str(CORE / name) for name in TESTS]
    done = run('-m', 'pytest', '-q', '-x', '-p', 'no:cacheprovider', *tests, cache=tmp_path)
    assert done.returncode == 0, done.stdout[-5000:]
