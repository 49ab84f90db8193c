# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Peers on surveys, reimplemented: they agree with their definitions."""

import runpy
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from naive import low_points as naive


@pytest.fixture(scope='module')
def peers() -> dict[str, Any]:
    """Return what the program defines."""
    return runpy.run_path(str(ROOT / 'benchmarks' / 'surveys.py'))


@pytest.mark.parametrize('seed', range(40))
def test_against_loops(peers: dict[str, Any], seed: int) -> None:
    """Extended local minima and isolated voxels are those of plain loops, in few and many cells."""
    rng = np.random.default_rng(seed)
    count, tall = int(rng.integers(1, 80)), rng.choice([0.2, 1.0, 3.0])
    xyz = rng.uniform(0.0, 20.0, (count, 3)) * (1.0, 1.0, tall)
    positions = [tuple(row) for row in xyz.tolist()]
    for cell, drop in ((5.0, 1.0), (3.0, 0.5), (50.0, 2.0)):
        np.testing.assert_array_equal(
            peers['minima'](xyz, cell, drop), naive.minima(positions, cell, drop)
        )
    for side, few in ((2.0, 5), (5.0, 6)):
        np.testing.assert_array_equal(
            peers['isolated'](xyz, side, few), naive.isolated(positions, side, few)
        )


def test_as_they_come(peers: dict[str, Any]) -> None:
    """Each finds a point far below a plain; the extended local minimum keeps all others."""
    rng = np.random.default_rng(1)
    xyz = rng.uniform((0.0, 0.0, 0.0), (60.0, 60.0, 0.1), (5000, 3))
    xyz[0, 2] = -30.0
    for peer in (*peers['SIGMAS'], 'PDAL, radius', 'PDAL, elm', 'lidR, ivf'):
        assert peers['by_peer'](peer, xyz)[0], peer
    assert peers['by_peer']('PDAL, elm', xyz).sum() == 1
