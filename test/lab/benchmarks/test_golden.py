# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on real recordings are, bit by bit, those that were written down."""

import json
import subprocess
import sys

import pytest
from helpers import BENCHMARKS, benchmark, environment_without_compiler

golden = benchmark('golden')
NAME = 'vlp16_mrpt_mcap'
pytestmark = pytest.mark.usefixtures('real_data')


@pytest.mark.parametrize('threads', [1, 2])
def test_few_points(threads: int) -> None:
    """Of all chains, whatever the number of threads."""
    known = json.loads(golden.GOLDEN.read_text())
    found = golden.of_recordings(golden.SMALL, threads, only_few=True)
    assert len(found) == len(golden.SMALL) * len(golden.CHAINS)
    assert found == {name: known[name] for name in found}


@pytest.mark.slow
@pytest.mark.parametrize('threads', [1, 2])
def test_a_recording(threads: int) -> None:
    """All of its clouds, by all chains but the one that takes longest."""
    golden.CHAINS.pop('quadric patches', None)
    known = json.loads(golden.GOLDEN.read_text())
    found = golden.of_recordings((NAME,), threads)
    assert len(found) == len(golden.CHAINS)
    assert found == {name: known[name] for name in found}


@pytest.mark.slow
def test_kernels_that_are_not_compiled() -> None:
    """As plain Python they find what they find compiled."""
    done = subprocess.run(
        [sys.executable, str(BENCHMARKS / 'golden.py'), '--few', '--recordings', NAME],
        env=environment_without_compiler(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith('19 verdicts, 0 different\n')
