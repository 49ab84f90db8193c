# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on real recordings are, bit by bit, those that were written down."""

import json
from collections.abc import Iterator

import pytest
from helpers import benchmark

from lidar_outlier_filter.core import _kernels

golden = benchmark('golden')
NAME = 'vlp16_mrpt_mcap'
pytestmark = pytest.mark.usefixtures('real_data')


@pytest.fixture(params=_kernels.levels())
def level(request: pytest.FixtureRequest) -> Iterator[str]:
    """Choose the instructions that the kernels use."""
    _kernels.set_level(request.param)
    yield request.param
    _kernels.set_level(_kernels.levels()[-1])


@pytest.mark.usefixtures('level')
@pytest.mark.parametrize('threads', [1, 2])
def test_few_points(threads: int) -> None:
    """Of all chains, whatever the number of threads and the instructions of the processor."""
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
