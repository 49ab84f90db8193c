# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels as plain Python, which checks every index and has loops for vectors: the same bits."""

import os
import subprocess
import sys

import pytest
from helpers import HELPERS, TESTS, environment_without_compiler

# Prints the bits of features and scores of clouds of both kinds of scanners: of rings shorter than
# a vector, of as many points, and of one more; with points that coincide, or have no numbers.
BITS = """
from dataclasses import replace
import numba
import numpy as np
from helpers.scans import Drive, pattern_of, profile_pattern_of, sweep
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import (
    FoundPattern,
    judge,
    measure,
    prepare_all,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import count_scores
from lidar_outlier_filter.core.detectors.boosted_trees.trees import PATTERN_MODEL, PROFILE_MODEL

rng = np.random.default_rng(5)
points = sweep(1, 0.3, columns=40, elevations=np.linspace(-10.0, 10.0, 6))
bright = rng.uniform(0.0, 1.0, len(points)).astype(np.float32)
bright[::7] = np.nan
points.xyz[60:70] = points.xyz[60]
points.xyz[120:123] = np.nan
points = replace(points, valid=np.isfinite(points.xyz).all(axis=1), intensity=bright)
for line, count in ((1, 8), (3, 16), (4, 17)):
    mine = points.line == line
    points = points.take(~mine | (np.cumsum(mine) <= count))
drive = Drive(3, 0.2, lines=8, shots=50).points
for found in (
    FoundPattern(pattern_of(points), PATTERN_MODEL),
    FoundPattern(profile_pattern_of(drive), PROFILE_MODEL),
):
    prepared = prepare_all(found, 1)
    drawn = rng.normal(size=len(found.pattern.order)).astype(np.float32)
    values = measure(prepared, count_scores(found.pattern, drawn))
    score = judge(found.pattern, 1.0, 1, model=found.model)
    assert values.any(axis=1).all() and (score > 1).any()
    print(values.tobytes().hex(), score.tobytes().hex())
print(numba.config.DISABLE_JIT)
"""


def test_bits_are_those_of_loops() -> None:
    """Of every feature and score of whole windows."""
    paths = [str(TESTS), *filter(None, [os.environ.get('PYTHONPATH')])]
    env = environment_without_compiler() | {'PYTHONPATH': os.pathsep.join(paths)}
    run = [sys.executable, '-P', '-W', 'ignore', '-c', BITS]
    compiled, loops = (
        subprocess.check_output(run, env={**env, 'NUMBA_DISABLE_JIT': without}).split()
        for without in '01'
    )
    assert (compiled.pop(), loops.pop()) == (b'0', b'1')
    assert compiled == loops


@pytest.mark.slow
@pytest.mark.long
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
