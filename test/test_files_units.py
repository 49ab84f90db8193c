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

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import points
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.units import metres_per_unit
from lidar_outlier_filter.parameters.filter import FilterParameters

FOOT, SURVEY = 0.3048, 1200 / 3937
HERE = Path('cloud.las')
FLAT = 'PROJCS["a",GEOGCS["b",UNIT["degree",0.017]],UNIT["US survey foot",0.30480060960121924]]'


CRS_2 = (
    'PROJCRS["a",BASEGEOGCRS["b",UNIT["degree",0.017]],CONVERSION["c",PARAMETER["d",1,'
    'LENGTHUNIT["metre",1]]],CS[Cartesian,2],AXIS["(E)",east,LENGTHUNIT["foot",0.3048]],'
    'AXIS["(N)",north,LENGTHUNIT["foot",0.3048]]]'
)


def keys(*rows: tuple[int, int, int, int]) -> tuple[int, bytes]:
    """Make the record with the keys."""
    numbers = [1, 1, 0, len(rows), *(number for row in rows for number in row)]
    return 34735, struct.pack(f'<{len(numbers)}H', *numbers)


def wkt(text: str) -> tuple[int, bytes]:
    """Make the record with the text."""
    return 2112, text.encode() + b'\0'


def test_keys() -> None:
    """The unit of x and y is also that of z, unless there is another."""
    feet = keys((1024, 0, 1, 1), (3076, 0, 1, 9002))
    assert metres_per_unit(dict([feet]), HERE, wkt=False) == dict.fromkeys('xyz', FOOT)
    both = keys((3076, 0, 1, 9003), (4099, 0, 1, 9001))
    assert metres_per_unit(dict([both]), HERE, wkt=False) == {'x': SURVEY, 'y': SURVEY}
    up = keys((4099, 0, 1, 9002))
    assert metres_per_unit(dict([up]), HERE, wkt=False) == {'z': FOOT}


def test_a_unit_by_its_size() -> None:
    """A unit of one's own is given by a number in another record."""
    own = keys((3076, 0, 1, 32767), (3077, 34736, 1, 1))
    doubles = (34736, struct.pack('<2d', 7.0, 0.5))
    assert metres_per_unit(dict([own, doubles]), HERE, wkt=False) == dict.fromkeys('xyz', 0.5)


@pytest.mark.parametrize('records', [[], [keys((3076, 0, 1, 9001))], [keys((1024, 0, 1, 1))]])
def test_metres(records: list[tuple[int, bytes]]) -> None:
    """Nothing is said, or metres are."""
    assert metres_per_unit(dict(records), HERE, wkt=False) == {}


@pytest.mark.parametrize('rows', [[(3076, 0, 1, 4711)], [(3076, 0, 1, 32767)]])
def test_units_that_are_refused(rows: list[tuple[int, int, int, int]]) -> None:
    """An unknown one, and one of its own without a size."""
    with pytest.raises(CloudError, match=r'the unit of cloud.las, key 3076 must be one of 9001'):
        metres_per_unit(dict([keys(*rows)]), HERE, wkt=False)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (FLAT, dict.fromkeys('xyz', 0.30480060960121924)),
        (
            f'COMPD_CS["c",{FLAT},VERT_CS["d",VERT_DATUM["e",2005],UNIT["metre",1]]]',
            {'x': 0.30480060960121924, 'y': 0.30480060960121924},
        ),
        ('PROJCS["a [ft] (x)",GEOGCS["b",UNIT["degree",0.017]],UNIT["metre",1]]', {}),
        ('GEOGCS["b",PRIMEM["Greenwich",0],UNIT["degree",0.0174532925]]', {}),
        (
            CRS_2,
            dict.fromkeys('xyz', FOOT),
        ),
        (
            'COMPOUNDCRS["c",PROJCRS["a",UNIT["metre",1]],VERTCRS["d",LENGTHUNIT["foot",0.3048]]]',
            {'z': FOOT},
        ),
    ],
)
def test_wkt(text: str, expected: dict[str, float]) -> None:
    """Units of the plane and of heights; those of angles and of parameters are none."""
    assert metres_per_unit(dict([wkt(text)]), HERE, wkt=True) == pytest.approx(expected)


def test_which_of_both_counts() -> None:
    """The header says so."""
    both = [wkt(FLAT), keys((3076, 0, 1, 9002))]
    assert metres_per_unit(dict(both), HERE, wkt=False)['x'] == FOOT
    assert metres_per_unit(dict(both), HERE, wkt=True)['x'] == pytest.approx(SURVEY)


@pytest.mark.parametrize('name', ['autzen_trim.laz', 'autzen-point-format-3.las'])
def test_real_files_in_feet(recordings: Path, name: str) -> None:
    """What is loaded are metres; the columns stay in feet."""
    path = recordings / 'clouds' / name
    file = open_cloud(path)
    assert file.metres == dict.fromkeys('xyz', FOOT)
    loaded = points.load(file, ('x', 'y', 'z'), FilterParameters(), timed=False)
    np.testing.assert_array_equal(loaded.points.xyz, laspy.read(path).xyz * FOOT)


@pytest.mark.parametrize('name', ['plane.laz', 'sample_lareunion_epsg2975.laz', 'bun0.pcd'])
def test_real_files_in_metres(recordings: Path, name: str) -> None:
    """Nothing is changed."""
    assert open_cloud(recordings / 'clouds' / name).metres == {}


def test_limits_are_in_metres(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A radius of 30 m is 30 m; the copy has the coordinates of the file, and the log its unit."""
    path = recordings / 'clouds' / 'autzen-point-format-3.las'
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
