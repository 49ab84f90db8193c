# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""E57: scans in one frame, missing returns that stay, and a copy that is PLY."""

import os
import tracemalloc
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from helpers.cloud_files import VERDICT, columns, copied, every_third, verdict
from helpers.e57_files import reworded, write_e57
from scipy.spatial.transform import Rotation

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

COUNT = 50
LITTLE = 10_000_000  # bytes
TURNED = (0.5, -0.1, 0.7, 0.5)  # a unit quaternion


def cartesian(seed: int) -> dict[str, Any]:
    """Make up a scan, every fifth shot of which has no return."""
    rng = np.random.default_rng(seed)
    scan: dict[str, Any] = {f'cartesian{axis}': rng.normal(size=COUNT) for axis in 'XYZ'}
    scan['intensity'] = rng.random(COUNT)
    scan |= {f'color{name}': np.arange(COUNT) * 5 for name in ('Red', 'Green', 'Blue')}
    scan |= {'rowIndex': np.arange(COUNT) + 300, 'nor:normalX': rng.random(COUNT)}
    scan |= {'cartesianInvalidState': np.arange(COUNT) % 5 // 4 * 2}
    return scan


def write(path: Path) -> Path:
    """Write two scans; the second stands 10 m farther, and is turned about all axes."""
    poses = ((1.0, 0, 0, 0, 0, 0, 1), (*TURNED, 10, 0, 1))
    return write_e57(path, [cartesian(1), cartesian(2)], poses)


def test_scans_are_put_together(tmp_path: Path) -> None:
    """Poses are applied; a missing return has no place; other columns are as in the file."""
    first, second = cartesian(1), cartesian(2)
    path = write(tmp_path / 'two.e57')
    names = ['x', 'y', 'z', 'intensity', 'red', 'green', 'blue', 'row', 'scan']
    assert list(open_cloud(path).columns) == names
    x, y, z, intensity, red, _, _, row, scan = columns(path)
    w, *axis = TURNED
    positions = [
        np.stack([part[f'cartesian{one}'] for one in 'XYZ'], 1) for part in (first, second)
    ]
    turned = Rotation.from_quat([*axis, w]).apply(positions[1])
    placed = np.concatenate((positions[0] + np.array([0, 0, 1]), turned + np.array([10, 0, 1])))
    no_return = np.tile(first['cartesianInvalidState'] != 0, 2)
    expected = np.where(no_return[:, None], np.nan, placed)
    np.testing.assert_allclose(np.stack((x, y, z), 1), expected, rtol=0, atol=1e-12)
    assert intensity[:COUNT].tolist() == first['intensity'].tolist()
    assert red.tolist() == [*range(0, 5 * COUNT, 5)] * 2
    assert row.tolist() == [*range(300, 300 + COUNT)] * 2
    assert scan.tolist() == [0] * COUNT + [1] * COUNT
    assert columns(path, 'scan')[0].tolist() == scan.tolist()


def test_angles(tmp_path: Path) -> None:
    """Ranges and angles are coordinates, too, also beside one cartesian field alone."""
    scan = {
        'sphericalRange': np.array([2.0, 0.0, 3.0]),
        'sphericalAzimuth': np.array([np.pi / 2, 1, 0]),
        'sphericalElevation': np.array([0.0, 1, np.pi / 2]),
        'cartesianX': np.zeros(3),
    }
    path = write_e57(tmp_path / 'one.e57', [scan])
    x, y, z, _ = columns(path)
    np.testing.assert_allclose(x, [0, np.nan, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(y, [2, np.nan, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(z, [0, np.nan, 3], rtol=0, atol=1e-12)


def test_copy_is_ply(tmp_path: Path) -> None:
    """The copy has all columns and those of the verdict, without removed points."""
    path = write(tmp_path / 'two.e57')
    keep, added = every_third(2 * COUNT), verdict(2 * COUNT)
    copy = copied(path, Change(keep, added=added), 'two.ply')
    assert list(open_cloud(copy).columns) == [*open_cloud(path).columns, *VERDICT]
    for name, values in zip(open_cloud(path).columns, columns(path), strict=True):
        np.testing.assert_array_equal(columns(copy, name)[0], values[keep])
        assert open_cloud(copy).columns[name] == open_cloud(path).columns[name]
    for name, values in added.items():
        np.testing.assert_array_equal(columns(copy, name)[0], values[keep])


XSI = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
COUNTED = b'recordCount="50"'


@pytest.mark.parametrize(
    ('said', 'sentence'),
    [
        ('51', r'must be readable, got "An unrecoverable inconsistent .*\(ErrorInternal\)"$'),
        ('0', 'of at least one point'),
        ('-1', 'the points of scan 1 of'),
        ('999999999999999', 'the points of scan 1 of'),
    ],
)
def test_wrong_counts(tmp_path: Path, said: str, sentence: str) -> None:
    """Too large a count and a count of 0 are refused; too small a count is not noticed."""
    path = write_e57(tmp_path / 'one.e57', [cartesian(1)])
    data = path.read_bytes()
    path.write_bytes(reworded(data, COUNTED, COUNTED))
    assert len(columns(path)[0]) == COUNT
    path.write_bytes(reworded(data, COUNTED, f'recordCount="{said}"'.encode()))
    tracemalloc.start()
    with pytest.raises(CloudError, match=sentence):
        columns(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < LITTLE


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('<e57Root ', '<!DOCTYPE e57Root SYSTEM "file://FIFO"><e57Root '),
        ('<e57Root ', '<!DOCTYPE e [<!ENTITY a "lol"><!ENTITY b "&a;&a;">]><e57Root '),
        ('<e57Root ', f'<e57Root {XSI} xsi:schemaLocation="urn:a file://FIFO" '),
        ('<e57Root ', f'<e57Root {XSI} xsi:noNamespaceSchemaLocation="file://FIFO" '),
    ],
)
def test_references_in_xml(tmp_path: Path, old: str, new: str) -> None:
    """XML that names other files, or has entities, is refused: nothing is read, nothing waits."""
    path = write_e57(tmp_path / 'one.e57', [cartesian(1)])
    os.mkfifo(tmp_path / 'fifo')
    new = new.replace('FIFO', str(tmp_path / 'fifo'))
    path.write_bytes(reworded(path.read_bytes(), old.encode(), new.encode()))
    begin = perf_counter()
    with pytest.raises(CloudError, match=r'XML of .* must be without references to other files'):
        open_cloud(path)
    assert perf_counter() - begin < 1


def test_encoding_of_xml(tmp_path: Path) -> None:
    """XML in another encoding than UTF-8, in which a reference is not seen, is refused."""
    path = write_e57(tmp_path / 'one.e57', [cartesian(1)])
    data = path.read_bytes()
    path.write_bytes(reworded(data, b'encoding="UTF-8"', b'encoding="UTF-7"'))
    with pytest.raises(CloudError, match=r"must be in UTF-8, got 'UTF-7'"):
        open_cloud(path)
    path.write_bytes(reworded(data, b'encoding="UTF-8"', b'encoding="UTF-8"\0'))
    with pytest.raises(CloudError, match=r'must be in UTF-8, got zeros'):
        open_cloud(path)


@pytest.mark.parametrize('name', ['bomb9.e57', 'dtd_http.e57'])
def test_hostile_xml(real_data: Path, name: str) -> None:
    """So are entities that unpack to gigabytes, and a DTD at an address."""
    with pytest.raises(CloudError, match=r"without references to other files, got '<!DOCTYPE'"):
        open_cloud(real_data / 'hostile' / name)


def test_what_makes_no_sense(tmp_path: Path) -> None:
    """A quaternion of another length would stretch the cloud; positions have three coordinates."""
    path = write_e57(tmp_path / 'one.e57', [cartesian(1)], [(2.0, 0, 0, 0, 0, 0, 0)])
    with pytest.raises(CloudError, match=r'the pose of scan 1 of .* must be a unit quaternion'):
        open_cloud(path)
    del (scan := cartesian(1))['cartesianZ']
    write_e57(path, [scan])
    with pytest.raises(CloudError, match=r'scan 1 of .* must be with cartesianX, cartesianY'):
        open_cloud(path)
