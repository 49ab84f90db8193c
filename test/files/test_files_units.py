# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LAS and LAZ files in feet are judged in metres, and say so; what is written stays in feet."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import points
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.judged_file import UNITS
from lidar_outlier_filter.files.las_header import metres_per_unit
from lidar_outlier_filter.parameters.filter import FilterParameters

FOOT, SURVEY = 0.3048, 1200 / 3937
HERE = Path('cloud.las')
DEGREES = (
    'GEOGCS["b",DATUM["d",SPHEROID["s",6378137,298.25]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.0174532925199433]]'
)
FLAT = (
    f'PROJCS["a",{DEGREES},PROJECTION["Transverse_Mercator"],'
    'UNIT["US survey foot",0.30480060960121924]]'
)
UP = 'VERT_CS["d",VERT_DATUM["e",2005],UNIT["metre",1]]'


def keys(*rows: tuple[int, int, int, int]) -> tuple[int, bytes]:
    """Make the record with the keys."""
    numbers = [1, 1, 0, len(rows), *(number for row in rows for number in row)]
    return 34735, struct.pack(f'<{len(numbers)}H', *numbers)


def wkt(text: str) -> tuple[int, bytes]:
    """Make the record with the text."""
    return 2112, text.encode() + b'\0'


@pytest.mark.parametrize(
    ('rows', 'expected'),
    [
        ([(1024, 0, 1, 1), (3076, 0, 1, 9002)], dict.fromkeys('xyz', FOOT)),
        ([(3076, 0, 1, 9003), (4099, 0, 1, 9001)], dict.fromkeys('xy', SURVEY)),
        ([(4099, 0, 1, 9002)], {'z': FOOT}),
        # The EPSG numbers of the systems, and no unit.
        ([(1024, 0, 1, 1), (3072, 0, 1, 2229)], dict.fromkeys('xyz', SURVEY)),
        ([(3072, 0, 1, 25832), (4096, 0, 1, 8228)], {'z': FOOT}),
    ],
)
def test_keys(rows: list[tuple[int, int, int, int]], expected: dict[str, float]) -> None:
    """The unit of x and y is also that of z, unless there is another."""
    assert metres_per_unit(dict([keys(*rows)]), HERE, wkt=False) == pytest.approx(expected)


@pytest.mark.parametrize(
    'records',
    [
        [],
        [keys((3076, 0, 1, 9001))],
        [keys((1024, 0, 1, 1))],
        [keys((3072, 0, 1, 25832))],
        [keys((3072, 0, 1, 32767))],
        [keys((3076, 0, 1, 9001), (3072, 0, 1, 2229))],  # what is said of the unit counts
        [keys((4096, 0, 1, 5013))],  # a number of GeoTIFF's own
        [(2112, b'')],
    ],
)
def test_metres(records: list[tuple[int, bytes]]) -> None:
    """Nothing is said, or metres are."""
    assert metres_per_unit(dict(records), HERE, wkt=(2112, b'') in records) == {}


@pytest.mark.parametrize(
    ('rows', 'refusal'),
    [
        ([(3076, 0, 1, 4711)], 'the unit of cloud.las, key 3076 must be a length'),
        ([(3076, 0, 1, 9102)], 'the unit of cloud.las, key 3076 must be a length'),
        ([(3076, 0, 1, 32767)], 'the unit of cloud.las, key 3076 must be a length'),
        ([(3072, 0, 1, 1)], 'the coordinate system of cloud.las must be one that PROJ knows'),
        ([(3072, 0, 1, 4326)], 'the coordinates of cloud.las must be lengths'),
        ([(1024, 0, 1, 2), (2048, 0, 1, 4326)], 'the coordinates of cloud.las must be lengths'),
    ],
)
def test_units_that_are_refused(rows: list[tuple[int, int, int, int]], refusal: str) -> None:
    """Unknown ones, angles, and one of its own without a size."""
    with pytest.raises(CloudError, match=refusal):
        metres_per_unit(dict([keys(*rows)]), HERE, wkt=False)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (FLAT, dict.fromkeys('xyz', 0.30480060960121924)),
        (FLAT.replace('"a"', '"a [ft] (x)"').replace('0.30480060960121924', '1'), {}),
        (f'COMPD_CS["c",{FLAT},{UP}]', dict.fromkeys('xy', 0.30480060960121924)),
        ('LOCAL_CS["here",UNIT["foot",0.3048]]', dict.fromkeys('xyz', FOOT)),
        (CRS.from_epsg(2992).to_wkt('WKT2_2019'), dict.fromkeys('xyz', FOOT)),
        (CRS('EPSG:25832+8228').to_wkt('WKT2_2019'), {'z': FOOT}),
    ],
)
def test_wkt(text: str, expected: dict[str, float]) -> None:
    """Units of the plane and of heights; those of angles and of parameters are none."""
    assert metres_per_unit(dict([wkt(text)]), HERE, wkt=True) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('text', 'refusal'),
    [
        (DEGREES, 'the coordinates of cloud.las must be lengths, or clean --unit given, got deg'),
        ('PROJCS["a"', 'the coordinate system of cloud.las must be one that PROJ knows'),
    ],
)
def test_wkt_that_is_refused(text: str, refusal: str) -> None:
    """Angles, and what is none."""
    with pytest.raises(CloudError, match=refusal):
        metres_per_unit(dict([wkt(text)]), HERE, wkt=True)


def test_which_of_both_counts() -> None:
    """The header says so."""
    both = [wkt(FLAT), keys((3076, 0, 1, 9002))]
    assert metres_per_unit(dict(both), HERE, wkt=False)['x'] == FOOT
    assert metres_per_unit(dict(both), HERE, wkt=True)['x'] == pytest.approx(SURVEY)


def test_the_other_where_one_says_nothing() -> None:
    """WKT counts without the header's word where no keys say a unit, and keys where no WKT does."""
    feet = pytest.approx(dict.fromkeys('xyz', SURVEY))
    for keys_without in ([], [keys()], [keys((1024, 0, 1, 1))]):
        assert metres_per_unit(dict([wkt(FLAT), *keys_without]), HERE, wkt=False) == feet
    said = keys((3076, 0, 1, 9003))
    for text_without in ([], [wkt('')]):
        assert metres_per_unit(dict([said, *text_without]), HERE, wkt=True) == feet


def test_deviations_have_the_unit_of_the_coordinates(tmp_path: Path) -> None:
    """A column of standard deviations beside coordinates in millimetres is in millimetres."""
    path = tmp_path / 'scan.csv'
    path.write_text('x,y,z,time,ring,s\n1000,2000,3000,0.5,1,5\n')
    parameters = FilterParameters().changed({'sigma_field': 's'})
    sizes = dict.fromkeys('xyz', UNITS['mm'])
    loaded = points.load(open_cloud(path), 'xyz', parameters, timed=True, metres=sizes)
    np.testing.assert_allclose(loaded.points.xyz, [[1.0, 2.0, 3.0]])
    assert loaded.points.sigma is not None
    np.testing.assert_allclose(loaded.points.sigma, [0.005])


def test_limits_are_in_metres(
    real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A radius of 30 m is 30 m; the copy has the coordinates of the file, and the log its unit."""
    path = real_data / 'clouds' / 'autzen-point-format-3.las'
    out = tmp_path / 'out.las'
    options = ['--chain', 'sor', '--set', 'sor.statistic=radius', '--set', 'sor.radius=30.0']
    assert main(['clean', str(path), *options, '--output', str(out)]) == 0
    printed = ' '.join(capsys.readouterr().err.split())
    assert 'is not in metres (x = 0.3048 m, y = 0.3048 m, z = 0.3048 m)' in printed
    log = json.loads(out.with_name('out.las.json').read_text())
    assert log['metres'] == dict.fromkeys('xyz', FOOT)
    before, after = laspy.read(path), laspy.read(out)
    np.testing.assert_array_equal(before.xyz, after.xyz)
    xyz = before.xyz * FOOT
    near = np.linalg.norm(xyz[:, None] - xyz, axis=2) <= 30.0
    np.testing.assert_array_equal(after.classification == 7, near.sum(axis=1) - 1 < 3)


def test_a_unit_that_the_user_gives(tmp_path: Path) -> None:
    """A radius of half a metre holds neighbours a millimetre away, and none a metre away."""
    path = tmp_path / 'scan.csv'
    rows = [f'{x},{y},1' for x in range(0, 20_000, 1000) for y in range(9)]
    path.write_text('\n'.join(['x,y,z', *rows]) + '\n')
    options = ['--chain', 'sor', '--set', 'sor.statistic=radius', '--set', 'sor.radius=0.5']
    for unit, rejected in (('mm', 0), ('m', 180)):
        out = tmp_path / f'{unit}.csv'
        assert main(['clean', str(path), *options, '--unit', unit, '--output', str(out)]) == 0
        assert json.loads(out.with_name(f'{unit}.csv.json').read_text())['rejected'] == rejected


def test_a_unit_counts_more_than_the_file(tmp_path: Path) -> None:
    """A file in degrees is judged where its user knows better."""
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.vlrs.append(laspy.VLR('LASF_Projection', 2112, '', wkt(DEGREES)[1]))
    header.global_encoding.wkt = True
    cloud = laspy.LasData(header)
    cloud.x, cloud.y = (axis.ravel() for axis in np.meshgrid(np.arange(9.0), np.arange(9.0)))
    path = tmp_path / 'a.las'
    cloud.write(path)
    assert main(['clean', str(path), '--chain', 'sor']) == 1
    assert main(['clean', str(path), '--chain', 'sor', '--unit', 'ft']) == 0
    log = json.loads((tmp_path / 'a_cleaned.las.json').read_text())
    assert log['metres'] == dict.fromkeys('xyz', FOOT)
