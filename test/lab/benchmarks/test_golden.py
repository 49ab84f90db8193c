# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on real recordings are, bit by bit, those that were written down."""

import json
import runpy
import subprocess
import sys
from typing import Any

import pytest
from helpers import ROOT, environment_without_compiler

PROGRAM = ROOT / 'benchmarks' / 'golden.py'
NAME = 'vlp16_mrpt_mcap'
pytestmark = pytest.mark.usefixtures('real_data')


@pytest.fixture(scope='module')
def golden() -> dict[str, Any]:
    """Return what the program defines."""
    return runpy.run_path(str(PROGRAM))


@pytest.mark.parametrize('threads', [1, 2])
def test_few_points(golden: dict[str, Any], threads: int) -> None:
    """Of all chains, whatever the number of threads."""
    known = json.loads(golden['GOLDEN'].read_text())
    found = golden['of_recordings'](golden['SMALL'], threads, only_few=True)
    assert len(found) == len(golden['SMALL']) * len(golden['CHAINS'])
    assert found == {name: known[name] for name in found}


@pytest.mark.slow
@pytest.mark.parametrize('threads', [1, 2])
def test_a_recording(golden: dict[str, Any], threads: int) -> None:
    """All of its clouds, by all chains but the one that takes longest."""
    golden['CHAINS'].pop('quadric patches', None)
    known = json.loads(golden['GOLDEN'].read_text())
    found = golden['of_recordings']((NAME,), threads)
    assert len(found) == len(golden['CHAINS'])
    assert found == {name: known[name] for name in found}


@pytest.mark.slow
def test_kernels_that_are_not_compiled() -> None:
    """As plain Python they find what they find compiled."""
    done = subprocess.run(
        [sys.executable, str(PROGRAM), '--few', '--recordings', NAME],
        env=environment_without_compiler(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith('14 verdicts, 0 different\n')
