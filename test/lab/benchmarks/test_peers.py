# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Peers agree with their definitions, and the default is compared with them as it is used."""

import numpy as np
import pytest
from helpers import benchmark
from naive import low_points as naive

surveys, livox = benchmark('surveys'), benchmark('livox')


@pytest.mark.parametrize('seed', range(40))
def test_against_loops(seed: int) -> None:
    """Extended local minima and isolated voxels are those of plain loops, in few and many cells."""
    rng = np.random.default_rng(seed)
    count, tall = int(rng.integers(1, 80)), rng.choice([0.2, 1.0, 3.0])
    xyz = rng.uniform(0.0, 20.0, (count, 3)) * (1.0, 1.0, tall)
    positions = [tuple(row) for row in xyz.tolist()]
    for cell, drop in ((5.0, 1.0), (3.0, 0.5), (50.0, 2.0)):
        np.testing.assert_array_equal(
            surveys.minima(xyz, cell, drop), naive.minima(positions, cell, drop)
        )
    for side, few in ((2.0, 5), (5.0, 6)):
        np.testing.assert_array_equal(
            surveys.isolated(xyz, side, few), naive.isolated(positions, side, few)
        )


def test_as_they_come() -> None:
    """Each finds a point far below a plain; the extended local minimum keeps all others."""
    rng = np.random.default_rng(1)
    xyz = rng.uniform((0.0, 0.0, 0.0), (60.0, 60.0, 0.1), (5000, 3))
    xyz[0, 2] = -30.0
    for peer in (*surveys.SIGMAS, 'PDAL, radius', 'PDAL, elm', 'lidR, ivf'):
        assert surveys.by_peer(peer, xyz)[0], peer
    assert surveys.by_peer('PDAL, elm', xyz).sum() == 1


def test_free_scanners_are_judged_well() -> None:
    """Where the sensor is `free`, the default finds the snow of a rosette, and keeps the street."""
    found = {sweep.kind: sweep for sweep in livox.sweeps('Mid-40', 3)}
    snow, dry = found['light_snow'], found['clean']
    assert snow.outlier.sum() > 100
    found_free = livox.by_default(snow.points, snow.outlier)
    assert found_free.f1 > 0.95
    assert found_free.false_rejections.ratio < 0.002
    assert livox.by_default(dry.points, dry.outlier).false_rejections.ratio < 0.002


def test_rows() -> None:
    """A row has F1 and good points lost: of the default, and of each peer where it is best."""
    (snow,) = (sweep for sweep in livox.sweeps('Mid-40', 3) if sweep.kind == 'light_snow')
    judged = livox.Judged()
    livox.judge_sweep(judged, snow)
    best = {}
    for name, (row,) in judged.peers.items():
        top = row.f1.argmax()
        best[name] = f'{row.f1[top]:.2f} ({100 * row.lost[top]:.2f} %)'
    ours = livox.by_default(snow.points, snow.outlier)
    found = dict(zip(livox.HEAD[2:], livox.cells('light_snow', judged, {}), strict=True))
    lost = ours.false_rejections.ratio
    assert found.pop(livox.FREE) == f'{ours.f1:.2f} ({100 * lost:.2f} %)'
    del found[livox.DARK]
    assert found == best
