# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation on real snow, on a made-up sequence in the same layout: nothing of it is real."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers import BENCHMARKS, benchmark
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_outlier_filter.core.detectors import lof
from lidar_outlier_filter.core.detectors.builtin import Lof
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import RecordingError

command = benchmark('real_snow')
sweeps = benchmark('real_snow_sweeps')
judges = benchmark('real_snow_judges')

TABLE = BENCHMARKS / 'pandar64.csv'
SHOTS, EMPTY = 200, range(50, 60)  # shots of a made-up sweep, and those without any return
SNOW, ROAD, BUILDING = 110, 40, 50


class MadeUp(NamedTuple):
    """A sweep as it is in a file, and what is to be found again; (N,) each."""

    xyz: NDArray[np.float32]
    label: NDArray[np.uint32]
    ring: NDArray[np.int64]
    shot: NDArray[np.int64]
    second: NDArray[np.bool_]
    copy: NDArray[np.bool_]


def make(seed: int) -> MadeUp:
    """Fire at a road and a wall 20 m ahead, through snow that some returns are of."""
    rng = np.random.default_rng(seed)
    laser = np.loadtxt(TABLE, delimiter=',', skiprows=2)
    up = np.radians(laser[:, 1] - 0.06)
    shape = (SHOTS, 64)
    step = np.arange(SHOTS)[:, None] * 0.2 + rng.choice([0.0, 0.02], (SHOTS, 1))
    azimuth = np.radians(40.0 + step + laser[:, 2])
    wall = 20.0 / np.cos(up)
    road = 1.8 / np.maximum(-np.sin(up), 1e-6)
    last = np.broadcast_to(np.minimum(wall, road), shape).copy()
    label = np.broadcast_to(np.where(road < wall, ROAD, BUILDING), shape).copy()
    returned = rng.random(shape) < 0.9
    returned[list(EMPTY)] = False
    returned[[0, -1], 0] = True
    alone, before = rng.random(shape) < 0.01, rng.random(shape) < 0.03
    flake = rng.uniform(2.0, 10.0, shape).clip(max=0.9 * last)
    last, label = np.where(alone, flake, last), np.where(alone, SNOW, label)
    nearer = before & ~alone
    first, its = np.where(nearer, flake, last), np.where(nearer, SNOW, label)
    there = np.stack([returned, returned], axis=1)  # shots, blocks, lasers
    there[7, 0, 3] = there[8, 1, 4] = False  # as if one of two were missing
    shot, block, ring = np.nonzero(there)
    far = np.stack([last, first], axis=1)[shot, block, ring]
    flat, turned = far * np.cos(up[ring]), azimuth[shot, ring]
    xyz = np.column_stack([flat * np.sin(turned), flat * np.cos(turned), far * np.sin(up[ring])])
    copy = (block == 1) & ~nearer[shot, ring] & there[shot, 0, ring]
    said = np.stack([label, its], axis=1)[shot, block, ring]
    return MadeUp(xyz.astype(np.float32), said.astype(np.uint32), ring, shot, block == 1, copy)


def put(folder: Path, name: str, made: MadeUp) -> Path:
    """Write a sweep in the layout of the data set; snow is dark."""
    path = folder / 'sequences' / '36' / 'velodyne' / f'{name}.bin'
    beside = folder / 'sequences' / '36' / 'labels' / f'{name}.label'
    for one in (path, beside):
        one.parent.mkdir(parents=True, exist_ok=True)
    intensity = np.where(made.label == SNOW, 0.0, 20.0).astype(np.float32)
    path.write_bytes(np.column_stack([made.xyz, intensity]).astype('<f4').tobytes())
    beside.write_bytes((made.label + (3 << 16)).astype('<u4').tobytes())  # and an instance
    return path


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a sequence of three sweeps."""
    folder = tmp_path_factory.mktemp('snow')
    for seed in range(3):
        put(folder, f'{seed:06}', make(seed))
    return folder


def test_sweeps_are_rebuilt(folder: Path) -> None:
    """Rings, times and returns are those of the making, past shots without any return."""
    rings = sweeps.read_rings(TABLE)
    found = sweeps.read_sweeps(folder, rings)
    begin = sweeps.START
    for seed, sweep in enumerate(found):
        made = make(seed)
        np.testing.assert_array_equal(sweep.xyz, made.xyz)
        np.testing.assert_array_equal(sweep.label, made.label)
        np.testing.assert_array_equal(sweep.ring, made.ring)
        second = sweeps.find_shots(made.xyz, made.ring, rings)[1]
        np.testing.assert_array_equal(second, made.second)
        np.testing.assert_array_equal(sweep.copy, made.copy)
        time = begin + 55_560 * made.shot + rings.time[made.ring]
        np.testing.assert_array_equal(sweep.time, time)
        begin += SHOTS * 55_560


def test_points_off_the_rings_are_refused(tmp_path: Path) -> None:
    """In a sentence that names the file."""
    made = make(0)
    path = put(tmp_path, '000000', made._replace(xyz=made.xyz + np.array([0, 0, 0.05], 'f4')))
    with pytest.raises(RecordingError, match=r'the elevations of 000000\.bin must'):
        sweeps.read_sweep(path, sweeps.read_rings(TABLE))


def test_forms(folder: Path) -> None:
    """All points, or the last return of each laser; copies know what they are of."""
    made = make(1)
    (_, sweep, _) = sweeps.read_sweeps(folder, sweeps.read_rings(TABLE))
    both, last = (sweeps.cloud(sweep, form) for form in sweeps.FORMS)
    assert len(both) == len(made.ring)
    assert len(last) == len(set(zip(made.shot.tolist(), made.ring.tolist(), strict=True)))
    for one, copies in ((both, made.copy.sum()), (last, 0)):
        np.testing.assert_array_equal(one.xyz[one.source], one.xyz)
        assert np.count_nonzero(one.copy) == copies


def test_neighbours_of_peers(folder: Path) -> None:
    """Ten for rules, 20 for SOR and LOF; a copy is nobody's neighbour."""
    (sweep, *_) = sweeps.read_sweeps(folder, sweeps.read_rings(TABLE))
    cloud = sweeps.cloud(sweep, 'both')
    own = ~cloud.copy
    xyz = cloud.xyz[own].astype(float)
    distance = cKDTree(xyz).query(xyz, 21)[0][:, 1:]
    mean = distance.mean(axis=1)
    factor = lof.measure(Neighbourhood(xyz, 20), Lof(min_pts=20))
    expected = distance[:, :10], (mean - mean.mean()) / mean.std(), factor
    for found, its in zip(judges.neighbours(cloud), expected, strict=True):
        np.testing.assert_allclose(found[own], its, rtol=1e-4, atol=1e-6)
        np.testing.assert_array_equal(found, found[cloud.source])


def test_the_network_is_asked_as_its_own_code_asks(folder: Path) -> None:
    """Nine neighbours, copies too, 1 m more than their distance; the larger result counts."""
    (sweep, *_) = sweeps.read_sweeps(folder, sweeps.read_rings(TABLE))
    cloud = sweeps.cloud(sweep, 'both')
    asked: dict[str, Any] = {}

    def run(_names: None, given: dict[str, Any]) -> list[Any]:
        asked.update(given)
        first = np.arange(len(cloud)) < 4
        return [np.column_stack([~first, first]).astype(np.float32)]

    (rejected,) = judges.by_network([cloud], SimpleNamespace(run=run)).rejected
    assert np.flatnonzero(rejected).tolist() == [0, 1, 2, 3]
    expected = cKDTree(cloud.xyz).query(cloud.xyz, 9)[0]
    np.testing.assert_allclose(asked['dist'], 1 + expected, rtol=1e-6)
    apart = np.linalg.norm(cloud.xyz[asked['indices']] - cloud.xyz[:, None], axis=2)
    np.testing.assert_allclose(apart, expected, atol=1e-4)
    back = asked['points'] * judges.DEVIATION + judges.MEAN
    np.testing.assert_allclose(back[:, 3], cloud.intensity, atol=1e-5)


def test_the_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Tables of each form are printed and written."""
    written = tmp_path / 'page.md'
    everything = command.main([str(folder), '--write', str(written), '--every', '2'])
    said = written.read_text(encoding='utf-8')
    assert '<!-- begin real-snow: written by `benchmarks/real_snow.py`' in said
    assert capsys.readouterr().out.strip() in said
    assert list(everything) == ['both', 'last']
    points = sum(len(make(seed).ring) for seed in (0, 2))
    for judged in everything.values():
        assert list(judged) == ['default', *judges.PEERS]
        assert {one.sweeps for one in judged.values()} == {2}
    assert {one.whole.total for one in everything['both'].values()} == {points}
