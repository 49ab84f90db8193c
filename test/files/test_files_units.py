# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LAS and LAZ files in feet are judged in metres, and reported; copies stay in feet."""

import json
import struct
from pathlib import Path
from typing import Any

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


PROJECTED = FLAT.replace('"a"', '"a [ft] (x)"').replace('0.30480060960121924', '1')
LENGTHS = 'the coordinates of cloud.las must be lengths, or clean --unit given, got degrees'
NO_UNIT = 'the unit of cloud.las, key 3076 must be a length'
NO_SYSTEM = 'the coordinate system of cloud.las must be one that PROJ knows'


@pytest.mark.parametrize(
    ('records', 'expected'),
    [
        # Keys: the unit of x and y is also that of z, unless there is another.
        ([], {}),
        ([keys((1024, 0, 1, 1), (3076, 0, 1, 9002))], dict.fromkeys('xyz', FOOT)),
        ([keys((3076, 0, 1, 9003), (4099, 0, 1, 9001))], dict.fromkeys('xy', SURVEY)),
        ([keys((4099, 0, 1, 9002))], {'z': FOOT}),
        # The EPSG numbers of the systems, and no unit.
        ([keys((1024, 0, 1, 1), (3072, 0, 1, 2229))], dict.fromkeys('xyz', SURVEY)),
        ([keys((3072, 0, 1, 25832), (4096, 0, 1, 8228))], {'z': FOOT}),
        ([keys((3072, 0, 1, 32767))], {}),
        ([keys((3076, 0, 1, 9001), (3072, 0, 1, 2229))], {}),  # the unit itself counts more
        ([keys((4096, 0, 1, 5013))], {}),  # a number of GeoTIFF's own
        ([keys((3076, 0, 1, 4711))], NO_UNIT),
        ([keys((3076, 0, 1, 9102))], NO_UNIT),  # of an angle
        ([keys((3072, 0, 1, 1))], NO_SYSTEM),
        ([keys((3072, 0, 1, 4326))], LENGTHS),
        ([keys((1024, 0, 1, 2), (2048, 0, 1, 4326))], LENGTHS),
        # WKT: units of the plane and of heights; units of angles and of parameters do not count.
        ([wkt('')], {}),
        ([wkt(FLAT)], dict.fromkeys('xyz', SURVEY)),
        ([wkt(PROJECTED)], {}),
        ([wkt(f'COMPD_CS["c",{FLAT},{UP}]')], dict.fromkeys('xy', SURVEY)),
        ([wkt('LOCAL_CS["here",UNIT["foot",0.3048]]')], dict.fromkeys('xyz', FOOT)),
        ([wkt(CRS.from_epsg(2992).to_wkt('WKT2_2019'))], dict.fromkeys('xyz', FOOT)),
        ([wkt(CRS('EPSG:25832+8228').to_wkt('WKT2_2019'))], {'z': FOOT}),
        ([wkt(DEGREES)], LENGTHS),
        ([wkt('PROJCS["a"')], NO_SYSTEM),
        # Where one says nothing, the other counts.
        ([wkt(FLAT), keys((1024, 0, 1, 1))], dict.fromkeys('xyz', SURVEY)),
        ([wkt(''), keys((3076, 0, 1, 9003))], dict.fromkeys('xyz', SURVEY)),
    ],
)
@pytest.mark.parametrize('counts', [True, False])
def test_units(records: list[tuple[int, bytes]], expected: Any, *, counts: bool) -> None:
    """A single record that names a unit is used, whatever the header says of WKT."""
    if isinstance(expected, str):
        with pytest.raises(CloudError, match=expected):
            metres_per_unit(dict(records), HERE, wkt=counts)
    else:
        assert metres_per_unit(dict(records), HERE, wkt=counts) == pytest.approx(expected)


def test_which_of_both_counts() -> None:
    """With units in both, the header decides."""
    both = dict([wkt(FLAT), keys((3076, 0, 1, 9002))])
    assert metres_per_unit(both, HERE, wkt=False)['x'] == FOOT
    assert metres_per_unit(both, HERE, wkt=True)['x'] == pytest.approx(SURVEY)


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
    assert 'is in ft (0.3048 m), and is judged in metres' in printed
    log = json.loads(out.with_name('out.las.json').read_text())
    assert log['metres'] == dict.fromkeys('xyz', FOOT)
    before, after = laspy.read(path), laspy.read(out)
    np.testing.assert_array_equal(before.xyz, after.xyz)
    xyz = before.xyz * FOOT
    near = np.linalg.norm(xyz[:, None] - xyz, axis=2) <= 30.0
    np.testing.assert_array_equal(after.classification == 7, near.sum(axis=1) - 1 < 3)


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
