# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""No kernel reads or writes outside of its arrays: every index is checked, in another process."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from helpers import HELPERS, TESTS

if TYPE_CHECKING:
    from pathlib import Path

CORE = TESTS / 'core'
# What reads beside points, on clouds of many sizes: the kernels of the default, and of neighbours.
# Every kernel is compiled for it, which is what takes the time.
CHECKED = [
    *(
        f'neighbours/test_neighbours.py::test_{name}'
        for name in ('equals_the_naive_twin', 'all_equally_far', 'some_lists_are_those_of_all')
    ),
    'detectors/boosted_trees/test_profile_pattern.py',
    'detectors/boosted_trees/test_scan_pattern.py',
]


def run(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run Python with variables of the environment."""
    command = [sys.executable, *words]
    env = os.environ | variables
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_no_kernel_leaves_its_arrays(tmp_path: Path) -> None:
    """The tests of the default and of neighbours pass where an index out of bounds raises."""
    tests = [str(CORE / name) for name in CHECKED]
    checked = {'NUMBA_BOUNDSCHECK': '1', 'NUMBA_CACHE_DIR': str(tmp_path)}
    done = run('-m', 'pytest', '-q', '-x', '-p', 'no:cacheprovider', *tests, **checked)
    assert done.returncode == 0, done.stdout[-5000:]


@pytest.mark.slow
def test_no_kernel_of_a_detector_leaves_its_arrays() -> None:
    """Nor does one of any detector, its choices and its explanation; each kernel is called."""
    done = run(str(HELPERS / 'uncompiled.py'), PYTHONPATH=os.pathsep.join([str(TESTS), *sys.path]))
    assert done.returncode == 0, done.stderr[-5000:]
    boosted_trees = 'lidar_outlier_filter.core.detectors.boosted_trees'
    assert done.stdout.split() == [f'{boosted_trees}.trees.add_up']  # for training
