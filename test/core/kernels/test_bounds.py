# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""No kernel reads or writes outside of its arrays: uncompiled, Python checks every index."""

import subprocess
import sys

import pytest
from helpers import HELPERS, TESTS, environment_without_compiler


@pytest.mark.slow
def test_no_kernel_leaves_its_arrays() -> None:
    """Nor does one of any detector, its choices and its explanation; each kernel is called."""
    done = subprocess.run(
        [sys.executable, str(HELPERS / 'uncompiled.py')],
        env=environment_without_compiler() | {'PYTHONPATH': ':'.join([str(TESTS), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-5000:]
    boosted_trees = 'lidar_outlier_filter.core.detectors.boosted_trees'
    assert done.stdout.split() == [f'{boosted_trees}.trees.add_up']  # for training
