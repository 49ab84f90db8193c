# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Rings recovered from elevation: measured rings are found, and no others; bands elsewhere."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np
import pytest
import yaml
from helpers.cloud_files import columns
from helpers.drives import first_cloud
from helpers.scans import points_of, sweep
from naive import recovered_rings as naive

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.boosted_trees.methods import find_either
from lidar_outlier_filter.core.detectors.boosted_trees.trees import FREE_MODEL
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.scan_lines import order_by_line
from lidar_outlier_filter.core.scan_pattern import recovered_rings as rings
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.judged_file import SEPARATE, CleanOptions, describe_file
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters

HELIOS = 'helios_1691141763462381376.pcd'
TABLES = ('Pandar40P.csv', 'Pandar64.csv', 'PandarQT128.csv', 'Pandar128E4X.csv', 'VLP32.yaml')
EVEN = tuple(np.linspace(-15.0, 15.0, 16))


def room(
    elevations: Floats, seed: int = 1, origin: tuple[float, float] = (0.0, 0.0), columns: int = 240
) -> tuple[Floats, Ints]:
    """Return a yard with a floor, some of whose points float, and the ring of each."""
    rng = np.random.default_rng(seed)
    up, out = origin
    ring = np.repeat(np.arange(len(elevations)), columns)
    azimuth = np.tile(np.linspace(-np.pi, np.pi, columns, endpoint=False), len(elevations))
    slope = np.radians(np.sort(elevations))[ring]
    wall = 20.0 / np.maximum(np.abs(np.cos(azimuth)), np.abs(np.sin(azimuth))) / np.cos(slope)
    floor = np.where(slope < 0, -1.8 / np.minimum(np.sin(slope), -1e-9), np.inf)
    far = np.minimum(wall, floor) + rng.normal(0.0, 0.01, len(ring))
    floats = rng.random(len(ring)) < 0.05
    far[floats] *= rng.uniform(0.2, 0.9, int(floats.sum()))
    flat = far * np.cos(slope) + out
    xyz = np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), far * np.sin(slope) + up], axis=1
    )
    return xyz, ring


def table(path: Path) -> Floats:
    """Read elevations, degrees."""
    text = path.read_text()
    if path.suffix == '.csv':
        return np.array([float(row[1]) for row in list(csv.reader(text.splitlines()))[1:]])
    lasers = yaml.safe_load(text)['lasers']
    return np.degrees([one['vert_correction'] for one in lasers])


def share_right(found: Ints | None, true: Ints) -> float:
    """Return the share of points in the ring that holds most of theirs, and that they hold most."""
    assert found is not None
    _, ring = np.unique(true, return_inverse=True)
    count = np.zeros((found.max() + 1, ring.max() + 1), np.int64)
    np.add.at(count, (found, ring), 1)
    right = (count.argmax(1)[found] == ring) & (count.argmax(0)[ring] == found)
    return float(right.mean())


@pytest.mark.parametrize('name', TABLES)
def test_rings_of_tables(real_data: Path, name: str) -> None:
    """However unevenly a sensor's rings are spaced, each of its points is in its own."""
    elevations = table(real_data / 'ring_tables' / name)
    xyz, ring = room(elevations)
    assert share_right(rings.recover_rings(xyz), ring) > 0.999


@pytest.mark.parametrize('grid', [0.001, 0.01])
def test_rounded_coordinates(grid: float) -> None:
    """Coordinates may be rounded, as those of some files are."""
    xyz, ring = room(np.array(EVEN))
    far = np.linalg.norm(xyz, axis=1) > 3.0
    found = rings.recover_rings(np.round(xyz / grid) * grid)
    assert found is not None
    assert share_right(found[far], ring[far]) > 0.99


@pytest.mark.parametrize(('origin', 'within'), [((0.036, 0.028), 0.002), ((0.0, 0.0), 0.0)])
def test_origin_of_beams(origin: tuple[float, float], within: float) -> None:
    """Lenses beside the axis, above the origin of the frame, are found; none is made up."""
    xyz, ring = room(np.array(EVEN), origin=origin)
    flat = np.hypot(xyz[:, 0], xyz[:, 1])
    order = np.lexsort((flat, xyz[:, 2]))
    assert rings.find_origin(flat[order], xyz[order, 2]) == pytest.approx(origin, abs=within)
    assert share_right(rings.recover_rings(xyz), ring) == 1.0


def test_a_little_gain_is_no_origin() -> None:
    """Seen from elsewhere, elevations that are uncertain by 0.2° lie closer together by 0.5 %."""
    xyz, ring = room(np.array(EVEN))
    flat = np.hypot(xyz[:, 0], xyz[:, 1])
    height = xyz[:, 2] + 0.003 * flat * np.random.default_rng(1).standard_normal(len(ring))
    order = np.lexsort((flat, height))
    assert rings.find_origin(flat[order], height[order]) == (0.0, 0.0)


def test_near_points_show_no_ring() -> None:
    """Of each band of elevation, points count from the quartile of distances or 8 m, if less."""
    rng = np.random.default_rng(6)
    elevation, distance = rng.uniform(-0.02, 0.02, 400), rng.uniform(1.0, 30.0, 400)
    distance[elevation > 0.0] *= 0.2
    band = np.floor(elevation / rings.BAND_RAD).astype(int)
    expected = []
    for one, far in zip(band, distance, strict=True):
        alike = sorted(distance[band == one])
        expected.append(far >= min(alike[len(alike) // 4], 8.0))
    assert rings.is_far(elevation, distance).tolist() == expected


@pytest.mark.parametrize('sensor', ['auto', 'free'])
@pytest.mark.parametrize('copies', [0, 500])
def test_order_does_not_matter(sensor: str, copies: int) -> None:
    """Points in another order have the same verdicts, bit for bit, by rings and by bands."""
    xyz, _ = room(np.array(EVEN))
    xyz = np.concatenate([xyz, xyz[:copies]])
    mixed = np.random.default_rng(2).permutation(len(xyz))
    parameters = {'boosted_trees.sensor': sensor}
    once, twice = (detect_outliers(some, parameters=parameters) for some in (xyz, xyz[mixed]))
    np.testing.assert_array_equal(twice.score, once.score[mixed])


@pytest.mark.parametrize(
    'bag',
    ['vlp16_mrpt_mcap', 'vlp32_nebula_db3', 'os1_128_db3', 'cloudini_lidar_link_mcap'],
)
def test_recordings(recordings: Path, bag: str) -> None:
    """Of real sensors nearly every point is in the ring that the sensor gives it."""
    points = Decoder(FilterParameters()).decode(first_cloud(recordings / 'bags' / bag))
    found = rings.recover_rings(points.xyz[points.valid])
    assert share_right(found, points.line[points.valid]) > 0.999


@pytest.mark.parametrize(
    'name',
    [HELIOS, 'rubyplus_1693387801484595521.pcd', 'bpearl_1692928171930900197.pcd'],
)
def test_sweeps(real_data: Path, name: str) -> None:
    """So it is of sweeps within a few metres, uneven rings and rings up to the zenith."""
    x, y, z, channel, distance = columns(
        real_data / 'clouds' / 'sensors' / name, 'x', 'y', 'z', 'channel', 'distance'
    )
    valid = np.isfinite(x) & (distance > 0)
    xyz = np.stack([x, y, z], axis=1, dtype=np.float64)[valid]
    assert share_right(rings.recover_rings(xyz), channel[valid].astype(np.int64)) > 0.999


@pytest.mark.parametrize(
    'name',
    ['autzen_trim.laz', 'plane.laz', 'samp41-utm.pcd', 'sample_lareunion_epsg2975.laz',
     'test_semis_2021_0382_6565_LA93_IGN69_cropped.laz', 'bun0.pcd'],
)  # fmt: skip
def test_others_have_none(real_data: Path, name: str) -> None:
    """Clouds from the air, of walls and of objects have no rings, from any position."""
    xyz = np.stack(columns(real_data / 'clouds' / name, 'x', 'y', 'z'), axis=1, dtype=np.float64)
    if name.startswith('samp41'):
        xyz = xyz[np.isfinite(xyz).all(axis=1)]
    for origin in (np.zeros(3), xyz.mean(axis=0), xyz[len(xyz) // 2] + [0.0, 0.0, 1.5]):
        assert rings.recover_rings(xyz - origin) is None


@pytest.mark.parametrize('name', ['anywhere', 'small', 'one ring'])
def test_noise_has_none(name: str) -> None:
    """So have points anywhere around, a cloud that is too small, and a single ring."""
    xyz, ring = room(np.array(EVEN))
    anywhere = np.random.default_rng(4).normal(0.0, 5.0, (20_000, 3))
    clouds = {'anywhere': anywhere, 'small': xyz[:100], 'one ring': xyz[ring == 3]}
    assert rings.recover_rings(clouds[name]) is None


def test_spread_is_that_of_loops() -> None:
    """The spread of elevations is that of plain loops."""
    xyz, _ = room(np.array(EVEN), columns=30)
    flat, z = np.hypot(xyz[:, 0], xyz[:, 1]), xyz[:, 2].copy()
    for up, out in ((0.0, 0.0), (0.03, -0.02)):
        expected = naive.spread(flat.tolist(), z.tolist(), up, out)
        # Angles here and there differ by a millionth.
        assert _kernels.spread(flat, z, up, out) == pytest.approx(expected, abs=0.05)


def test_peaks_are_those_of_loops() -> None:
    """Peaks of a histogram are those of plain loops, with ties and empty columns."""
    assert _kernels.find_peaks(np.array([0, 6, 9, 2, 8, 0, 3, 0]), 6).tolist() == [2, 4]
    rng = np.random.default_rng(3)
    for _ in range(300):
        count = rng.integers(0, 12, 60) * (rng.random(60) < rng.uniform(0.2, 1.0))
        assert _kernels.find_peaks(count, 6).tolist() == naive.peaks(count.tolist(), 6)


def test_arrays_without_lines() -> None:
    """An array is judged by its recovered rings, unless the sensor is said to be another."""
    xyz, ring = room(np.array(EVEN))
    found = detect_outliers(xyz)
    survey = detect_outliers(xyz, parameters={'boosted_trees.sensor': 'survey'})
    assert not np.array_equal(found.score, survey.score)
    # The same rings, said by the sensor, and its times: nearly the same.
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0])
    said = detect_outliers(xyz, t=(azimuth + np.pi) / (2 * np.pi), line=ring)
    assert np.mean(said.outlier == found.outlier) > 0.999


def test_files(real_data: Path, tmp_path: Path) -> None:
    """``clean`` says how many rings it recovered, ``info`` too; tiles change nothing."""
    path = real_data / 'clouds' / 'source.ply'
    assert describe_file(path).rings == 32
    reports = []
    for side in (0.0, 5.0):
        outputs = [tmp_path / f'{side:.0f}{name}.ply' for name in ('', '_outliers')]
        selected = CleanOptions(SEPARATE, tile=side)
        reports.append(
            clean_file(path, outputs[0], FilterParameters(), selected, outliers=outputs[1])
        )
    assert [report.rings for report in reports] == [32, 32]
    assert json.loads((tmp_path / '0.ply.json').read_text())['rings'] == 32
    assert (tmp_path / '0.ply').read_bytes() == (tmp_path / '5.ply').read_bytes()
    plain = describe_file(real_data / 'clouds' / 'plane.laz')
    assert plain.rings == 0


def test_a_turn_of_rings_is_in_one_tile(tmp_path: Path) -> None:
    """However small tiles are, rings are judged along themselves."""
    xyz, _ = room(np.array(EVEN))
    path = tmp_path / 'room.csv'
    np.savetxt(path, xyz, '%.6f', ',', header='x,y,z', comments='')
    parameters = FilterParameters().changed({'chain': ['boosted_trees', 'quadric']})
    outputs = [tmp_path / f'{side:.0f}.csv' for side in (0.0, 2.0)]
    for output, side in zip(outputs, (0.0, 2.0), strict=True):
        clean_file(path, output, parameters, CleanOptions(tile=side))
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


def test_intensities_of_files(tmp_path: Path) -> None:
    """Intensities of a file count where it has rings; missing ones are unknown."""
    xyz, _ = room(np.array(EVEN))
    bright = np.random.default_rng(5).uniform(1.0, 100.0, len(xyz))
    for name, header in (('dark', 'x,y,z'), ('lit', 'x,y,z,Intensity')):
        rows = np.column_stack([xyz, bright])[:, : len(header.split(','))]
        np.savetxt(tmp_path / f'{name}.csv', rows, '%.6f', ',', header=header, comments='')
    count = [
        clean_file(
            tmp_path / f'{name}.csv', tmp_path / f'{name}_out.csv', FilterParameters()
        ).rejected
        for name in ('dark', 'lit')
    ]
    rounded = np.round(xyz, 6)
    assert count == [
        int(detect_outliers(rounded).outlier.sum()),
        int(detect_outliers(rounded, intensity=bright.round(6)).outlier.sum()),
    ]
    assert count[0] != count[1]


# Bands, where there are no rings -----------------------------------------------------------------

SENSOR = 'boosted_trees.sensor'
FREE, SPINNING = {SENSOR: 'free'}, {SENSOR: 'spinning'}


def scattered(count: int, seed: int = 1, stray: float = 0.0) -> Floats:
    """Look into a hall, in directions without any order; some beams end before they reach it."""
    rng = np.random.default_rng(seed)
    azimuth, up = rng.uniform(-0.5, 0.5, count), rng.uniform(-0.3, 0.3, count)
    direction = np.column_stack(
        [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)]
    )
    distance = 12.0 / direction[:, 0] + 0.01 * rng.standard_normal(count)
    few = np.arange(count) < stray * count
    return direction * np.where(few, rng.uniform(2.0, 10.0, count), distance)[:, None]


def apart(xyz: Floats, height: float) -> float:
    """Return the median angle between neighbours in bands of a height, by plain loops."""
    bands: dict[int, list[tuple[float, float]]] = {}
    for x, y, z in xyz.tolist():
        up = np.arctan2(z, np.hypot(x, y))
        bands.setdefault(int(np.floor(up / height)), []).append((np.arctan2(y, x), np.cos(up)))
    steps = []
    for one in bands.values():
        one.sort()
        steps += [(b[0] - a[0]) * a[1] for a, b in pairwise(one)]
    return median(steps) if steps else np.inf


@pytest.mark.parametrize('count', [300, 2000, 9000])
def test_height(count: int) -> None:
    """Bands are the lowest whose points are no farther apart than the bands are high."""
    xyz = scattered(count)
    lines = rings.in_bands(points_of(xyz)).line
    up = np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1]))
    (chosen,) = (k for k, h in enumerate(rings.HEIGHTS) if np.array_equal(np.floor(up / h), lines))
    assert apart(xyz, rings.HEIGHTS[chosen]) <= rings.HEIGHTS[chosen]
    assert apart(xyz, rings.HEIGHTS[chosen - 1]) > rings.HEIGHTS[chosen - 1]


def test_strays_are_found() -> None:
    """What hangs before a wall is rejected, of the wall nothing; lines and times do not count."""
    xyz = scattered(6000, stray=0.05)
    whole = detect_outliers(xyz, parameters=FREE)
    assert whole.outlier[:300].mean() > 0.9
    assert whole.outlier[300:].mean() < 0.001
    rng = np.random.default_rng(5)
    t, line = rng.permutation(6000), rng.integers(0, 4, 6000)
    said = detect_outliers(xyz, t=t, line=line, parameters=FREE)
    np.testing.assert_array_equal(said.score, whole.score)


def test_few_points() -> None:
    """A handful of points has no bands, and is judged by neighbours."""
    assert find_either(points_of(scattered(10)), 'free') is None
    assert not detect_outliers(scattered(10), parameters=FREE).outlier.any()


def rosette(turns: float = 7.7) -> Points:
    """Look into a hall with a pillar, shot by shot along petals; some beams end on the way."""
    shot, rng = np.arange(6000), np.random.default_rng(4)
    across = 0.3 * np.sin(turns / 1000 * shot)
    beam = np.stack([1.0 + 0.0 * across, across, across])
    beam[1:] *= [np.cos(shot * 0.0049), np.sin(shot * 0.0049)]
    far = np.where(np.abs(beam[1] - 0.1) < 0.05, 5.0, 12.0)
    far[rng.random(6000) < 0.02] *= 0.5
    return replace(points_of((far * beam).T), t=10_000 * shot)


def ring_of(points: Points) -> Points:
    """Return a profile of the hall instead: shots along a circle."""
    angle = points.t * 1e-6
    far = points.xyz[:, :1] / 5.0
    return replace(points, xyz=far * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1))


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        (lambda p: p, True),
        (lambda p: p.take(np.random.default_rng(3).permutation(len(p))), True),
        (lambda p: p.take(np.repeat(np.arange(len(p)), 2)), True),  # two returns of each shot
        (lambda p: replace(p, xyz=p.xyz + np.array([0.0, 0.0, 0.05])), True),
        (lambda p: replace(p, xyz=p.xyz + 7.0, own=p.xyz), True),
        (lambda p: replace(p, xyz=p.xyz + np.array([0.0, 0.0, 0.3])), False),
        (lambda p: replace(p, xyz=p.xyz + 7.0), False),
        (lambda p: replace(p, xyz=np.random.default_rng(3).permutation(p.xyz)), False),
        (lambda p: replace(p, line=np.arange(len(p)) % 8), False),
        (lambda p: replace(p, t=40 * p.t), False),
        (lambda p: replace(p, t=0 * p.t), False),
        (lambda p: p.take(slice(900)), False),
        (lambda p: p.take(slice(0)), False),
        (lambda p: replace(p, xyz=1e-170 * p.xyz), False),
        (ring_of, False),
    ],
)
def test_curves(change: Callable[[Points], Points], *, expected: bool) -> None:
    """Smooth curves over an area, seen from their origin, are those of a scanner without rings."""
    points = change(rosette())
    assert rings.draws_curves(points.in_own_frame, order_by_line(points)) is expected


def test_auto_judges_curves_as_free() -> None:
    """Nobody has to say that a scanner has no rings, in files and streams."""
    points = rosette()
    free = detect_outliers(points.xyz, t=points.t, line=points.line, parameters=FREE)
    auto = detect_outliers(points.xyz, t=points.t, line=points.line)
    np.testing.assert_array_equal(auto.score, free.score)
    found = find_either(points, 'auto')
    assert found is not None
    assert found.model == FREE_MODEL


# Rows --------------------------------------------------------------------------------------------


def drive(beside: float = 0.0) -> tuple[Points, Ints]:
    """Return a sweep during which the sensor moved on, so that rings have no elevation, in rows."""
    points = sweep(4, 0.02, columns=600, elevations=np.linspace(-24.0, 2.0, 64).tolist())
    moved = points.xyz + np.stack([points.t * 4e-9 - beside, 0.0 * points.t, 0.0 * points.t], 1)
    order = np.lexsort((points.t, -points.line))
    return replace(points, xyz=moved).take(order), points.line[order]


@pytest.mark.parametrize('named', [True, False])
def test_rows_without_times(*, named: bool) -> None:
    """What comes row by row has the rings that rows are, and the verdicts of a timed sweep."""
    points, ring = drive()
    zeros = np.zeros(len(ring), np.int64)
    bare = replace(points, t=zeros, line=ring if named else zeros)
    assert rings.recover_rings(bare.xyz) is None
    assert share_right(rings.find_rows(bare, order_by_line(bare)), ring) > 0.98
    timed = detect_outliers(points.xyz, t=points.t, line=ring, parameters=SPINNING)
    for sensor in ('auto', 'spinning'):
        bare_too = detect_outliers(bare.xyz, line=bare.line, parameters={SENSOR: sensor})
        assert (bare_too.outlier == timed.outlier).mean() > 0.998
    assert timed.outlier.sum() > 500


@pytest.mark.parametrize('order', [1, -1])
def test_lowest_row_is_ring_0(order: int) -> None:
    """Whether rows come from the top or from the bottom."""
    points, ring = drive()
    one_by_one = np.argsort(order * ring, kind='stable')
    points, ring = points.take(one_by_one), ring[one_by_one]
    bare = replace(points, t=0 * points.t, line=0 * points.line)
    found = rings.find_rows(bare, order_by_line(bare))
    assert found is not None
    assert np.corrcoef(found, ring)[0, 1] > 0.999


@pytest.mark.parametrize(
    'change',
    [
        lambda p: p.take(np.random.default_rng(3).permutation(len(p))),
        lambda p: replace(p, xyz=p.xyz + np.array([500.0, 0.0, 0.0])),
        lambda p: replace(p, xyz=p.xyz * [1.0, 1.0, 0.0]),
        lambda p: p.take(slice(4000)),
        lambda p: p.take(slice(0)),
    ],
)
def test_no_rows(change: Callable[[Points], Points]) -> None:
    """Points in any order, far from the origin, at one height, or of few rows are no rows."""
    points = change(drive()[0])
    bare = replace(points, t=0 * points.t, line=0 * points.line)
    assert rings.find_rows(bare, order_by_line(bare)) is None


def test_a_point_at_the_sensor_changes_no_band() -> None:
    """What is so near that its square is 0 has no say in how high bands are."""
    xyz = scattered(2000)
    expected = rings.in_bands(points_of(xyz)).line
    found = rings.in_bands(points_of(np.concatenate([xyz, [[1e-200, 0.0, 0.0]]]))).line
    assert len(np.unique(expected)) > 10
    np.testing.assert_array_equal(found[:-1], expected)


def test_returns_at_the_sensor_have_no_elevation() -> None:
    """Where squares of distances are 0 there is no direction, and no warning."""
    xyz = scattered(3000) * 1e-170
    assert not detect_outliers(xyz, parameters=FREE).outlier.any()
